"""ModeShapes: single points and arrays are the same; positions and maps are validated."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.errors import ModesError

WAVE_RAD_MM = 2.0 * math.pi / 27.0


def waves(x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """Two plate waves, one along each axis, at points of any shape: (2, ...)."""
    return np.stack(
        (
            np.cos(WAVE_RAD_MM * x_mm + 0.4) * np.cos(0.02 * y_mm),
            np.cos(WAVE_RAD_MM * y_mm - 0.7) * np.cos(0.02 * x_mm),
        )
    )


@pytest.fixture(scope="module")
def modes() -> ModeShapes:
    axis_mm = np.linspace(-68.75, 68.75, 101)
    return ModeShapes.from_grid(axis_mm, axis_mm, waves(*np.meshgrid(axis_mm, axis_mm)))


def anywhere(count: int, reach_mm: float = 80.0) -> np.ndarray:
    return np.random.default_rng(count).uniform(-reach_mm, reach_mm, (count, 2))


def test_a_wave_is_interpolated_between_the_points_of_the_map(modes: ModeShapes) -> None:
    points = anywhere(5000, 68.75)

    error = modes.evaluate(points) - waves(points[:, 0], points[:, 1]).T

    # The spline's error on a wave is 5/384 (k h)^4 at most, and a few times that in the outer cells.
    assert np.abs(error[np.abs(points).max(axis=1) < 64.0]).max() < 5.0 / 384.0 * (WAVE_RAD_MM * 1.375) ** 4
    assert np.abs(error).max() < 1.5e-3


@given(st.floats(width=64), st.floats(width=64))
def test_shapes_and_slopes_are_finite_anywhere(modes: ModeShapes, x_mm: float, y_mm: float) -> None:
    assert np.isfinite(modes.evaluate([(x_mm, y_mm)])).all()
    assert np.isfinite(modes.gradient([(x_mm, y_mm)])).all()


def test_the_steepest_slope_bounds_all_others(modes: ModeShapes) -> None:
    slopes = np.hypot(*np.moveaxis(modes.gradient(anywhere(5000)), -1, 0))

    assert slopes.max() <= modes.steepest_1_mm() * 1.001
    assert modes.steepest_1_mm() == pytest.approx(WAVE_RAD_MM, rel=2e-3)


def test_values_are_kept_as_given_and_gaps_are_filled() -> None:
    axis_mm = 4.5 * np.arange(-15, 16)
    true = 3.0 * waves(*np.meshgrid(axis_mm, axis_mm))
    holed = true.copy()
    holed[0, 10, 12] = holed[1, 20, 20] = np.nan

    modes = ModeShapes.from_grid(axis_mm, axis_mm, holed)

    known = ~np.isnan(holed)
    np.testing.assert_array_equal(modes.shapes[known], true[known])
    np.testing.assert_allclose(modes.shapes, true, rtol=0.0, atol=0.05)


AXIS_MM = np.linspace(-10.0, 10.0, 6)
FLAT = np.ones((2, 6, 6))


def with_value(shapes: np.ndarray, where: tuple[object, ...], value: float) -> np.ndarray:
    changed = shapes.copy()
    changed[where] = value
    return changed


@pytest.mark.parametrize(
    ("x_mm", "y_mm", "shapes", "what"),
    [
        (AXIS_MM[:3], AXIS_MM, FLAT[:, :, :3], "at least 4"),
        (AXIS_MM[::-1], AXIS_MM, FLAT, "does not increase"),
        (AXIS_MM, with_value(AXIS_MM, (3,), math.nan), FLAT, "does not increase"),
        (with_value(AXIS_MM, (5,), math.inf), AXIS_MM, FLAT, "does not increase"),
        (AXIS_MM, AXIS_MM, FLAT[0], "order them as mode, y, x"),
        (AXIS_MM, AXIS_MM, FLAT[:0], "order them as mode, y, x"),
        (AXIS_MM, AXIS_MM, FLAT[:, :5], "order them as mode, y, x"),
        (AXIS_MM, AXIS_MM, with_value(FLAT, (1, 0, 0), -math.inf), "infinite"),
        (AXIS_MM, AXIS_MM, with_value(FLAT, (0, 2, 2), 1e308), "infinite or absurdly large"),
        (AXIS_MM * 1e-200, AXIS_MM, FLAT, "check that they are in mm"),
        (AXIS_MM, AXIS_MM * 1e6, FLAT, "check that they are in mm"),
        (AXIS_MM, AXIS_MM, with_value(FLAT, (1, slice(0, 2)), math.nan), "mode 2 has no value at 33 %"),
    ],
)
def test_an_invalid_map_is_refused_in_a_sentence(
    x_mm: np.ndarray, y_mm: np.ndarray, shapes: np.ndarray, what: str
) -> None:
    with pytest.raises(ModesError, match=rf"{what}.*\.$"):
        ModeShapes.from_grid(x_mm, y_mm, shapes)
