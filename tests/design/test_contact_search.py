"""Plates judged by whole fingertips: the daemon's own rule, the bound, the table of plates, tolerances."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.core.solver.contacts import contact_rms_um as plain_rms_um
from hapticd.core.solver.contacts import solve_contacts
from hapticd.design.contact_pairs import contact_rms_um, contrast_bound, grams, random_fingers, settle, surfaces
from hapticd.design.contact_search import ContactDesign, Drive, Plate, search
from hapticd.design.materials import MATERIALS

GLASS = MATERIALS["glass"]
REFERENCE = Plate((137.5, 137.5), 2.0, GLASS)
FINGERTIP = Plate((200.0, 200.0), 3.0, GLASS)
DRIVE = Drive()


def designed(plate: Plate, drive_hz: float, count: int) -> ContactDesign:
    (design,) = search([plate], [count], (drive_hz, drive_hz), DRIVE)
    return design


@pytest.fixture(scope="module")
def fingertip() -> ContactDesign:
    return designed(FINGERTIP, 29375.0, 4)


def test_the_descent_on_arrays_is_the_daemons_own(fingertip: ContactDesign) -> None:
    both = grams(surfaces(fingertip.shapes), random_fingers(FINGERTIP.size_mm, 6, seed=2), 5.0)
    w_um = settle(both[..., 0], [both[..., 1]], 1.0, np.array(fingertip.limits_um))
    for pair in range(6):
        pair_grams = [both[:, :, pair, finger].tolist() for finger in (0, 1)]
        d_um, q_um = [0.0] * 4, [0.0] * 4
        solve_contacts(pair_grams, (1.0, 0.0), tuple(fingertip.limits_um), d_um, q_um)
        np.testing.assert_allclose(w_um[:, pair], np.array(d_um) + 1j * np.array(q_um), atol=1e-9)
        assert contact_rms_um(both[..., 1], w_um)[pair] == pytest.approx(plain_rms_um(pair_grams[1], d_um, q_um))


def test_no_pair_exceeds_its_bound(fingertip: ContactDesign) -> None:
    both = grams(surfaces(fingertip.shapes), random_fingers(FINGERTIP.size_mm, 200, seed=2), 5.0)
    slipping, still, limits_um = both[..., 0], both[..., 1], np.array(fingertip.limits_um)
    w_um = settle(slipping, [still], 1.0, limits_um)
    bound, share = contrast_bound(slipping, still, limits_um)
    assert (contact_rms_um(slipping, w_um) <= contact_rms_um(still, w_um) * bound * (1.0 + 1e-9)).all()
    assert (np.abs(w_um) <= limits_um[:, None] * (1.0 + 1e-9)).all()
    assert 0.75 < np.median(share) < 0.85  # um of slip at the bound: 0.82 in the table


def test_four_modes_of_the_fingertip_plate_give_ten_times_the_contrast_that_the_papers_two_allow(
    fingertip: ContactDesign,
) -> None:
    two = designed(REFERENCE, 29150.0, 2)
    assert fingertip.contrast > 10.0 * two.bound
    assert fingertip.slip_um > 0.75
    assert [shape.name for shape in fingertip.shapes] == ["13x1-1x13", "10x8-8x10", "13x0", "0x13"]


def test_the_search_returns_to_the_fingertip_plates_drive_and_ranks_it_first() -> None:
    found = search([Plate((180.0, 180.0), 3.0, GLASS), FINGERTIP], [4], (29000.0, 30000.0), DRIVE, pairs=200)
    assert found[0].plate == FINGERTIP
    assert found[0].drive_hz == 29375.0
    assert found[0].score >= found[-1].score
