"""Achievability maps against the solver itself."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.core.solver.public import solve
from hapticd.design.achievability import MapFinger, achievable_share, reach_um
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings

PAIR = GroundTruth(PlateSettings()).measured_mode_map(1)
OUT_OF_REACH_UM = 1e6
DESCENT_FRAC = 0.03  # of its reach that a finger among still ones may lack on more modes than they fix
EXACT_UM = 1e-6


def shapes_of(modes: int) -> ModeShapes:
    """The pair, and of it turned by a quarter and products of sines as many more: any map that varies would do."""
    if modes <= 2:
        return ModeShapes.from_grid(PAIR.x_mm, PAIR.y_mm, PAIR.shapes[:modes])
    x, y = np.meshgrid(PAIR.x_mm / 137.5, PAIR.y_mm / 137.5)
    more = [np.sin((9 + k) * x + 0.3) * np.cos((8 - k) * y - 0.2 * k) for k in range(modes - 2)]
    return ModeShapes.from_grid(PAIR.x_mm, PAIR.y_mm, np.stack([*PAIR.shapes, *more]))


def random_points_mm(seed: int, many: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-65.0, 65.0, (many, 2))


@pytest.mark.parametrize("modes", [1, 2, 3, 4])
@pytest.mark.parametrize("still", [0, 1, 2, 3])
def test_the_reach_is_the_solver_s_amplitude_for_a_target_out_of_reach(modes: int, still: int) -> None:
    points_mm = random_points_mm(modes + 10 * still, 60 * (still + 1))
    phi = shapes_of(modes).evaluate(points_mm).reshape(60, still + 1, modes)
    limits = np.linspace(4.0, 3.0, modes)
    targets = [OUT_OF_REACH_UM] + [0.0] * still
    solved = [solve(one, targets, limits).achieved_um[0] for one in phi]
    most = reach_um(phi[:, 0], phi[:, 1:], limits)
    assert np.all(np.array(solved) <= most + EXACT_UM)
    assert np.all(np.array(solved) >= (1.0 - DESCENT_FRAC) * most - EXACT_UM)
    if still == 0 or modes <= still + 1:  # no direction is left to the descent
        assert most == pytest.approx(solved, abs=EXACT_UM)


@pytest.mark.parametrize("modes", [1, 2, 3])
@pytest.mark.parametrize(
    "targets", [(1.0, 0.0), (0.0, 1.0), (1.0, 0.5), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (1.0, 0.7, 0.0)], ids=str
)
def test_the_share_of_each_place_agrees_with_the_solver(modes: int, targets: tuple[float, ...]) -> None:
    shapes, limits = shapes_of(modes), (4.0,) * modes
    fingers = [MapFinger(x, y, um) for (x, y), um in zip([(-30.0, 21.0), (12.0, -33.0)], targets[:-1], strict=False)]
    slips, points_mm = np.array(targets) > 0.0, random_points_mm(3, 81)
    for place, share in zip(points_mm, achievable_share(shapes, fingers, targets[-1], limits, points_mm), strict=True):
        solved = solve(shapes.evaluate([*(finger[:2] for finger in fingers), place]), targets, limits).achieved_um
        assert share == pytest.approx(np.minimum(solved[slips] / np.array(targets)[slips], 1.0).min(), abs=EXACT_UM)
