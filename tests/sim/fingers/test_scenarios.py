"""The scenarios: what they promise of places and roles, held against the plate's true shapes."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations, pairwise

import numpy as np
import pytest

from hapticd.core.targets.virtual_paths import Walk
from hapticd.sim.fingers.scenarios import (
    LAND_AGAIN_S,
    LAND_S,
    LIFT_S,
    SCENARIOS,
    STEP_POINT_MM,
    STEP_S,
    STEP_TARGET_UM,
    SWAP_S,
    Actor,
)
from hapticd.sim.plate.ground_truth import GroundTruth
from hapticd_contract.surfaces import VirtualPath

EDGE_MM = 68.75
FINGERTIP_MM = 8.0
W_LIM_UM = 4.0
MIXED = {"one-of-three": (1, 3), "two-of-three": (2, 3), "two-of-four": (2, 4), "two-of-five": (2, 5)}
TWO_FINGERS = sorted(set(SCENARIOS) - {"step", "hands", "three", *MIXED})


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
@pytest.mark.parametrize("speed_mm_s", [20.0, 250.0])
def test_every_scenario_can_be_played_slower_and_faster(name: str, speed_mm_s: float) -> None:
    for actor in SCENARIOS[name].build(1, speed_mm_s):
        speeds = np.hypot(*np.diff(places_mm(actor, run_times_s(name)), axis=0).T) / 0.005
        assert np.nanmax(speeds) <= 1.1 * speed_mm_s + 45.0  # the virtual finger's own speed is 40 mm/s


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


@pytest.mark.parametrize("name", sorted(set(TWO_FINGERS) - {"both-slip"}))
def test_the_first_finger_slips_and_the_second_sticks(name: str) -> None:
    slippery, sticky = SCENARIOS[name].build(1, 100.0)

    assert slippery.target_at_um(LAND_S) == 1.0
    assert sticky.target_at_um(LAND_S) == 0.0
    last_s = SCENARIOS[name].seconds
    assert slippery.target_at_um(last_s) == (0.0 if name == "swap" else 1.0)
    assert sticky.target_at_um(last_s) == (1.0 if name == "swap" else 0.0)


@pytest.mark.parametrize("name", MIXED)
def test_more_fingers_have_mixed_targets_and_never_touch_each_other(name: str) -> None:
    slippery, fingers = MIXED[name]
    for seed in (1, 2, 3):
        actors = SCENARIOS[name].build(seed, 100.0)
        assert [actor.target_at_um(LAND_S) for actor in actors] == [1.0] * slippery + [0.0] * (fingers - slippery)
        places = both_mm(name, seed)
        for one, other in combinations(range(fingers), 2):
            assert np.hypot(*(places[:, one] - places[:, other]).T).min() > 20.0


@pytest.mark.parametrize("seed", range(1, 11))
def test_by_position_the_left_finger_of_strokes_is_the_slippery_one(seed: int) -> None:
    slippery, sticky = SCENARIOS["strokes"].build(seed, 100.0)
    landing_s = np.array([LAND_S])

    assert places_mm(slippery, landing_s)[0, 0] < places_mm(sticky, landing_s)[0, 0]


def test_a_want_holds_from_its_instant_and_there_is_none_before() -> None:
    actor = Actor(((1.0, 0.5), (2.0, 0.0)), virtual=VirtualPath(((0.0, 0.0),), 0.0, loop=False))
    t_s = np.array([0.0, 0.999, 1.0, 1.5, 2.0, 9.0])

    np.testing.assert_array_equal(actor.target_um(t_s), [np.nan, np.nan, 0.5, 0.5, 0.0, 0.0])
    assert [actor.target_at_um(t) for t in t_s.tolist()] == [None, None, 0.5, 0.5, 0.0, 0.0]


@pytest.mark.parametrize(("name", "differs"), [("strokes", True), ("circles", True), ("rest", True), ("swap", False)])
def test_a_seed_makes_its_own_fingers_and_always_the_same(name: str, differs: bool) -> None:
    build: Callable[[int, float], tuple[Actor, ...]] = SCENARIOS[name].build
    t_s = np.array([2.0])
    one, again, other = (np.stack([places_mm(actor, t_s) for actor in build(seed, 100.0)]) for seed in (1, 1, 2))

    np.testing.assert_array_equal(one, again)
    assert (not np.array_equal(one, other)) is differs


@pytest.mark.parametrize("name", ["strokes", "circles", "rest", "swap"])
def test_two_real_fingers_are_never_in_the_same_place(name: str) -> None:
    for seed in (1, 2, 3):
        places = both_mm(name, seed)
        assert np.hypot(*(places[:, 0] - places[:, 1]).T).min() > 8.0


def test_swap_crosses_lifts_lands_again_and_changes_the_roles() -> None:
    over, under = SCENARIOS["swap"].build(1, 100.0)
    places = both_mm("swap")
    sides = np.sign(places[:, 0, 0] - places[:, 1, 0])
    assert sum(a != b for a, b in pairwise(sides[sides != 0])) >= 4
    assert np.hypot(*(places[:, 0] - places[:, 1]).T).min() == pytest.approx(18.0, abs=0.1)

    t_s = run_times_s("swap")
    lifted = np.isnan(places_mm(under, t_s)[:, 0])
    np.testing.assert_array_equal(lifted[t_s >= LAND_S], ((t_s >= LIFT_S) & (t_s < LAND_AGAIN_S))[t_s >= LAND_S])
    for actor in (over, under):
        before, after = actor.target_at_um(SWAP_S - 1e-6), actor.target_at_um(SWAP_S)
        assert {before, after} == {0.0, 1.0}


# --- the paper's figures ------------------------------------------------------------------------------------------


def needed_um(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The paper's W (T, 2) for 1 um at the first finger and 0 at the second, and the determinants (T,)."""
    phi = GroundTruth().shapes(places)[..., :2]
    determinant = np.linalg.det(phi)
    return np.stack((phi[:, 1, 1], -phi[:, 1, 0]), axis=1) / determinant[:, None], determinant


