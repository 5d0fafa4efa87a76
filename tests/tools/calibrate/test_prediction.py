"""`hapticd calibrate prediction`: what strokes teach, and what is kept of it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from hapticd.__main__ import main
from hapticd.config import loader as config
from hapticd.core.prediction.pad_memory import PadMemory
from hapticd.daemon.settings import pipeline_settings
from hapticd.sim.fingers.paths import Rest
from hapticd.sim.fingers.sensor import SensorModel
from hapticd.sim.fingers.strokes import Strokes
from hapticd.tools.calibrate import prediction
from hapticd.tools.calibrate.step import Outcome
from hapticd.tools.touches import Trace
from hapticd.values import FloatArray, RawReport
from hapticd.wire.trackpad import DEFAULT_PAD, Pad


def filtered() -> Trace:
    """Strokes on a pad that averages its positions heavily."""
    rng = np.random.default_rng(1)
    t_s: FloatArray = np.arange(2500) / 125.0
    xy_mm = Strokes(1, 150.0).position_mm(t_s) + 0.05 * rng.standard_normal((len(t_s), 2))
    for k in range(1, len(xy_mm)):
        xy_mm[k] = 0.8 * xy_mm[k - 1] + 0.2 * xy_mm[k]
    return Trace(t_s, np.round(xy_mm, 2))


def test_weights_of_a_pad_that_filters_are_kept_and_the_service_begins_with_them() -> None:
    traces = [filtered()]
    found = prediction.learned(traces)
    verdict = prediction.verdict(traces, found, is_simulated=True)
    assert found.is_better
    assert verdict.outcome is Outcome.PASS
    kept = verdict.settings["prediction"]["pad_weights"]
    assert verdict.settings["prediction"]["period_ms"] == pytest.approx(8.0)
    same = prediction.Learned(found.weights, found.before_mm, found.before_mm)  # no better than many pads'
    none = prediction.verdict(traces, same, is_simulated=True)
    assert (none.outcome, "pad_weights" in none.settings["prediction"]) == (Outcome.WARN, False)
    loaded = config.from_table({"prediction": {"pad_weights": kept}}, where="test", folder=None)
    make = pipeline_settings(loaded).make_predictor
    assert make.keywords["memory"].kept == pytest.approx(PadMemory.of(kept).kept)  # type: ignore[attr-defined]


def test_the_step_runs_on_the_simulated_pad_and_writes_its_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "plate"
    assert main(["calibrate", "prediction", "--sim", "--strokes", "15", "--out", str(out)]) == 0
    assert "error 15 ms ahead, of this pad" in capsys.readouterr().out
    assert {path.name for path in out.iterdir()} == {"hapticd.toml", "prediction.json", "prediction.png"}


def test_too_few_strokes_and_a_missing_recording_are_refused(tmp_path: Path, refused: Callable[..., str]) -> None:
    step = ["calibrate", "prediction", "--out", str(tmp_path / "plate")]
    assert "fewer than 1000 samples" in refused(*step, "--sim", "--strokes", "3")
    assert "is not a file: give a recording" in refused(*step, "--recording", str(tmp_path / "none.mcap"))


MOUSE_REPORT = bytes((0x02, *bytes(7)))


class ReconnectedPad:
    """A pad that reports as a mouse, is unplugged, and then reports a finger."""

    def __init__(self) -> None:
        self.enabled, self.is_closed = 0, False
        self.counters: dict[str, int | str] = {}

    def start(
        self,
        _: asyncio.AbstractEventLoop,
        on_reports: Callable[[Sequence[RawReport]], None],
        on_link: Callable[[Pad | None, str], None],
    ) -> None:
        on_link(DEFAULT_PAD, "plugged in")
        on_reports([RawReport(0, MOUSE_REPORT)])
        on_link(None, "unplugged")
        on_link(DEFAULT_PAD, "plugged in")
        reports = SensorModel(seed=1).reports([Rest((10.0, 5.0))], 0.2)
        on_reports([RawReport(round(report.t_arrive_s * 1e9), report.data) for report in reports])

    def request_enable(self) -> None:
        self.enabled += 1

    async def close(self) -> None:
        self.is_closed = True


def test_a_pad_is_enabled_read_after_a_reconnect_and_closed(capsys: pytest.CaptureFixture[str]) -> None:
    pad = ReconnectedPad()
    (trace,) = asyncio.run(prediction._touched(pad, 0.01))
    assert pad.enabled == 1
    assert pad.is_closed
    assert trace.xy_mm.mean(axis=0) == pytest.approx((10.0, 5.0), abs=0.2)
    assert capsys.readouterr().out.count("stroke the pad for 0.01 s") == 2
