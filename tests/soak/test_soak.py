"""The soaks in short, and that each reports what it is there to find."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from soak import daemon as soak_daemon
from soak import endurance, walk, worlds
from soak import harness as soak
from soak.faults import KINDS, Kind
from soak.harness import ALL, Findings

from hapticd.errors import HapticdError


def judged(*found: Findings) -> soak.Table:
    return soak.judged(found, name="soak", title="made up", notes=())


def test_counts_are_summed_and_of_others_the_largest_the_first_or_the_last_stays() -> None:
    runs = [
        Findings({"one": {"runs_count": 1.0, "peak_um": peak_um, "leak_first_um": peak_um, "leak_last_um": peak_um}})
        for peak_um in (2.0, 3.0, 1.0)
    ]
    table = judged(*runs, Findings({"other": {"runs_count": 1.0, "peak_um": 9.0}}))
    assert dict(table.row("one").figures) == {
        "runs_count": 3,
        "peak_um": 3.0,
        "leak_first_um": 2.0,
        "leak_last_um": 1.0,
    }
    assert table.row(ALL).figures["runs_count"] == 4
    assert table.row(ALL).figures["peak_um"] == 9.0


def test_failures_are_an_error_with_their_sentences_and_the_figures() -> None:
    with pytest.raises(HapticdError, match=r"(?s)soak: 1 failures:\nrun 3: something\.\n.*peak"):
        judged(Findings({"one": {"peak_um": 1.0}}), Findings({}, ["run 3: something."]))


# --- the firmware ---


def dead(seed: int, seconds: float) -> worlds.World:
    world = worlds.draw(seed, seconds)
    return replace(world, plate=replace(world.plate, sensor=np.zeros((2, 2))))


def test_every_kind_of_board_is_driven_to_its_limits_without_a_failure() -> None:
    found = soak.added(endurance.play(seed, 2.0) for seed in range(len(worlds.KINDS)))
    assert len(found.rows) == len(worlds.KINDS)
    assert found.failures == []
    peaks = [max(row[name] for row in found.rows.values()) for name in ("peak_voltage_frac", "peak_measured_um")]
    assert peaks[0] == pytest.approx(1.0, abs=endurance.V_ROUNDING)
    assert peaks[1] > 0.5


def test_so_is_one_with_modes_300_hz_from_the_drive() -> None:
    found = soak.added(endurance.play(seed, 2.0, far=True) for seed in range(len(worlds.FAR_KINDS)))
    assert {*found.rows} == {f"{n} modes, far, {rate} kHz" for n in range(2, 9) for rate in (2, 5)}
    assert found.failures == []


def test_a_run_is_the_same_again() -> None:
    assert endurance.play(5, 1.0) == endurance.play(5, 1.0)


def test_a_dead_sensor_is_a_failure_with_its_code_and_its_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(endurance, "draw", lambda *_, **__: dead(6, 4.0))
    with pytest.raises(HapticdError, match=r"run 0 \(2 modes, identity, 2 kHz\): fault [48] after [\d.]+ s, the "):
        endurance.run(0.001)


@pytest.mark.parametrize("what", ["voltage", "reference"])
@pytest.mark.parametrize("frac", [1.00001, float("nan")])
def test_a_limit_passed_is_a_failure(what: str, frac: float) -> None:
    trace = endurance.BoardTrace(100, 2, 2)
    trace.flags[:] = endurance.FLAG_LIVE
    figures = {"peak_voltage_frac": 1.0, "peak_reference_frac": 1.0}
    assert list(endurance._violations(figures, trace, 0, 2000.0)) == []
    (said,) = endurance._violations(figures | {f"peak_{what}_frac": frac}, trace, 0, 2000.0)
    assert said.startswith(f"a {what} was")


def test_a_board_that_leaves_live_without_a_fault_is_a_failure() -> None:
    trace = endurance.BoardTrace(100, 2, 2)
    trace.flags[:60] = endurance.FLAG_LIVE
    figures = {"peak_voltage_frac": 1.0, "peak_reference_frac": 1.0}
    assert [*endurance._violations(figures, trace, 0, 2000.0)] == [
        "the board left LIVE after 0.030 s, without a fault."
    ]


# --- the daemon ---


@pytest.mark.long
def test_half_a_minute_of_faults_has_no_failure() -> None:
    found = soak_daemon.play(7)
    assert found.failures == []
    assert {*found.rows} == {ALL, *(kind.name for kind in KINDS)}  # each kind at least once
    figures = found.rows[ALL]
    assert figures["frames_count"] > 1000
    assert 1.0 < figures["peak_reference_um"] <= 4.0
    assert len({kind.name for kind in KINDS}) == len(KINDS)


def test_an_hour_has_two_thousand_faults() -> None:
    ends_s = soak_daemon.RUN_S - soak_daemon.LIFTED_S
    assert sum(len([*soak_daemon.drawn(np.random.default_rng(seed), 0.0, ends_s)]) for seed in range(120)) >= 2000


@pytest.mark.long
def test_an_undetected_fault_and_a_plate_that_still_moves_are_failures(monkeypatch: pytest.MonkeyPatch) -> None:
    nothing = Kind("nothing", (0.3, 0.4), 5.0, lambda *_: None, lambda _: 0.0)
    monkeypatch.setattr(soak_daemon, "KINDS", (nothing,))
    monkeypatch.setattr(soak_daemon, "RUN_S", 4.2)
    failures = soak_daemon.play(1).failures
    assert any("not detected" in sentence for sentence in failures)
    assert any("the plate still moved after 3" in sentence for sentence in failures)


def test_a_process_that_grows_is_a_failure() -> None:
    before = {"memory": 100.0, "files": 9.0, "threads": 1.0}
    assert soak_daemon.grown(before, {**before, "memory": 101.0}) == []
    assert soak_daemon.grown(before, {**before, "memory": 120.0}) == ["memory grew from 100 to 120."]
    assert soak_daemon.grown(before, {**before, "files": 10.0}) == ["files grew from 9 to 10."]


# --- the solver ---


def test_a_walk_over_the_edge_and_on_top_of_each_other_breaks_nothing() -> None:
    ways = np.array(walk.closed_ways(3, (220.0, 220.0)))
    assert ways.shape == (walk.AROUND_STEPS, 4, 3)
    assert np.abs(ways[:, :, :2]).max() > 110.0
    assert np.any(np.all(ways[:, 1, :2] == ways[:, 2, :2], axis=1))
    found = walk.walked(walk.Walk(seed=3, modes=5, steps=2 * walk.AROUND_STEPS))
    assert found.failures == []
    figures = found.rows["5 modes"]
    assert 0.5 < figures["peak_limit_frac"] <= 1.0
    assert 0.5 < figures["longest_step_um"] <= walk.MOST_STEP_UM
    assert figures["drift_jnd"] == 0.0  # once around after the first


def test_a_step_too_long_and_a_limit_passed_are_failures_with_their_walk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(walk, "MOST_STEP_UM", 0.1)
    monkeypatch.setattr(walk, "WALK_STEPS", 10)
    with pytest.raises(HapticdError, match=r"walk 0 on 2 modes, step 0: a step of [\d.]+ um is longer than the slew"):
        walk.run(1)
    walker = walk._Walker(walk.Walk(seed=0, modes=2, steps=200))
    walker._limits_um = tuple(limit_um / 2.0 for limit_um in walker._limits_um)
    assert any("beyond its limit" in sentence for step in range(200) for sentence in walker.step(step))