def test_figure_10_keeps_clear_of_singular_positions_and_both_modes_swing() -> None:
    modal_um, determinant = needed_um(both_mm("paper-figure-10"))

    assert np.abs(modal_um).max() < 0.85 * W_LIM_UM
    assert (np.sign(determinant) == np.sign(determinant[0])).all()
    assert np.ptp(modal_um, axis=0).min() > 4.0


def test_figure_11_passes_singular_positions_and_is_limited_for_a_quarter_of_the_time() -> None:
    modal_um, determinant = needed_um(both_mm("paper-figure-11"))

    assert np.count_nonzero(np.diff(np.sign(determinant))) == 14  # seven there and seven back
    assert 0.2 < np.mean(np.abs(modal_um).max(axis=1) > W_LIM_UM) < 0.35


def test_the_step_is_on_an_antinode_of_x_and_a_node_of_y() -> None:
    truth = GroundTruth()
    x, y = truth.shapes(np.array(STEP_POINT_MM))[:2]
    h_mm = 0.1
    around = np.array(STEP_POINT_MM) + h_mm * np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])
    slopes = np.array([truth.shapes(around[i])[0] - truth.shapes(around[i + 1])[0] for i in (0, 2)]) / (2 * h_mm)

    assert abs(y) < 1e-6
    assert x == pytest.approx(STEP_TARGET_UM, abs=2e-3)  # so that W_X steps to 1 um
    assert np.abs(slopes).max() < 0.002  # per mm; the steepest is about 0.12
    node_line = np.stack((np.linspace(-55.0, 55.0, 2201), np.zeros(2201)), axis=1)
    assert np.abs(truth.shapes(node_line)[:, 1]).max() < 1e-6
    assert np.abs(truth.shapes(node_line)[:, 0]).max() == pytest.approx(abs(x), abs=1e-3)


def test_the_step_goes_from_nothing_to_its_target() -> None:
    (actor,) = SCENARIOS["step"].build(1, 100.0)

    assert actor.virtual is not None
    assert actor.virtual.path_mm == (STEP_POINT_MM,)
    assert actor.target_at_um(STEP_S - 1e-6) == 0.0
    assert actor.target_at_um(STEP_S) == STEP_TARGET_UM
