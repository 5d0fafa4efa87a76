"""The first touch after a standby, with the firmware's own code and the plate in virtual time."""

from __future__ import annotations

import pytest
from faulty_simulation import FaultySimulation

from hapticd.daemon import board_gateway as board_gateway
from hapticd.sim.fingers.paths import Rest, Touch
from hapticd.sim.fingers.scenarios import Actor
from hapticd.sim.settings import Settings

LAND_S, END_S = 3.5, 3.7
PLACES = (((-30.2, 5.1), 1.0), ((21.3, -14.9), 0.0))
NEVER_NS = 10**15


def played() -> tuple[bool, int, float]:
    """Whether the board was on standby when fingers came, its trips, and when the plate had half of its amplitude."""
    actors = tuple(Actor(((LAND_S, amplitude_um),), path=Touch(Rest(p), LAND_S)) for p, amplitude_um in PLACES)
    simulation = FaultySimulation(actors, Settings(), 1)
    standby: list[bool] = []
    simulation.at(LAND_S - 0.01, lambda _: standby.append(simulation.machine.session.is_on_standby))
    simulation.run(END_S)
    t_s, level_um = simulation.level_um()
    status = simulation.machine.session.status
    assert status is not None
    return standby[0], status.deadman_trips, float(t_s[level_um > 0.5 * level_um.max()][0])


def test_a_board_on_standby_is_armed_in_time_for_the_first_touch(monkeypatch: pytest.MonkeyPatch) -> None:
    standby, trips, half_s = played()
    monkeypatch.setattr(board_gateway, "STANDBY_AFTER_NS", NEVER_NS)
    awake, awake_trips, awake_half_s = played()
    assert (standby, awake) == (True, False)
    assert trips == awake_trips == 0
    assert half_s - awake_half_s <= 0.0005, (half_s, awake_half_s)  # a control tick
