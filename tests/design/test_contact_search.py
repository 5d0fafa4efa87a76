"""Plates judged by whole fingertips: the daemon's own rule, the bound, the table of plates, tolerances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hapticd.core.solver.contacts import contact_rms_um as plain_rms_um
from hapticd.core.solver.contacts import solve_contacts
from hapticd.design.contact_map import contact_map
from hapticd.design.contact_pairs import contact_rms_um, contrast_bound, grams, random_fingers, settle, surfaces
from hapticd.design.contact_search import ContactDesign, Drive, Plate, PlateModes, search
from hapticd.design.contact_tolerances import ENOUGH_FRAC, random_plate, tolerance_study
from hapticd.design.glued_plate import Patch
from hapticd.design.materials import MATERIALS

GLASS = MATERIALS["glass"]
REFERENCE = Plate((137.5, 137.5), 2.0, GLASS)
FINGERTIP = Plate((200.0, 200.0), 3.0, GLASS)
PATCHES = (Patch(95.0, 95.0, (10.0, 10.0), 0.3), Patch(0.0, -95.0, (10.0, 10.0), 0.3))
DRIVE = Drive()


def designed(plate: Plate, drive_hz: float, count: int) -> ContactDesign:
    (design,) = search([plate], [count], (drive_hz, drive_hz), DRIVE)
    return design


@pytest.fixture(scope="module")
def fingertip() -> ContactDesign:
    return designed(FINGERTIP, 29375.0, 4)


def test_pairs_are_apart_within_the_plate_and_the_same_for_the_same_seed() -> None:
    pairs_mm = random_fingers((200.0, 60.0), 500, seed=3)
    assert np.hypot(*(pairs_mm[:, 0] - pairs_mm[:, 1]).T).min() >= 20.0
    assert (np.abs(pairs_mm).max(axis=(0, 1)) <= [90.0, 20.0]).all()
    assert np.array_equal(pairs_mm, random_fingers((200.0, 60.0), 500, seed=3))
    assert not np.array_equal(pairs_mm, random_fingers((200.0, 60.0), 500, seed=4))
    with pytest.raises(ValueError, match="no room for two fingers"):
        random_fingers((30.0, 25.0), 5, seed=1)


def test_the_descent_on_arrays_is_the_daemons_own(fingertip: ContactDesign) -> None:
    both = grams(surfaces(fingertip.shapes), random_fingers(FINGERTIP.size_mm, 6, seed=2), 5.0)
    w_um = settle(both[..., 0], [both[..., 1]], 1.0, np.array(fingertip.limits_um))
    for pair in range(6):
        pair_grams = [both[:, :, pair, finger].tolist() for finger in (0, 1)]
        d_um, q_um = [0.0] * 4, [0.0] * 4
        solve_contacts(pair_grams, (1.0, 0.0), tuple(fingertip.limits_um), d_um, q_um)
        np.testing.assert_allclose(w_um[:, pair], np.array(d_um) + 1j * np.array(q_um), atol=1e-9)
        assert contact_rms_um(both[..., 1], w_um)[pair] == pytest.approx(plain_rms_um(pair_grams[1], d_um, q_um))


@pytest.mark.parametrize(
    ("plate", "drive_hz", "count", "median", "tenth"),
    [(REFERENCE, 29150.0, 2, 1.7, 1.1), (REFERENCE, 29150.0, 4, 6.4, 3.3), (FINGERTIP, 29375.0, 4, 48.0, 16.0)],
)
def test_the_bounds_of_the_plates_are_those_of_the_table(
    plate: Plate, drive_hz: float, count: int, median: float, tenth: float
) -> None:
    design = designed(plate, drive_hz, count)
    assert design.bound == pytest.approx(median, rel=0.06)
    assert design.bound_tenth == pytest.approx(tenth, rel=0.2)


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


def test_a_mode_reaches_less_the_farther_it_is_from_the_drive() -> None:
    limits_um = DRIVE.limits_um(np.array([29375.0, 29375.0 * (1.0 + 0.5 / 500.0)]), 29375.0)
    assert limits_um[0] == 4.23
    assert limits_um[1] == pytest.approx(4.23 / np.sqrt(2.0), rel=1e-3)  # half a bandwidth away, at Q 500


def test_a_plate_without_enough_modes_near_the_drive_is_left_out() -> None:
    assert search([Plate((60.0, 60.0), 3.0, GLASS)], [4], (29000.0, 29500.0), DRIVE, pairs=20) == []


def test_contrast_over_the_plate_is_that_of_each_pair(fingertip: ContactDesign) -> None:
    shapes, limits_um = surfaces(fingertip.shapes), fingertip.limits_um
    still_mm, cells = (-33.0, 20.0), 9
    found = contact_map(shapes, [still_mm], 1.0, limits_um, radius_mm=5.0, size_mm=FINGERTIP.size_mm, cells=cells)
    place_mm = found.x_mm[6], found.y_mm[2]
    slipping, still = (grams(shapes, np.array([at]), 5.0) for at in (place_mm, still_mm))
    w_um = settle(slipping, [still], 1.0, np.array(limits_um))
    assert found.slip_um[2, 6] == pytest.approx(contact_rms_um(slipping, w_um)[0])
    assert found.contrast[2, 6] == pytest.approx(found.slip_um[2, 6] / contact_rms_um(still, w_um)[0])


def test_two_still_fingers_on_the_map_count_by_the_one_that_is_shaken_most(fingertip: ContactDesign) -> None:
    shapes, both_mm = surfaces(fingertip.shapes), [(-33.0, 20.0), (40.0, -50.0)]
    maps = [
        contact_map(shapes, still_mm, 1.0, fingertip.limits_um, radius_mm=5.0, size_mm=FINGERTIP.size_mm, cells=7)
        for still_mm in (both_mm, both_mm[:1])
    ]
    assert np.median(maps[0].contrast) < np.median(maps[1].contrast)


def test_random_plates_are_the_same_for_the_same_seed_and_differ_from_the_design(fingertip: ContactDesign) -> None:
    first, again = (tolerance_study(fingertip, DRIVE, 2, pairs=100, seed=5) for _ in range(2))
    assert np.array_equal(first.contrast_frac, again.contrast_frac)
    assert len(set(first.contrast_frac.tolist())) == 2


def test_glued_patches_move_a_plates_modes() -> None:
    plate = Plate((100.0, 80.0), 2.0, GLASS)
    glued = replace(plate, patches=(Patch(45.0, 35.0, (10.0, 10.0), 0.3),))
    bare_hz, glued_hz = (one.modes((14000.0, 16000.0))[0][0] for one in (plate, glued))
    assert abs(glued_hz - bare_hz) > 0.1


def test_random_plates_have_their_patches_on_them() -> None:
    random, patches = np.random.default_rng(1), PATCHES
    for _ in range(200):
        plate = random_plate(replace(FINGERTIP, patches=patches), random)
        for patch, design in zip(plate.patches, patches, strict=True):
            reach_mm = np.abs((patch.x_mm, patch.y_mm)) + 5.0
            assert (reach_mm <= np.array(plate.size_mm) / 2.0 + 1e-9).all()
            assert np.hypot(patch.x_mm - design.x_mm, patch.y_mm - design.y_mm) < 0.8


@pytest.mark.long
def test_random_plates_with_patches_reach_most_of_the_designs_contrast() -> None:
    glued = replace(FINGERTIP, patches=PATCHES)
    study = tolerance_study(designed(glued, 29375.0, 4), DRIVE, 3, pairs=100)
    assert study.contrast_frac.min() > ENOUGH_FRAC


def test_edges_of_different_length_split_a_square_plates_pair() -> None:
    modes = PlateModes(Plate((200.1, 199.9), 3.0, GLASS), (29100.0, 29500.0), DRIVE, pairs=10)
    hz = {shape.name: hz for shape, hz in zip(modes.shapes, modes.frequency_hz, strict=True)}
    assert 40.0 < hz["0x13"] - hz["13x0"] < 80.0


@pytest.mark.long
def test_nine_of_ten_plates_within_tolerance_reach_two_thirds_of_the_designs_contrast(
    fingertip: ContactDesign,
) -> None:
    known = tolerance_study(fingertip, DRIVE, 40, are_scanned=False)
    assert known.enough_frac >= 0.9
    assert pytest.approx(2.0 / 3.0) == ENOUGH_FRAC
    assert np.quantile(known.slip_frac, 0.1) > 0.9
    scanned = tolerance_study(fingertip, DRIVE, 2, pairs=200)  # all of `hapticd plate --contacts --tolerances 200`
    assert scanned.enough_frac == 1.0
    assert (scanned.slip_frac > 0.9).all()
    exact = tolerance_study(fingertip, DRIVE, 2, pairs=200, are_scanned=False)
    assert (scanned.contrast_frac < exact.contrast_frac).all()
