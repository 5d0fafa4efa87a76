"""Step 4: judgement of frames with known delays, and the settings derived from them."""

from __future__ import annotations

from dataclasses import replace

import pytest
from machine_bench import MS

from hapticd.config.sections import Config, PredictionConfig
from hapticd.core.board.ledger import Histogram
from hapticd.tools.calibrate import delays
from hapticd.tools.calibrate.verdict import Outcome
from hapticd.tools.latency import MeasuredLatency


@pytest.fixture(scope="module")
def in_time(measured: MeasuredLatency) -> MeasuredLatency:
    return replace(measured, counts={**measured.counts, "frames unanswered": 0, "frames late": 0})


def test_a_usual_period_is_no_setting(in_time: MeasuredLatency) -> None:
    verdict = delays.verdict(in_time, Config(), is_simulated=True)
    assert verdict.outcome is Outcome.PASS
    assert verdict.settings == {}
    assert delays.report_period_ms(in_time) == pytest.approx(11.25, abs=0.3)


def test_another_period_than_the_configured_one_becomes_a_setting(in_time: MeasuredLatency) -> None:
    slow = Config(prediction=PredictionConfig(period_ms=16.0))
    found = delays.verdict(in_time, slow, is_simulated=True).settings
    assert found["prediction"]["period_ms"] == pytest.approx(11.25, abs=0.3)


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


def test_few_frames_and_an_unsteady_link_want_a_look(in_time: MeasuredLatency) -> None:
    few = delays.verdict(replace(in_time, lines=in_time.lines[:9]), Config(), is_simulated=True)
    assert (few.outcome, "Only 9 frames" in few.sentence) == (Outcome.WARN, True)
    unsteady = Histogram()
    for span_ns in [5 * MS] * 90 + [12 * MS] * 10:
        unsteady.add(span_ns)
    changed = replace(in_time, stages={**in_time.stages, "link": unsteady})
    assert "varies by" in delays.verdict(changed, Config(), is_simulated=True).sentence


def test_without_frames_the_period_is_unknown(in_time: MeasuredLatency) -> None:
    empty = replace(in_time, lines=())
    assert delays.report_period_ms(empty) != delays.report_period_ms(empty)
    assert "prediction" not in delays.verdict(empty, Config(), is_simulated=True).settings
