"""Plates with patches and without: limits with known answers, published values, and independent solutions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.polynomial import legendre
from scipy.linalg import eigh

from hapticd.design import ModeShape, free_plate_modes, plate_modes
from hapticd.design.glued_plate import PZT, GluedPlate, Patch
from hapticd.design.materials import MATERIALS
from hapticd.design.section import wave_hz, wave_rad_mm

from .solid import solid_hz

GLASS, SIZE_MM, BAND_HZ = MATERIALS["glass"], (100.0, 80.0), (14000.0, 16000.0)
AXIS_MM = np.linspace(-68.75, 68.75, 221)


@pytest.fixture(scope="module")
def by_name() -> dict[str, tuple[float, ModeShape]]:
    return {shape.name: (frequency_hz, shape) for frequency_hz, shape in free_plate_modes()}


def test_a_thin_plate_has_the_published_modes_of_thin_plate_theory() -> None:
    # Completely free square plate, nu = 0.3: 13.468, 19.596, 24.270, 34.801 (twice), 61.093 (twice).
    # K. M. Liew, K. Y. Lam and S. T. Chow, Computers & Structures 34 (1990) 79; Leissa, J. Sound Vib. 31 (1973) 257.
    published = (13.468, 19.596, 24.270, 34.801, 34.801, 61.093, 61.093)
    stiffness = 72.5e9 * 0.0001**3 / (12.0 * (1.0 - 0.3**2))
    unit_hz = math.sqrt(stiffness / (2500.0 * 0.0001)) / (2.0 * math.pi * 0.1375**2)
    modes = free_plate_modes(thickness_mm=0.1, poisson=0.3, band_hz=(1.0, 65.0 * unit_hz))
    assert [hz / unit_hz for hz, _ in modes[: len(published)]] == pytest.approx(published, rel=2e-3)
    assert [shape.name for _, shape in modes[:5]] == ["1x1", "2x0-0x2", "2x0+0x2", "1x2", "2x1"]


def test_thick_plates_have_the_frequencies_that_other_programs_found() -> None:
    # Legendre-Ritz and p-elements of Mindlin's theory, which agree within 3 Hz.
    found = {shape.name: hz for hz, shape in free_plate_modes((200.0, 200.0), 3.0, band_hz=(27600.0, 27900.0))}
    others = {"10x8-8x10": 27653.3, "10x8+8x10": 27763.5, "13x0": 27765.6, "0x13": 27765.6, "13x1-1x13": 27833.7}
    assert found == pytest.approx(others, abs=0.5)


def test_the_reference_plate_s_pair_is_equal_and_pure(by_name: dict[str, tuple[float, ModeShape]]) -> None:
    (x_hz, x_shape), (y_hz, y_shape) = by_name["11x0"], by_name["0x11"]
    assert x_hz == y_hz == pytest.approx(28118.7, abs=0.5)
    assert (x_shape.nodal_lines, y_shape.nodal_lines) == ((11, 0), (0, 11))
    middle = x_shape.on_grid(AXIS_MM + 1e-3, [0.0])[0]
    assert np.count_nonzero(np.diff(np.sign(middle))) == 11
    np.testing.assert_allclose(x_shape.on_grid(AXIS_MM, AXIS_MM), y_shape.on_grid(AXIS_MM, AXIS_MM).T, atol=1e-12)


def test_the_x_shape_is_no_product_of_beams(by_name: dict[str, tuple[float, ModeShape]]) -> None:
    shape = by_name["11x0"][1].on_grid(AXIS_MM, AXIS_MM)
    inner = np.abs(AXIS_MM) < 60.0
    along_y = np.abs(shape[:, inner]).max(axis=1)[inner]
    singular = np.linalg.svd(shape, compute_uv=False)
    assert along_y.min() / along_y.max() < 0.7
    assert singular[1] / singular[0] > 0.25


def test_a_wave_has_its_frequency_back_and_is_slower_than_on_a_thin_plate() -> None:
    rad_mm = wave_rad_mm(29000.0, 3.0, GLASS)
    assert wave_hz(rad_mm, 3.0, GLASS) == pytest.approx(29000.0)
    thin_hz = math.sqrt(72.5e6 * 9.0 / (12.0 * (1.0 - 0.22**2) * 2500e-9)) * rad_mm**2 / (2.0 * math.pi)
    assert thin_hz / 29000.0 == pytest.approx(1.055, abs=0.01)


def test_a_patch_of_the_plates_glass_all_over_it_makes_a_thicker_plate() -> None:
    """Its fields are about the glass's middle, a basis of its own, and its factor of shear is the same."""
    whole = Patch(0.0, 0.0, SIZE_MM, 0.5, GLASS)
    thicker = [hz for hz, _ in free_plate_modes(SIZE_MM, 2.5, band_hz=BAND_HZ)]
    glued = [hz for hz, _ in GluedPlate(SIZE_MM, 2.0, GLASS, (whole,)).modes(BAND_HZ)]
    assert glued == pytest.approx(thicker, abs=1.0)


