"""Gram matrices of contact discs: against closed forms, against another quadrature, and at the plate's edge."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.core.plate.contact_gram import ContactGram, disc_gram
from hapticd.core.plate.mode_shapes import ModeShapes

pytestmark = pytest.mark.long

HALF_MM = 68.75
WAVE_RAD_MM = 2.0 * math.pi / 27.0
RADIUS_MM = 5.0


def map_of(*shapes: object) -> ModeShapes:
    axis_mm = np.linspace(-HALF_MM, HALF_MM, 101)
    x, y = np.meshgrid(axis_mm, axis_mm)
    return ModeShapes.from_grid(axis_mm, axis_mm, np.stack([shape(x, y) for shape in shapes]))  # type: ignore[operator]


def even(x: np.ndarray, _: np.ndarray) -> np.ndarray:
    return np.ones_like(x)


def x_wave(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.cos(WAVE_RAD_MM * x + 0.4) * np.cos(0.02 * y)


def y_wave(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.cos(WAVE_RAD_MM * y - 0.7) * np.cos(0.02 * x)


def slant_wave(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.sin(WAVE_RAD_MM * (x + y) / math.sqrt(2.0))


@pytest.fixture(scope="module")
def modes() -> ModeShapes:
    return map_of(x_wave, y_wave)


@pytest.fixture(scope="module")
def contact(modes: ModeShapes) -> ContactGram:
    return ContactGram(modes, RADIUS_MM)


def anywhere(count: int, reach_mm: float) -> np.ndarray:
    return np.random.default_rng(count).uniform(-reach_mm, reach_mm, (count, 2))


def by_counting(modes: ModeShapes, point: np.ndarray, radius_mm: float) -> np.ndarray:
    """The mean over a lattice's points on the disc and the plate: slow, coarse (1e-3), and nothing to get wrong."""
    offset = (np.arange(401) + 0.5) / 401.0 * 2.0 * radius_mm - radius_mm
    lattice = point + np.stack(np.meshgrid(offset, offset), axis=-1).reshape(-1, 2)
    covered = (np.hypot(*(lattice - point).T) <= radius_mm) & modes.inside(lattice)
    phi = modes.evaluate(lattice[covered])
    return phi.T @ phi / len(phi)


def test_the_disc_s_mean_is_what_geometry_says() -> None:
    gram = disc_gram(map_of(even, lambda x, y: x - 0.5 * y), [[7.0, -4.0]], RADIUS_MM)[0]

    square = 9.0**2 + (1.0 + 0.25) * RADIUS_MM**2 / 4.0  # variance of x over a disc: r^2 / 4
    np.testing.assert_allclose(gram, [[1.0, 9.0], [9.0, square]], rtol=1e-9)


def test_half_a_disc_counts_at_an_edge_and_a_quarter_in_a_corner() -> None:
    modes = map_of(even, lambda x, _: HALF_MM - x)
    centroid_mm = 4.0 * RADIUS_MM / (3.0 * math.pi)  # of half a disc from its straight side

    for point in ([HALF_MM, 10.0], [HALF_MM, -HALF_MM], [200.0, 10.0]):
        gram = disc_gram(modes, [point], RADIUS_MM)[0]
        np.testing.assert_allclose(gram, [[1.0, centroid_mm], [centroid_mm, RADIUS_MM**2 / 4.0]], rtol=1e-8)


@pytest.mark.parametrize("point", [(3.0, -8.0), (66.0, 20.0), (-67.5, 66.5), (0.0, -68.75)])
def test_the_quadrature_agrees_with_counting_points(modes: ModeShapes, point: tuple[float, float]) -> None:
    counted = by_counting(modes, np.array(point), RADIUS_MM)

    np.testing.assert_allclose(disc_gram(modes, [point], RADIUS_MM)[0], counted, rtol=0.0, atol=2e-3)


def test_twice_the_nodes_change_nothing(modes: ModeShapes) -> None:
    points = anywhere(400, HALF_MM)

    few, many = (disc_gram(modes, points, RADIUS_MM, nodes) for nodes in (10, 20))

    np.testing.assert_allclose(few, many, rtol=0.0, atol=2e-5)


