"""The guide leads both fingers through all quarters, and never both to one."""

from __future__ import annotations

import numpy as np

from hapticd.design.touch.guide import EACH_S, GUIDED_S, places_at
from hapticd.sim.fingers.guided import APART_MM, HALF_SIZE_MM
from hapticd.sim.fingers.scenarios import LAND_S, SCENARIOS


def test_each_finger_meets_all_quarters_and_the_other_is_opposite() -> None:
    steps = [places_at((step + 0.5) * EACH_S) for step in range(round(GUIDED_S / EACH_S))]
    assert len({one.first for one in steps}) == len({one.second for one in steps}) == 4
    for one in steps:
        assert one.second == (-one.first[0], -one.first[1])
    assert places_at(GUIDED_S + 1.0) == steps[-1]


def test_simulated_fingers_follow_it_apart_from_each_other() -> None:
    assert SCENARIOS["guided"].seconds == GUIDED_S
    t_s = np.arange(LAND_S, LAND_S + GUIDED_S, 0.01)
    first, second = (actor.path.position_mm(t_s) for actor in SCENARIOS["guided"].build(3, 100.0) if actor.path)
    assert np.abs(np.concatenate((first, second))).max() < 58.0
    assert np.mean(np.hypot(*(first - second).T) < 15.0) < 0.03  # where quarters overlap they pass each other
    settled = np.nonzero((t_s - LAND_S) % EACH_S > 1.0)[0]
    for index in settled[::50]:
        places = places_at(float(t_s[index] - LAND_S))
        assert np.abs(first[index] - APART_MM * np.array(places.first)).max() < HALF_SIZE_MM + 1.0
