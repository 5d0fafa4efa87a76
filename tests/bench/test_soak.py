"""The soak in short, and that it reports faults that are missed, motion that goes on and resources that grow."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.bench import soak, soak_calibrating, soak_checks, soak_faults
from hapticd.bench.soak_checks import Findings
from hapticd.bench.soak_faults import KINDS, Kind, Watch
from hapticd.core.trajectory.gate import gate
from hapticd.errors import HapticdError
from hapticd.sim.faulty import FaultySimulation
from hapticd.sim.lockstep import Settings
from hapticd.tools import touch_process
from hapticd.values import Drive, Knot
from hapticd.wire import device

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def findings() -> Findings:
    found = Findings()
    soak.play(found, 7)
    return found


def test_half_a_minute_of_faults_has_no_failure(findings: Findings) -> None:
    assert findings.failures == []
    assert findings.faults.total() >= len(KINDS)  # each kind at least once
    assert set(findings.faults) == {kind.name for kind in KINDS}
    assert findings.frames > 1000
    assert 1.0 < findings.peak_reference_um <= 4.0


def test_an_hour_has_two_thousand_faults() -> None:
    drawn = [len(list(soak_checks.drawn(np.random.default_rng(seed), 0.0, soak.LIFT_S))) for seed in range(120)]
    assert sum(drawn) >= 2000


def test_an_undetected_fault_and_a_plate_that_still_moves_are_failures(monkeypatch: pytest.MonkeyPatch) -> None:
    nothing = Kind("nothing", (0.3, 0.4), 5.0, lambda *_: None, lambda _: 0.0)
    monkeypatch.setattr(soak_checks, "KINDS", (nothing,))
    monkeypatch.setattr(soak, "RUN_S", 4.0)
    monkeypatch.setattr(soak, "LIFT_S", 3.0)
    monkeypatch.setattr(soak, "AT_REST_S", 3.4)
    found = Findings()
    soak.play(found, 1)
    assert any("not detected" in sentence for sentence in found.failures)
    assert any("the plate still moved after 3" in sentence for sentence in found.failures)


def test_the_largest_amplitude_of_every_frame_counts() -> None:
    watch = Watch(FaultySimulation((), Settings(), 1))
    drive = gate(Drive(0, (Knot(0, (1.0, -0.5)), Knot(8_000_000, (0.25 + 2.0j, -3.5)))), (4.0, 4.0))
    frame = device.encode_reference(1, drive, 1000)
    assert list(watch._to_board(0, frame)) == [(0, frame)]
    assert watch.references.frames == 1
    assert watch.references.peak_um == pytest.approx(3.5, rel=1e-6)


def test_a_soak_s_figures_are_a_table(monkeypatch: pytest.MonkeyPatch) -> None:
    def play(found: Findings, seed: int) -> None:
        found.virtual_s += 30.0
        found.faults["trackpad silent"] += 1
        found.latest_quiet_ms["trackpad silent"] = float(seed % 10)
        if seed == 3_000_002:
            found.failures.append("run 3000002: something.")

    monkeypatch.setattr(soak, "play", play)
    monkeypatch.setattr(soak, "_resources", lambda: {"memory_mb": 100.0, "files": 9.0, "threads": 1.0})
    (table,) = soak.run(0.1, seed=1)
    assert dict(table.row("trackpad silent").figures) == {"faults_count": 12.0, "quiet_after_ms": 2.0}
    assert table.row("all").figures["faults_count"] == 12.0
    with pytest.raises(HapticdError, match=r"soak: 1 failures:\nrun 3000002: something\."):
        soak.run(0.1, seed=3)


def test_a_process_that_grows_is_a_failure() -> None:
    before = {"memory_mb": 100.0, "files": 9.0, "threads": 1.0}
    assert soak._grown(before, {**before, "memory_mb": 101.0}) == []
    assert soak._grown(before, {**before, "memory_mb": 120.0}) == ["memory_mb grew from 100 to 120."]
    assert soak._grown(before, {**before, "files": 10.0}) == ["files grew from 9 to 10."]


@pytest.mark.parametrize("hours", [0.0, -1.0, 25.0, float("nan")])
def test_hours_out_of_bounds_are_one_sentence(hours: float) -> None:
    with pytest.raises(HapticdError, match=r"--hours: .* is out of bounds, it must be above 0 and at most 24"):
        soak.run(hours)


def test_no_two_kinds_have_the_same_name() -> None:
    assert len({kind.name for kind in soak_faults.KINDS}) == len(KINDS)


def test_a_daemon_that_calibrates_itself_keeps_to_the_limits_amid_faults(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(soak_calibrating, "SPAN_S", 6.0)
    monkeypatch.setattr(soak_calibrating, "PAUSE_S", 0.5)
    monkeypatch.setattr(touch_process, "FIT_S", 5.0)
    (table,) = soak.run(18.0 / 3600.0, is_calibrating=True)
    figures = table.row("all").figures
    assert figures["faults_count"] > 4
    assert figures["pads_count"] > 0
    assert 0.0 < figures["peak_adopting_step_um"] <= soak_calibrating.STEP_FACTOR * figures["peak_step_um"]
    assert 0.0 < figures["leak_last_um"] <= figures["leak_most_um"] < 0.5


def test_a_larger_step_while_something_is_adopted_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(soak_calibrating, "SPAN_S", 4.0)
    found = Findings(peak_adopting_step_um=50.0)
    soak_calibrating.play(found, 1, 0.001)
    assert [sentence for sentence in found.failures if "while adopting" in sentence]
