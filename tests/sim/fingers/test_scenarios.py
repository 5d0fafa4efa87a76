"""The scenarios: what they promise of places and roles, held against the plate's true shapes."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.core.targets.virtual_paths import Walk
from hapticd.sim.fingers.scenarios import (
    LAND_S,
    SCENARIOS,
    Actor,
)

EDGE_MM = 68.75
FINGERTIP_MM = 8.0


def places_mm(actor: Actor, t_s: np.ndarray) -> np.ndarray:
    if actor.path is not None:
        return actor.path.position_mm(t_s)
    assert actor.virtual is not None
    walk = Walk(actor.virtual, 0)
    return np.array([walk.position_mm(round(t * 1e9)) for t in t_s.tolist()])


def run_times_s(name: str) -> np.ndarray:
    return np.arange(0.0, SCENARIOS[name].seconds, 0.005)


@pytest.mark.parametrize("name", SCENARIOS)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_every_scenario_stays_on_the_plate_fingertips_and_all(name: str, seed: int) -> None:
    t_s = run_times_s(name)
    for actor in SCENARIOS[name].build(seed, 100.0):
        places = places_mm(actor, t_s)
        assert np.isfinite(places).any()
        assert np.nanmax(np.abs(places)) <= EDGE_MM - FINGERTIP_MM


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_finger_is_either_real_or_virtual_and_lands_after_the_handshake(name: str) -> None:
    for actor in SCENARIOS[name].build(1, 100.0):
        assert (actor.path is None) != (actor.virtual is None)
        assert len(actor.steps_um) >= 1
        assert [start for start, _ in actor.steps_um] == sorted(start for start, _ in actor.steps_um)
        if actor.path is not None:
            before_s = np.array([0.0, LAND_S - 1e-6])
            assert np.isnan(actor.path.position_mm(before_s)).all()
            assert np.isfinite(actor.path.position_mm(np.array([LAND_S]))).all()
