"""The reach of modes by their patches, and what patches take and give, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hapticd.design import ModeShape, free_plate_modes
from hapticd.design.glued_plate import PZT, GluedPlate, Patch
from hapticd.design.materials import MATERIALS, Material
from hapticd.design.patch_places import place_patches
from hapticd.design.patch_reach import CLAMPED_FRAC, PatchDrive, charge_nc_um, patch_drive, patch_load

from .sine_mode import SIZE_MM, sine_mode

GLASS, THICKNESS_MM, Q_FACTOR = MATERIALS["glass"], 3.0, 500.0
PATCHES = (Patch(20.0, 4.0, (10.0, 10.0), 0.3), Patch(-50.0, 12.0, (8.0, 12.0), 0.5))


def integral(wave_1_mm: float, low_mm: float, high_mm: float) -> float:
    return (math.cos(wave_1_mm * low_mm) - math.cos(wave_1_mm * high_mm)) / wave_1_mm


def test_force_and_reach_are_those_of_a_sinusoidal_mode() -> None:
    waves, hz, patch, mass_kg = (4, 3), 29000.0, Patch(23.0, -17.0, (12.0, 8.0), 0.3), 0.04
    shape = sine_mode(waves, mass_kg)
    kx, ky = (2.0 * math.pi * count / edge_mm for count, edge_mm in zip(waves, SIZE_MM, strict=True))
    curvature = -(kx**2 + ky**2) * integral(kx, 17.0, 29.0) * integral(ky, -21.0, -13.0)
    force_n_v = 180e-12 * 62e9 / (1.0 - 0.34) * 1.65e-3 * curvature  # by the height of the patch's middle
    driven = patch_drive(THICKNESS_MM, (patch,), [(hz, shape)], Q_FACTOR)
    at_resonance_um = 2e6 * abs(force_n_v) * 90.0 * Q_FACTOR / (mass_kg * (2.0 * math.pi * hz) ** 2)  # 300 V/mm
    assert driven.reach_um(hz)[0] == pytest.approx(at_resonance_um, rel=1e-9)
    half_power_hz = hz + hz / (2.0 * Q_FACTOR)
    assert driven.reach_um(half_power_hz)[0] == pytest.approx(at_resonance_um / math.sqrt(2.0), rel=1e-9)


def test_a_glued_patch_pulls_no_more_than_its_distance_from_the_neutral_axis_allows() -> None:
    """On a patch that covers the plate sections turn about the common neutral axis."""
    size_mm, patch = (100.0, 80.0), Patch(0.0, 0.0, (100.0, 80.0), 0.5)
    (_, shape), *_ = GluedPlate(size_mm, 3.0, GLASS, (patch,)).modes((2000.0, 3500.0))
    assert shape.motion is not None
    turned, moved = (float(np.abs(of).max()) for of in (shape.motion[:2], shape.motion[2:]))
    stiff = [72.5 / (1.0 - 0.22**2) * 3.0, 62.0 / (1.0 - 0.34**2) * 0.5]
    assert moved / turned == pytest.approx(stiff[1] * 1.75 / sum(stiff), rel=0.05)


@pytest.fixture(scope="module")
def modes() -> list[tuple[float, ModeShape]]:
    """The eight modes near 26870 Hz of a plate of 220 x 220 x 3 mm."""
    found = free_plate_modes((220.0, 220.0), 3.0, band_hz=(26700.0, 27000.0))
    assert len(found) == 8
    return found


def glued(modes: list[tuple[float, ModeShape]], patch_mm: tuple[float, float]) -> PatchDrive:
    places_mm = place_patches([shape for _, shape in modes], patch_mm, 1.75).places_mm
    massless = Material(PZT.young_gpa, PZT.poisson, 1e-9, "weighs nothing")
    patches = [Patch(x_mm, y_mm, patch_mm, 0.5, massless) for x_mm, y_mm in places_mm.tolist()]
    return patch_drive(3.0, patches, modes, Q_FACTOR)


def test_volts_that_give_one_mode_its_reach_leave_the_others_at_rest(modes: list[tuple[float, ModeShape]]) -> None:
    driven, drive_hz = glued(modes, (10.0, 10.0)), 26870.0
    reach_um = driven.reach_um(drive_hz)
    for mode in range(8):
        only_um = np.zeros((8, 1), np.complex128)
        only_um[mode] = reach_um[mode]
        volts_v = driven.patch_volts_v(only_um, drive_hz)[:, 0]
        assert volts_v.max() == pytest.approx(150.0)
        signed_v = np.linalg.solve(driven.gain_um_per_v_s, driven.stiffness_1_s(drive_hz) * only_um[:, 0])
        moved_um = driven.gain_um_per_v_s @ signed_v / driven.stiffness_1_s(drive_hz)
        np.testing.assert_allclose(np.abs(moved_um), np.abs(only_um[:, 0]), atol=1e-9)


def test_a_patch_takes_the_current_and_the_power_of_its_glued_capacitance() -> None:
    load = patch_load(PATCHES[0], 29375.0, 150.0)
    assert load.free_nf == pytest.approx(1750.0 * 8.854e-3 * 100.0 / 0.3 * 1e-3)
    assert load.glued_nf == pytest.approx(CLAMPED_FRAC * load.free_nf)
    assert load.peak_ma == pytest.approx(2e-3 * math.pi * 29.375 * load.glued_nf * 150.0)
    assert load.rms_ma == pytest.approx(load.peak_ma / math.sqrt(2.0))
    assert load.apparent_va == pytest.approx(load.rms_ma * 1e-3 * 150.0 / math.sqrt(2.0))
    assert load.loss_w == pytest.approx(0.02 * load.apparent_va)
    assert load.slew_v_us == pytest.approx(27.685, rel=1e-4)
    assert [patch_load(patch, 29375.0).volts_v for patch in PATCHES] == [90.0, 150.0]  # by its field, by the amplifier


def test_a_moving_mode_gives_back_what_the_patch_drives_it_with() -> None:
    modes = [(29000.0, sine_mode((4, 3))), (29050.0, sine_mode((3, 4)))]
    shapes = [shape for _, shape in modes]
    charge = charge_nc_um(3.0, PATCHES, shapes)
    gain = patch_drive(3.0, PATCHES, modes, 500.0).gain_um_per_v_s
    for mode, (hz, shape) in enumerate(modes):
        newton_per_v = np.abs(gain[mode]) * 2.0 * shape.mass_kg * 2.0 * math.pi * hz / 2e6
        np.testing.assert_allclose(charge[mode], newton_per_v * 0.5e-6 * 1e9)
