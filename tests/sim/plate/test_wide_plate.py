"""The plate of eight modes: which they are, and that the patches which make them reach what is claimed."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.config.sections import MOST_MODES
from hapticd.design.contact_pairs import surfaces
from hapticd.design.felt_places import ENOUGH_JND, settle_felt, touches
from hapticd.design.glued_plate import Patch
from hapticd.design.materials import find_material
from hapticd.design.patch_reach import PatchDrive, patch_drive
from hapticd.sim.plate.glasses import GLASSES, WIDE
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.sim.plate.shapes import theory

GLASS = GLASSES[WIDE]
MODES = [theory(name, WIDE) for name in GLASS.modes]
VOLTS, SHARE = 150.0, 0.35  # of its reach alone is each mode's limit, as the modes share the patches
PLACES = 200


@pytest.fixture(scope="module")
def driven() -> PatchDrive:
    patches = [Patch(x_mm, y_mm, (width_mm, depth_mm), mm) for x_mm, y_mm, width_mm, depth_mm, mm in GLASS.patches]
    material = find_material(GLASS.material)
    return patch_drive(GLASS.thickness_mm, material, patches, MODES[:MOST_MODES], PlateSettings.of(WIDE).q_factor)


def test_it_drives_all_modes_near_its_drive_and_the_next_is_far() -> None:
    off_hz = np.array([hz - GLASS.drive_hz for hz, _ in MODES])
    assert GLASS.driven == MOST_MODES
    assert np.abs(off_hz[:MOST_MODES]).max() < 162.0
    assert np.abs(off_hz[MOST_MODES:]).min() > 506.0


def test_each_mode_s_limit_is_a_share_of_what_its_patches_reach(driven: PatchDrive) -> None:
    limits_um = GroundTruth(PlateSettings.of(WIDE)).w_limit_um
    assert driven.most_v.tolist() == [VOLTS] * MOST_MODES  # by the amplifier, and 300 V/mm
    assert limits_um == pytest.approx(SHARE * driven.reach_um(GLASS.drive_hz), rel=0.01)


def test_at_rest_its_patches_hold_what_is_felt_as_asked(driven: PatchDrive) -> None:
    limits_um = GroundTruth(PlateSettings.of(WIDE)).w_limit_um
    places = touches(surfaces([shape for _, shape in MODES[:MOST_MODES]]), GLASS.size_mm, 5.0, 2, PLACES, 1)
    modal_um, errors_jnd = settle_felt(places, (1.0, 0.0), limits_um)
    patch_v = driven.patch_volts_v(modal_um.T, GLASS.drive_hz)
    is_within = (patch_v <= VOLTS).all(axis=0)
    is_felt = (np.abs(errors_jnd) <= ENOUGH_JND).all(axis=1)
    assert np.mean(is_within) > 0.97
    assert np.mean(is_felt & is_within) > 0.95
