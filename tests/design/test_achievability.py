"""Achievability maps against the solver itself."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.core.solver.public import solve
from hapticd.design.achievability import MapFinger, achievability_map, achievable_share, pair_map, reach_um
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings

from .reference_plate import grid_points

PAIR = GroundTruth(PlateSettings()).measured_mode_map(1)
SIZE_MM = (137.5, 137.5)
OUT_OF_REACH_UM = 1e6
DESCENT_FRAC = 0.03  # of its reach that a finger among still ones may lack on more modes than they fix
EXACT_UM = 1e-7


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
def test_each_cell_agrees_with_the_solver(modes: int, targets: tuple[float, ...]) -> None:
    shapes, limits = shapes_of(modes), (4.0,) * modes
    fingers = [MapFinger(x, y, um) for (x, y), um in zip([(-30.0, 21.0), (12.0, -33.0)], targets[:-1], strict=False)]
    made = achievability_map(shapes, fingers, targets[-1], limits, size_mm=SIZE_MM, cells=9)
    slips = np.array(targets) > 0.0
    for row, y_mm in enumerate(made.y_mm):
        for column, x_mm in enumerate(made.x_mm):
            phi = shapes.evaluate([*(finger[:2] for finger in fingers), (x_mm, y_mm)])
            solved = solve(phi, targets, limits).achieved_um
            assert made.achieved_um[:, row, column] == pytest.approx(solved, abs=EXACT_UM)
            expected = np.minimum(solved[slips] / np.array(targets)[slips], 1.0).min()
            assert made.share[row, column] == pytest.approx(expected, abs=EXACT_UM)
    alone = achievable_share(shapes, fingers, targets[-1], limits, grid_points(made.x_mm, made.y_mm))
    assert alone == pytest.approx(made.share.ravel(), abs=EXACT_UM)


@pytest.mark.parametrize("modes", [1, 2, 3])
def test_a_places_worth_is_the_part_of_the_plate_that_its_map_leaves_to_the_other(modes: int) -> None:
    shapes, limits = shapes_of(modes), (4.0, 3.0, 2.0)[:modes]
    pairs = pair_map(shapes, 0.8, limits, size_mm=SIZE_MM, cells=9)
    for row, column in ((0, 0), (4, 4), (2, 7)):
        place = (float(pairs.x_mm[column]), float(pairs.y_mm[row]))
        for part, here_um, other_um in ((pairs.slipping, 0.8, 0.0), (pairs.still, 0.0, 0.8)):
            made = achievability_map(shapes, [MapFinger(*place, here_um)], other_um, limits, size_mm=SIZE_MM, cells=9)
            assert part[row, column] == pytest.approx(made.served_frac(1.0))
    assert pairs.slipping.mean() == pytest.approx(pairs.still.mean())
