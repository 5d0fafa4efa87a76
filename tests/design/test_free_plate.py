"""Free-plate modes against published values, the plate equation, and known facts of the reference plate."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hapticd.design import ModeShape, free_plate_modes, legendre

AXIS_MM = np.linspace(-68.75, 68.75, 221)


@pytest.fixture(scope="module")
def by_name() -> dict[str, tuple[float, ModeShape]]:
    return {shape.name: (frequency_hz, shape) for frequency_hz, shape in free_plate_modes()}


def numbered(frequency_hz: float, poisson: float) -> float:
    """omega a^2 sqrt(rho h / D) of the reference plate."""
    stiffness = 72.5e9 * 0.002**3 / (12.0 * (1.0 - poisson**2))
    return 2.0 * math.pi * frequency_hz * 0.1375**2 * math.sqrt(2500.0 * 0.002 / stiffness)


def test_the_lowest_modes_are_the_published_ones() -> None:
    # Completely free square plate, nu = 0.3: 13.468, 19.596, 24.270, 34.801 (twice), 61.093 (twice).
    # K. M. Liew, K. Y. Lam and S. T. Chow, Computers & Structures 34 (1990) 79; Leissa, J. Sound Vib. 31 (1973) 257.
    modes = free_plate_modes(poisson=0.3, band_hz=(1.0, 2000.0))
    published = (13.468, 19.596, 24.270, 34.801, 34.801, 61.093, 61.093)

    found = [numbered(frequency_hz, 0.3) for frequency_hz, _ in modes[: len(published)]]

    assert found == pytest.approx(published, rel=1e-4)
    assert [shape.name for _, shape in modes[:5]] == ["1x1", "2x0-0x2", "2x0+0x2", "1x2", "2x1"]


def test_the_reference_plate_has_its_pair_with_eleven_nodal_lines(by_name: dict[str, tuple[float, ModeShape]]) -> None:
    (x_hz, x_shape), (y_hz, y_shape) = by_name["11x0"], by_name["0x11"]

    assert x_hz == y_hz == pytest.approx(29150.0, rel=5e-4)
    assert (x_shape.nodal_lines, y_shape.nodal_lines) == ((11, 0), (0, 11))
    middle = x_shape.on_grid(AXIS_MM + 1e-3, [0.0])[0]
    assert np.count_nonzero(np.diff(np.sign(middle))) == 11


def test_the_x_shape_is_no_product_of_beams(by_name: dict[str, tuple[float, ModeShape]]) -> None:
    shape = by_name["11x0"][1].on_grid(AXIS_MM, AXIS_MM)
    inner = np.abs(AXIS_MM) < 60.0

    along_y = np.abs(shape[:, inner]).max(axis=1)[inner]
    singular = np.linalg.svd(shape, compute_uv=False)

    assert along_y.min() / along_y.max() < 0.7
    assert singular[1] / singular[0] > 0.3


def test_the_shape_obeys_the_plate_equation_and_the_free_edge(by_name: dict[str, tuple[float, ModeShape]]) -> None:
    frequency_hz, shape = by_name["11x0"]
    degree = shape.coefficients.shape[0] - 1
    wave_4 = numbered(frequency_hz, 0.22) ** 2 / 16.0  # k^4 with half the edge as unit

    def derivative(s: np.ndarray, t: np.ndarray, order_x: int, order_y: int) -> np.ndarray:
        along_x, along_y = legendre.values(s, degree, order_x), legendre.values(t, degree, order_y)
        return along_x @ shape.coefficients @ along_y.T

    inner, edge = np.linspace(-0.8, 0.8, 41), np.ones(1)
    bending = derivative(inner, inner, 4, 0) + 2 * derivative(inner, inner, 2, 2) + derivative(inner, inner, 0, 4)
    np.testing.assert_allclose(bending, wave_4 * derivative(inner, inner, 0, 0), rtol=0.0, atol=1e-4 * wave_4)

    moment = derivative(edge, inner, 2, 0) + 0.22 * derivative(edge, inner, 0, 2)
    shear = derivative(edge, inner, 3, 0) + (2.0 - 0.22) * derivative(edge, inner, 1, 2)
    assert np.abs(moment).max() < 1e-3 * wave_4**0.5
    assert np.abs(shear).max() < 1e-3 * wave_4**0.75


@pytest.mark.parametrize(
    "wrong",
    [
        {"size_mm": (0.0, 100.0)},
        {"size_mm": (100.0, math.nan)},
        {"thickness_mm": -2.0},
        {"young_gpa": math.inf},
        {"poisson": 0.6},
        {"poisson": math.nan},
        {"density_kg_m3": 0.0},
        {"band_hz": (2.0, 1.0)},
        {"band_hz": (0.0, math.nan)},
        {"band_hz": (0.0, 1e9)},
    ],
)
def test_a_plate_that_cannot_be_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong)).split("[")[0]):
        free_plate_modes(**wrong)