def test_modes_in_the_plane_are_those_of_a_free_membrane_and_no_bending_ones() -> None:
    """Independently: Ritz's method in Legendre polynomials, whole and dense."""
    degree, nu = 14, GLASS.poisson
    nodes, weights = legendre.leggauss(degree + 1)
    value = legendre.legvander(nodes, degree)
    slope = np.stack([legendre.legval(nodes, legendre.legder(row)) for row in np.eye(degree + 1)], axis=1)
    sides = []
    for edge_mm in SIZE_MM:
        half = edge_mm / 2.0
        over = weights[:, None]
        sides.append((value.T @ (value * over) * half, slope.T @ (slope * over) / half, value.T @ (slope * over)))
    (mass_x, stiff_x, mixed_x), (mass_y, stiff_y, mixed_y) = sides
    shear = (1.0 - nu) / 2.0
    along = np.kron(stiff_x, mass_y) + shear * np.kron(mass_x, stiff_y)
    across = np.kron(mass_x, stiff_y) + shear * np.kron(stiff_x, mass_y)
    both = nu * np.kron(mixed_x.T, mixed_y) + shear * np.kron(mixed_x, mixed_y.T)
    plane = 72.5e6 / (1.0 - nu**2)
    mass = 2500e-9 * np.kron(np.eye(2), np.kron(mass_x, mass_y))
    values = eigh(plane * np.block([[along, both], [both.T, across]]), mass, eigvals_only=True)
    expected = np.sqrt(values[3:7]) / (2.0 * math.pi)
    found = GluedPlate(SIZE_MM, 2.0, GLASS).in_plane_hz((10000.0, float(expected[3]) + 1.0))
    assert found == pytest.approx(expected.tolist(), rel=1e-4)


@pytest.mark.long
def test_a_plate_with_a_patch_is_within_a_thousandth_of_a_solid() -> None:
    """Solid elements, quadratic, two through the glass: they know nothing of sections."""
    size_mm, patch = (40.0, 30.0), (-5.0, -5.0, 10.0, 10.0, 0.5)
    found = [hz for hz, _ in plate_modes(size_mm, 3.0, patches=[patch], band_hz=(5000.0, 42000.0))]
    solid = solid_hz(size_mm, 3.0, GLASS, Patch(*patch[:2], patch[2:4], patch[4], PZT), len(found) + 3)
    bending = [min(solid, key=lambda hz: abs(hz - one)) for one in found]
    assert found == pytest.approx(bending, rel=3e-3)


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


def test_a_patch_that_reaches_over_the_edge_is_refused() -> None:
    with pytest.raises(ValueError, match=r"the patch at 97,0 mm reaches over the plate's edge\."):
        plate_modes((200.0, 200.0), 3.0, patches=[(97.0, 0.0, 10.0, 10.0, 0.5)])
