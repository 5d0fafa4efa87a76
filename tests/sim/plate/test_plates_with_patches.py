"""Plates of four and eight modes: which they are, and that the patches which make them reach what is claimed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from hapticd.design.contact_pairs import surfaces
from hapticd.design.felt_places import ENOUGH_JND, settle_felt, touches
from hapticd.design.glued_plate import Patch
from hapticd.design.mode_choice import MOST_UM
from hapticd.design.mode_shape import ModeShape
from hapticd.design.patch_reach import PatchDrive, patch_drive
from hapticd.sim.plate.glasses import FINGERTIP, WIDE, Glass, find_glass
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.sim.plate.shapes import computed

PLACES = 200


@dataclass(frozen=True, slots=True)
class Claim:
    """What is said of a plate: the farthest of its modes and the nearest other one, from the drive, the volts of a
    patch, each mode's limit as a share of its reach alone, as the modes share the patches, and the share of places
    where friction is felt as asked."""

    plate: str
    modes: int
    farthest_hz: float
    next_hz: float
    volts: float
    share: float
    felt_frac: float


CLAIMS = (
    Claim(FINGERTIP, 4, farthest_hz=131.0, next_hz=623.0, volts=150.0, share=0.5, felt_frac=0.65),
    Claim(WIDE, 8, farthest_hz=144.0, next_hz=461.0, volts=150.0, share=0.5, felt_frac=0.95),
)


class Built:
    """A plate of a claim, its modes and what its patches do to them."""

    def __init__(self, claim: Claim) -> None:
        settings = PlateSettings.of(claim.plate, claim.modes)
        self.claim, self.glass = claim, find_glass(claim.plate)
        self.limits_um = GroundTruth(settings).w_limit_um
        solved = computed(self.glass)  # what is stored is the deflection alone
        self.modes: list[tuple[float, ModeShape]] = [solved[name] for name in self.glass.modes]
        self.driven = _driven(self.glass, self.modes[: claim.modes], settings.q_factor)


def _driven(glass: Glass, modes: list[tuple[float, ModeShape]], q_factor: float) -> PatchDrive:
    patches = [Patch(x_mm, y_mm, (width_mm, depth_mm), mm) for x_mm, y_mm, width_mm, depth_mm, mm in glass.patches]
    return patch_drive(glass.thickness_mm, patches, modes, q_factor)


SOLVED = [CLAIMS[0], pytest.param(CLAIMS[1], marks=pytest.mark.long)]


@pytest.fixture(scope="module", params=SOLVED, ids=lambda claim: f"{claim.plate}-{claim.modes}")
def built(request: pytest.FixtureRequest) -> Built:
    return Built(request.param)


def test_it_drives_all_modes_near_its_drive_and_the_next_is_far(built: Built) -> None:
    off_hz = np.array([hz - built.glass.drive_hz for hz, _ in built.modes])
    modes = built.claim.modes
    assert built.glass.driven == modes
    assert np.abs(off_hz[:modes]).max() < built.claim.farthest_hz
    assert np.abs(off_hz[modes:]).min() > built.claim.next_hz


def test_each_mode_s_limit_is_a_share_of_what_its_patches_reach(built: Built) -> None:
    reach_um = built.driven.reach_um(built.glass.drive_hz)
    assert built.driven.most_v.tolist() == pytest.approx([built.claim.volts] * built.claim.modes)
    assert built.limits_um == pytest.approx(np.minimum(built.claim.share * reach_um, MOST_UM), rel=0.01)


def test_at_rest_its_patches_hold_what_is_felt_as_asked(built: Built) -> None:
    driven = [shape for _, shape in built.modes[: built.claim.modes]]
    places = touches(surfaces(driven), built.glass.size_mm, 5.0, 2, PLACES, 1)
    modal_um, errors_jnd = settle_felt(places, (1.0, 0.0), built.limits_um)
    patch_v = built.driven.patch_volts_v(modal_um.T, built.glass.drive_hz)
    is_within = (patch_v <= built.claim.volts).all(axis=0)
    is_felt = (np.abs(errors_jnd) <= ENOUGH_JND).all(axis=1)
    assert np.mean(is_within) > 0.95
    assert np.mean(is_felt & is_within) > built.claim.felt_frac