def test_the_maps_meet_the_quadrature_between_their_knots(modes: ModeShapes, contact: ContactGram) -> None:
    points = anywhere(1000, HALF_MM)
    error = np.abs(contact.evaluate(points) - disc_gram(modes, points, RADIUS_MM)).max(axis=(1, 2))

    clear = np.abs(points).max(axis=1) < HALF_MM - 2.0 * RADIUS_MM
    assert error[clear].max() < 5e-4
    assert error.max() < 1e-2  # where the edge begins to cut the disc its mean has a kink in the second derivative


def test_a_small_disc_is_a_point(modes: ModeShapes) -> None:
    points = anywhere(50, 60.0)
    phi = modes.evaluate(points)

    np.testing.assert_allclose(disc_gram(modes, points, 1e-3), phi[:, :, None] * phi[:, None, :], rtol=0.0, atol=1e-6)


@settings(deadline=None, max_examples=200)
@given(st.floats(width=64), st.floats(width=64))
def test_no_vibration_is_ever_negative_and_one_point_agrees_with_many(
    contact: ContactGram, x_mm: float, y_mm: float
) -> None:
    gram = np.array(contact.at(x_mm, y_mm))

    assert np.isfinite(gram).all()
    assert (np.linalg.eigvalsh(gram) >= -1e-15).all()
    np.testing.assert_array_equal(gram, gram.T)
    np.testing.assert_allclose(contact.evaluate([[x_mm, y_mm]])[0], gram, rtol=1e-13, atol=1e-15)
    if math.isnan(x_mm) or math.isnan(y_mm):
        np.testing.assert_array_equal(gram, np.zeros((2, 2)))


@pytest.mark.parametrize("count", [1, 3])
def test_any_number_of_modes_has_its_maps(count: int) -> None:
    modes = map_of(*(x_wave, y_wave, slant_wave)[:count])
    contact = ContactGram(modes, 3.0)
    points = anywhere(40, 55.0)

    np.testing.assert_allclose(contact.evaluate(points), disc_gram(modes, points, 3.0), rtol=0.0, atol=2e-3)
    np.testing.assert_allclose(
        [contact.at(x, y) for x, y in points.tolist()], contact.evaluate(points), rtol=1e-12, atol=1e-15
    )
    assert contact.evaluate(np.empty((0, 2))).shape == (0, count, count)


def test_positions_that_no_finger_has_are_held_at_the_edge_or_silent(modes: ModeShapes) -> None:
    points = [[math.inf, 3.0], [1e300, 3.0], [HALF_MM, 3.0], [math.nan, 3.0], [3.0, math.nan]]

    far, huge, edge, *unknown = disc_gram(modes, points, RADIUS_MM)

    np.testing.assert_array_equal(far, edge)
    np.testing.assert_array_equal(huge, edge)
    np.testing.assert_array_equal(unknown, np.zeros((2, 2, 2)))


@settings(deadline=None, max_examples=50)
@given(st.floats(1e-6, 1e6))
def test_a_disc_of_any_size_has_the_mean_of_its_part_of_the_plate(modes: ModeShapes, radius_mm: float) -> None:
    gram = disc_gram(modes, [[10.0, -66.0]], radius_mm)[0]

    assert np.isfinite(gram).all()
    assert (np.linalg.eigvalsh(gram) >= -1e-12).all()
    assert np.trace(gram) <= np.square(modes.shapes).max(axis=(1, 2)).sum() + 1e-9


def test_points_of_another_form_are_refused(modes: ModeShapes) -> None:
    with pytest.raises(ValueError, match=r"\(N, 2\)"):
        disc_gram(modes, [1.0, 2.0], RADIUS_MM)


@pytest.mark.parametrize("radius_mm", [0.0, -1.0, 5e-324, 1e300, math.nan, math.inf])
def test_a_contact_without_a_size_is_refused(modes: ModeShapes, radius_mm: float) -> None:
    with pytest.raises(ValueError, match="radius_mm"):
        ContactGram(modes, radius_mm)
