"""The soaks in short, and that each reports what it is there to find."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from soak import endurance, worlds
from soak import harness as soak

from hapticd.errors import HapticdError


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


def test_a_dead_sensor_is_a_failure_with_its_code_and_its_run(monkeypatch: pytest.MonkeyPatch) -> None:
    world = worlds.draw(6, 4.0)
    dead = replace(world, plate=replace(world.plate, sensor=np.zeros((2, 2))))
    monkeypatch.setattr(endurance, "draw", lambda *_, **__: dead)
    with pytest.raises(HapticdError, match=r"run 0 \(2 modes, identity, 2 kHz\): fault [48] after [\d.]+ s, the "):
        endurance.run(0.001)


@pytest.mark.parametrize("what", ["voltage", "reference"])
@pytest.mark.parametrize("frac", [1.00001, float("nan")])
def test_a_limit_passed_and_a_board_that_leaves_live_are_failures(what: str, frac: float) -> None:
    trace = endurance.BoardTrace(100, 2, 2)
    trace.flags[:] = endurance.FLAG_LIVE
    figures = {"peak_voltage_frac": 1.0, "peak_reference_frac": 1.0}
    assert list(endurance._violations(figures, trace, 0, 2000.0)) == []
    trace.flags[60:] = 0
    left, passed = endurance._violations(figures | {f"peak_{what}_frac": frac}, trace, 0, 2000.0)
    assert left == "the board left LIVE after 0.030 s, without a fault."
    assert passed.startswith(f"a {what} was")
