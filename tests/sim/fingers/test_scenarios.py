"""The scenarios: what they promise of places and roles, held against the plate's true shapes."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.core.targets.virtual_paths import Walk
from hapticd.sim.fingers.scenarios import LAND_S, SCENARIOS, Actor

EDGE_MM = 68.75
FINGERTIP_MM = 8.0


def places_mm(actor: Actor, t_s: np.ndarray) -> np.ndarray:
    if actor.path is not None:
        return actor.path.position_mm(t_s)
    assert actor.virtual is not None
    walk = Walk(actor.virtual, 0)
    return np.array([walk.position_mm(round(t * 1e9)) for t in t_s.tolist()])


@pytest.mark.parametrize("name", SCENARIOS)
@pytest.mark.parametrize("seed", [1, 2])
def test_fingers_land_after_the_handshake_and_stay_on_the_plate(name: str, seed: int) -> None:
    t_s = np.arange(0.0, SCENARIOS[name].seconds, 0.02)
    for actor in SCENARIOS[name].build(seed, 100.0):
        places = places_mm(actor, t_s)
        assert np.isfinite(places).any()
        assert np.nanmax(np.abs(places)) <= EDGE_MM - FINGERTIP_MM
        assert (actor.path is None) != (actor.virtual is None)
        assert [*actor.steps_um] == sorted(actor.steps_um)
        if actor.path is not None:
            assert np.isnan(actor.path.position_mm(np.array([0.0, LAND_S - 1e-6]))).all()
            assert np.isfinite(actor.path.position_mm(np.array([LAND_S]))).all()
