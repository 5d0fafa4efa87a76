"""The firmware's endurance in short, and that it reports faults, broken limits and boards that leave LIVE."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from hapticd.bench import endurance, endurance_worlds
from hapticd.bench.endurance import Findings
from hapticd.errors import HapticdError


def dead(seed: int, seconds: float) -> endurance_worlds.World:
    world = endurance_worlds.draw(seed, seconds)
    return replace(world, plate=replace(world.plate, sensor=np.zeros((2, 2))))


def test_every_kind_of_board_is_driven_to_its_limits_without_a_failure() -> None:
    found = [endurance.play(seed, 2.0) for seed in range(len(endurance_worlds.KINDS))]
    assert len({kind for kind, _ in found}) == len(endurance_worlds.KINDS)
    whole = endurance.total(one for _, one in found)
    assert whole.failures == []
    assert whole.faults.total() == 0
    assert whole.virtual_s == pytest.approx(12.0)
    assert whole.peak_voltage_frac == pytest.approx(1.0, abs=endurance.V_ROUNDING)
    assert whole.peak_measured_um > 0.5


def test_so_is_one_with_modes_300_hz_from_the_drive() -> None:
    found = [endurance.play(seed, 2.0, far=True) for seed in range(len(endurance_worlds.FAR_KINDS))]
    assert {kind for kind, _ in found} == {f"{n} modes, far, {rate} kHz" for n in range(2, 9) for rate in (2, 5)}
    assert endurance.total(one for _, one in found).failures == []


def test_a_run_is_the_same_again() -> None:
    once, again = (replace(endurance.play(5, 1.0)[1], elapsed_s=0.0) for _ in range(2))
    assert once == again


def test_a_dead_sensor_is_counted_with_its_code_and_its_run() -> None:
    found = endurance.judge(dead(6, 4.0), 6)
    assert found.faults == Counter({4: 1})
    (failure,) = found.failures
    assert re.fullmatch(r"run 6 \(2 modes, identity, 2 kHz\): fault 4 after [\d.]+ s, the sensors do not .*\.", failure)


def test_a_board_that_leaves_live_without_a_fault_is_a_failure() -> None:
    trace = endurance.BoardTrace(100, 2, 2)
    trace.flags[:60] = endurance.FLAG_LIVE
    (sentence,) = endurance._violations(Findings(), trace, 0, 2000.0)
    assert sentence == "the board left LIVE after 0.030 s, without a fault."


@pytest.mark.parametrize(
    ("name", "sentence"),
    [("peak_voltage_frac", "a voltage was"), ("peak_reference_frac", "a reference was")],
)
@pytest.mark.parametrize("frac", [1.00001, float("nan")])
def test_a_limit_passed_is_a_failure(name: str, sentence: str, frac: float) -> None:
    trace = endurance.BoardTrace(100, 2, 2)
    trace.flags[:] = endurance.FLAG_LIVE
    assert list(endurance._violations(Findings(), trace, 0, 2000.0)) == []
    (said,) = endurance._violations(replace(Findings(), **{name: frac}), trace, 0, 2000.0)
    assert said.startswith(sentence)


def test_hours_become_runs_and_a_table_of_their_kinds(monkeypatch: pytest.MonkeyPatch) -> None:
    play = endurance.play
    monkeypatch.setattr(endurance, "play", lambda seed, far: play(seed, 0.1, far=far))
    table = endurance.run(12 * endurance_worlds.RUN_S / 3600.0)
    assert [row.name for row in table.rows][-1] == "all"
    assert [row.name for row in table.rows][-3:-1] == ["2 modes, far, 2 kHz", "2 modes, far, 5 kHz"]
    assert len(table.rows) == len(endurance_worlds.KINDS) + 2 + 1
    assert table.row("all").figures["runs_count"] == 12
    assert table.row("all").figures["faults_count"] == 0


def test_failures_are_an_error_that_names_their_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(endurance, "draw", lambda seed, *_, **__: dead(seed, 2.0))
    with pytest.raises(HapticdError, match=r"(?s)1 failures, faults by code \{4: 1\}.*\nrun 0 .*peak voltage"):
        endurance.run(0.001)


@pytest.mark.parametrize("hours", [0.0, -1.0, 1001.0, float("nan")])
def test_hours_out_of_bounds_are_one_sentence(hours: float) -> None:
    with pytest.raises(HapticdError, match=r"--hours: .* is out of bounds, it must be above 0 and at most 1000\."):
        endurance.run(hours)
