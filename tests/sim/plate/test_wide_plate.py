"""The plate of eight modes: which they are, and that an orderable set of patches reaches what is claimed."""

from __future__ import annotations

import numpy as np

from hapticd.config.sections import MOST_MODES
from hapticd.design.glued_plate import Patch
from hapticd.design.materials import find_material
from hapticd.design.patch_places import place_patches
from hapticd.design.patch_reach import patch_drive
from hapticd.sim.plate.glasses import GLASSES, WIDE
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.sim.plate.shapes import theory

GLASS = GLASSES[WIDE]
PATCH_MM, PATCH_THICKNESS_MM, VOLTS = (20.0, 10.0), 0.5, 150.0


def test_it_drives_all_modes_near_its_drive_and_the_next_is_far() -> None:
    off_hz = np.array([theory(name, WIDE)[0] - GLASS.drive_hz for name in GLASS.modes])
    assert GLASS.driven == MOST_MODES
    assert np.abs(off_hz[:MOST_MODES]).max() < 172.0
    assert np.abs(off_hz[MOST_MODES:]).min() > 462.0


def test_eight_patches_along_its_edges_hold_all_modes_at_their_limits_together() -> None:
    """Each patch drives every mode: its voltage is the sum of what all modes take, at the worst of their signs."""
    settings = PlateSettings.of(WIDE)
    truth = GroundTruth(settings)
    shapes = [theory(name, WIDE)[1] for name in GLASS.modes[:MOST_MODES]]
    placed, _ = place_patches(shapes, PATCH_MM)
    drive = patch_drive(
        GLASS.thickness_mm,
        find_material(GLASS.material),
        [Patch(x_mm, y_mm, PATCH_MM, PATCH_THICKNESS_MM) for x_mm, y_mm in placed.places_mm.tolist()],
        list(zip(truth.frequency_hz[:MOST_MODES].tolist(), shapes, strict=True)),
        settings.q_factor,
    )
    alone_v = np.abs(drive.volts_per_um_s) * np.abs(drive.stiffness_1_s(GLASS.drive_hz)) * np.array(truth.w_limit_um)
    assert drive.most_v.tolist() == [VOLTS] * MOST_MODES
    assert 0.97 * VOLTS < alone_v.sum(axis=1).max() < VOLTS
