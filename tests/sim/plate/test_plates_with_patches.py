"""Plates of four and eight modes: which they are, and that the patches which make them reach what is claimed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from hapticd.design.contact_pairs import surfaces
from hapticd.design.felt_places import ENOUGH_JND, settle_felt, touches
from hapticd.design.mode_choice import MOST_UM
from hapticd.design.mode_shape import ModeShape
from hapticd.design.patch_reach import patch_drive
from hapticd.sim.plate.glasses import FINGERTIP, WIDE, find_glass, glued
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.sim.plate.shapes import computed

PLACES = 200
VOLTS, SHARE = 150.0, 0.5  # of a patch; each mode's limit, of its reach alone, as the modes share the patches


@dataclass(frozen=True, slots=True)
class Claim:
    """What is said of a plate: the farthest of its modes and the nearest other one, from the drive, and the share of
    places where friction is felt as asked."""

    plate: str
    modes: int
    farthest_hz: float
    next_hz: float
    felt_frac: float


CLAIMS = (
    Claim(FINGERTIP, 4, farthest_hz=131.0, next_hz=623.0, felt_frac=0.65),
    Claim(WIDE, 8, farthest_hz=144.0, next_hz=461.0, felt_frac=0.95),
)


class Built:
    """A plate of a claim, its modes and what its patches do to them."""

    def __init__(self, claim: Claim) -> None:
        settings = PlateSettings.of(claim.plate, claim.modes)
        self.claim, self.glass = claim, find_glass(claim.plate)
        self.limits_um = GroundTruth(settings).w_limit_um
        solved = computed(self.glass)  # what is stored is the deflection alone
        self.modes: list[tuple[float, ModeShape]] = [solved[name] for name in self.glass.modes]
        made = glued(self.glass)
        self.driven = patch_drive(made.thickness_mm, made.patches, self.modes[: claim.modes], settings.q_factor)


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
    assert built.driven.most_v.tolist() == pytest.approx([VOLTS] * built.claim.modes)
    assert built.limits_um == pytest.approx(np.minimum(SHARE * reach_um, MOST_UM), rel=0.01)


def test_at_rest_its_patches_hold_what_is_felt_as_asked(built: Built) -> None:
    driven = [shape for _, shape in built.modes[: built.claim.modes]]
    places = touches(surfaces(driven), built.glass.size_mm, 5.0, 2, PLACES, 1)
    modal_um, errors_jnd = settle_felt(places, (1.0, 0.0), built.limits_um)
    patch_v = built.driven.patch_volts_v(modal_um.T, built.glass.drive_hz)
    is_within = (patch_v <= VOLTS).all(axis=0)
    is_felt = (np.abs(errors_jnd) <= ENOUGH_JND).all(axis=1)
    assert np.mean(is_within) > 0.95
    assert np.mean(is_felt & is_within) > built.claim.felt_frac
