"""The scenarios: what they promise of places and roles, held against the plate's true shapes."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from hapticd.core.targets.virtual_paths import Walk
from hapticd.sim.fingers.scenarios import (
    LAND_S,
    SCENARIOS,
    Actor,
)
from hapticd.sim.plate.ground_truth import GroundTruth

EDGE_MM = 68.75
FINGERTIP_MM = 8.0
W_LIM_UM = 4.0
MIXED = {"one-of-three": (1, 3), "two-of-three": (2, 3), "two-of-four": (2, 4), "two-of-five": (2, 5)}


def places_mm(actor: Actor, t_s: np.ndarray) -> np.ndarray:
    if actor.path is not None:
        return actor.path.position_mm(t_s)
    assert actor.virtual is not None
    walk = Walk(actor.virtual, 0)
    return np.array([walk.position_mm(round(t * 1e9)) for t in t_s.tolist()])


def run_times_s(name: str) -> np.ndarray:
    return np.arange(0.0, SCENARIOS[name].seconds, 0.005)


def both_mm(name: str, seed: int = 1) -> np.ndarray:
    """Where both fingers are, (T, 2, 2), while both are there."""
    t_s = run_times_s(name)
    places = np.stack([places_mm(actor, t_s) for actor in SCENARIOS[name].build(seed, 100.0)], axis=1)
    return places[np.isfinite(places).all(axis=(1, 2))]


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


@pytest.mark.parametrize("name", MIXED)
def test_more_fingers_have_mixed_targets_and_never_touch_each_other(name: str) -> None:
    slippery, fingers = MIXED[name]
    for seed in (1, 2, 3):
        actors = SCENARIOS[name].build(seed, 100.0)
        assert [actor.target_at_um(LAND_S) for actor in actors] == [1.0] * slippery + [0.0] * (fingers - slippery)
        places = both_mm(name, seed)
        for one, other in combinations(range(fingers), 2):
            assert np.hypot(*(places[:, one] - places[:, other]).T).min() > 20.0


# --- the paper's figures ------------------------------------------------------------------------------------------


def needed_um(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The paper's W (T, 2) for 1 um at the first finger and 0 at the second, and the determinants (T,)."""
    phi = GroundTruth().shapes(places)[..., :2]
    determinant = np.linalg.det(phi)
    return np.stack((phi[:, 1, 1], -phi[:, 1, 0]), axis=1) / determinant[:, None], determinant


def test_figure_11_passes_singular_positions_and_is_limited_for_a_quarter_of_the_time() -> None:
    modal_um, determinant = needed_um(both_mm("paper-figure-11"))

    assert np.count_nonzero(np.diff(np.sign(determinant))) == 14  # seven there and seven back
    assert 0.2 < np.mean(np.abs(modal_um).max(axis=1) > W_LIM_UM) < 0.35
