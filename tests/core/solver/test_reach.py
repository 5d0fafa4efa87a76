"""Which frictions one finger can feel beside the others."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.core.friction import DEFAULT_FRICTION_CURVE
from hapticd.core.solver.instant import AskedPlace, InstantSolver
from hapticd.core.solver.reach import LEAST_CALLS, MOST_CALLS, TRIED, ReachSearch
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.sim.score import felt
from hapticd.values import WEBER_FRAC

PLATE = GroundTruth(PlateSettings.of("fingertip"))
MODES = PLATE.true_mode_map()
ALL_CALLS = LEAST_CALLS + TRIED * (MOST_CALLS - 2)
BEYOND = 0.1  # of friction, outside of an interval


def solver() -> InstantSolver:
    return InstantSolver(MODES, tuple(PLATE.w_limit_um), contact_radius_mm=5.0)


def reached(places: list[AskedPlace], calls: int = ALL_CALLS) -> tuple[float, float] | None:
    count = len(places)
    return ReachSearch(solver(), places, [1.0] * count, [0] * count).interval(calls)


def errors_jnd(places: list[AskedPlace]) -> np.ndarray:
    """By how much each finger misses its target, by the simulation's own integral."""
    one, modal_um = solver(), (0j,) * 4
    for _ in range(20):
        modal_um = one.solve(places, modal_um, 10**9).modal_um
    plate_um = np.zeros((1, len(PLATE.decay_1_s)), complex)
    plate_um[0, :4] = modal_um
    _, frictions = felt(np.array([[place[:2] for place in places]]), plate_um, PLATE.shapes)
    asked = np.array([DEFAULT_FRICTION_CURVE.friction(target_um) for _, _, target_um in places])
    return np.abs(frictions[0] / asked - 1.0) / WEBER_FRAC


def scenes(seed: int, fingers: int, count: int) -> list[list[AskedPlace]]:
    random = np.random.default_rng(seed)
    found: list[list[AskedPlace]] = []
    while len(found) < count:
        places_mm = random.uniform(-80.0, 80.0, (fingers, 2))
        gaps_mm = np.linalg.norm(places_mm[:, None] - places_mm, axis=2) + 100.0 * np.eye(fingers)
        if gaps_mm.min() > 15.0:
            targets_um = [*random.choice((0.0, 0.5, 1.0), fingers - 1).tolist(), 0.0]
            found.append([(x, y, um) for (x, y), um in zip(places_mm.tolist(), targets_um, strict=True)])
    return found


def asking(places: list[AskedPlace], friction_frac: float) -> list[AskedPlace]:
    x_mm, y_mm, _ = places[-1]
    return [*places[:-1], (x_mm, y_mm, DEFAULT_FRICTION_CURVE.amplitude_um(friction_frac))]


def test_a_finger_alone_reaches_bare_glass_and_what_its_place_allows() -> None:
    for places in scenes(1, 1, 5):
        low, high = reached(places)
        assert high == 1.0
        assert low < 0.3


@pytest.mark.parametrize("fingers", [2, 3])
def test_within_its_reach_a_finger_feels_its_target_and_outside_one_finger_not(fingers: int) -> None:
    inside, outside = [], []
    for places in scenes(fingers, fingers, 40):
        found = reached(places)
        if found is None:
            continue
        low, high = found
        alone = errors_jnd(places[:-1])
        allowed_jnd = np.array([*np.maximum(alone, 1.0), 1.0]) + 0.1  # two quadratures
        beyond = [one for one in (low - BEYOND, high + BEYOND) if 0.0 <= one <= 1.0]
        for where, frictions in ((inside, np.linspace(low, high, 5)), (outside, beyond)):
            where += [np.all(errors_jnd(asking(places, one)) <= allowed_jnd) for one in frictions]
    print(f"in reach and felt {np.mean(inside):.0%}, out of reach and felt {np.mean(outside):.0%}")
    assert np.mean(inside) >= 0.85
    assert np.mean(outside) <= 0.2  # the longest run of what is in reach: some of it may be beyond a gap


def test_with_little_time_it_promises_less_not_more() -> None:
    for places in scenes(2, 2, 4):
        quick, thorough = reached(places, LEAST_CALLS), reached(places)
        assert quick is None or thorough[0] - 0.1 <= quick[0] <= quick[1] <= thorough[1] + 0.1
