"""The plate of eight modes: which they are, and that an orderable set of patches reaches what is claimed."""

from __future__ import annotations

import numpy as np

from hapticd.config.sections import MOST_MODES
from hapticd.design.free_plate import ModeShape
from hapticd.design.materials import find_material
from hapticd.design.patch_places import couplings, place_patches
from hapticd.sim.plate.glasses import GLASSES, WIDE
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.sim.plate.shapes import theory

GLASS = GLASSES[WIDE]
PATCH_MM, VOLTS = (20.0, 10.0), 150.0
D31_M_PER_V, YOUNG_PA, POISSON = 180e-12, 62e9, 0.34  # PIC255; the force does not depend on the patch's thickness


def modal_mass_kg(shape: ModeShape) -> float:
    half_mm, weights = np.array(GLASS.size_mm) / 2.0, np.ones(401)
    weights[[0, -1]] = 0.5
    square = shape.on_grid(*(np.linspace(-half, half, 401) for half in half_mm)) ** 2
    mean = float(weights @ square @ weights) / 400.0**2
    areal_kg_mm2 = find_material(GLASS.material).density_kg_m3 * GLASS.thickness_mm * 1e-9
    return areal_kg_mm2 * GLASS.size_mm[0] * GLASS.size_mm[1] * mean


def test_it_drives_all_modes_near_its_drive_and_the_next_is_far() -> None:
    off_hz = np.array([theory(name, WIDE)[0] - GLASS.drive_hz for name in GLASS.modes])
    assert GLASS.driven == MOST_MODES
    assert np.abs(off_hz[:8]).max() < 172.0
    assert np.abs(off_hz[8:]).min() > 462.0


def test_eight_patches_along_its_edges_hold_all_modes_at_their_limits_together() -> None:
    """Each patch drives every mode: its voltage is the sum of what all modes take, at the worst of their signs."""
    truth = GroundTruth(PlateSettings.of(WIDE))
    shapes = [theory(name, WIDE)[1] for name in GLASS.modes[:8]]
    placed, _ = place_patches(shapes, PATCH_MM)
    moment_n_per_v = D31_M_PER_V * YOUNG_PA / (1.0 - POISSON) * GLASS.thickness_mm / 2.0 * 1e-3
    force_n_per_v = moment_n_per_v * couplings(shapes, placed.places_mm, PATCH_MM)
    mass_kg = np.array([modal_mass_kg(shape) for shape in shapes])
    frequency_rad_s = 2.0 * np.pi * truth.frequency_hz[:8]
    stiffness_1_s = np.hypot(truth.decay_1_s[:8], truth.detuning_rad_s[:8])
    um_per_v = 2e6 * force_n_per_v / (2.0 * mass_kg * frequency_rad_s * stiffness_1_s)[:, None]  # peak to peak
    together_v = np.abs(np.linalg.inv(um_per_v)) @ np.array(truth.w_limit_um)
    assert 0.95 * VOLTS < together_v.max() < VOLTS
