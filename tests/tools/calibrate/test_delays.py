"""Judgement of frames with known delays, and the settings derived from them."""

from __future__ import annotations

from dataclasses import replace

import pytest
from machine_bench import MS

from hapticd.config.sections import Config, PredictionConfig
from hapticd.core.board.ledger import Histogram
from hapticd.tools.calibrate import delays
from hapticd.tools.calibrate.step import Outcome
from hapticd.tools.latency import MeasuredLatency


@pytest.fixture(scope="module")
def in_time(measured: MeasuredLatency) -> MeasuredLatency:
    return replace(measured, counts={**measured.counts, "frames unanswered": 0, "frames late": 0})


@pytest.mark.parametrize(("period_ms", "is_set"), [(11.25, False), (16.0, True)])
def test_another_period_than_the_configured_one_becomes_a_setting(
    period_ms: float, is_set: bool, in_time: MeasuredLatency
) -> None:
    found = delays.verdict(in_time, Config(prediction=PredictionConfig(period_ms=period_ms)), is_simulated=True)
    expected = {"prediction": {"period_ms": pytest.approx(11.25, abs=0.3)}} if is_set else {}
    assert (found.outcome, found.settings) == (Outcome.PASS, expected)


@pytest.mark.parametrize(
    ("late", "outcome", "sentence"),
    [(0, Outcome.PASS, "ms ahead"), (5, Outcome.WARN, "reduce the host's load"), (60, Outcome.FAIL, "check the link")],
)
def test_frames_that_come_late_are_judged_by_their_share(
    in_time: MeasuredLatency, late: int, outcome: Outcome, sentence: str
) -> None:
    counted = replace(in_time, counts={**in_time.counts, "frames": 100, "frames late": late})
    verdict = delays.verdict(counted, Config(), is_simulated=True)
    assert verdict.outcome is outcome
    assert sentence in verdict.sentence


def test_few_frames_and_an_unsteady_link_are_a_warning(in_time: MeasuredLatency) -> None:
    few = delays.verdict(replace(in_time, lines=in_time.lines[:9]), Config(), is_simulated=True)
    assert (few.outcome, "Only 9 frames" in few.sentence) == (Outcome.WARN, True)
    unsteady = Histogram()
    for span_ns in [5 * MS] * 90 + [12 * MS] * 10:
        unsteady.add(span_ns)
    assert few.settings == delays.verdict(replace(in_time, lines=()), Config(), is_simulated=True).settings == {}
    changed = replace(in_time, stages={**in_time.stages, "link": unsteady})
    assert "varies by" in delays.verdict(changed, Config(), is_simulated=True).sentence
