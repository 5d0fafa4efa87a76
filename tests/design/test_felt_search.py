"""Friction as asked at places at random, patches placed for reach, and what is searched by both."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from hapticd.core.friction import DEFAULT_FRICTION_CURVE
from hapticd.design import ModeShape, felt_search, free_plate_modes
from hapticd.design.contact_pairs import random_fingers, surfaces
from hapticd.design.felt_places import settle_felt, touches
from hapticd.design.felt_search import FeltDesign, GluedModes, search
from hapticd.design.felt_tolerances import Copy, felt_tolerances
from hapticd.design.glued_plate import GluedPlate
from hapticd.design.materials import MATERIALS
from hapticd.design.mode_choice import FeltTask
from hapticd.design.patch_places import along_edges, couplings, overlapping, places_for_reach

SIZE_MM, TARGETS_UM = (120.0, 120.0), (1.0, 0.0)
TASK = FeltTask(farthest_hz=400.0)
KIT = (8.0, 8.0, 0.3)


@pytest.fixture(scope="module")
def shapes() -> list[ModeShape]:
    return [shape for _, shape in free_plate_modes((200.0, 200.0), 3.0, band_hz=(27600.0, 28000.0))]


@pytest.fixture(scope="module")
def designs() -> list[FeltDesign]:
    plates = [GluedPlate(SIZE_MM, mm, MATERIALS["glass"]) for mm in (1.5, 2.0)]
    with pytest.MonkeyPatch.context() as patch:
        for name, less in {"JUDGE_PLACES": 100, "SEARCH_PLACES": 30, "MORE_ROUNDS": 3, "ROUNDS": 1}.items():
            patch.setattr(felt_search, name, less)
        return search(plates, [3], (27000.0, 28500.0), TASK, [KIT])


def test_errors_are_those_of_the_mean_friction_over_a_fine_grid(shapes: list[ModeShape]) -> None:
    known = surfaces(shapes)
    found = touches(known, (200.0, 200.0), 5.0, 2, 40, seed=3)
    limits_um = np.full(len(shapes), 3.0)
    modal_um, error_jnd = settle_felt(found, TARGETS_UM, limits_um)
    assert np.all(np.abs(modal_um) <= limits_um * (1.0 + 1e-12))
    line_mm = np.arange(-4.9, 5.0, 0.2)
    grid_mm = np.stack(np.meshgrid(line_mm, line_mm), axis=-1).reshape(-1, 2)
    grid_mm = grid_mm[np.hypot(*grid_mm.T) <= 5.0]
    points_mm = random_fingers((200.0, 200.0), 40, 3)[:, :, None] + grid_mm
    phi = known.evaluate(points_mm.reshape(-1, 2)).reshape(*points_mm.shape[:-1], -1)
    friction = np.maximum(np.exp(-np.abs(np.einsum("pnqm,pm->pnq", phi, modal_um)) / 0.7), np.exp(-2.0 / 0.7))
    asked = np.exp(-np.array(TARGETS_UM) / 0.7)
    np.testing.assert_allclose(error_jnd, (friction.mean(axis=2) / asked - 1.0) / 0.11, atol=0.12)


def test_patches_placed_for_reach_need_fewer_volts_than_a_thousand_random_choices(shapes: list[ModeShape]) -> None:
    candidates_mm, sizes_mm = along_edges((200.0, 200.0), (20.0, 10.0))
    assert {tuple(size) for size in sizes_mm.tolist()} == {(20.0, 10.0), (10.0, 20.0)}
    moved = couplings(shapes, candidates_mm, sizes_mm, 1.65)
    overlaps = overlapping(candidates_mm, sizes_mm)
    chosen = places_for_reach(moved, overlaps)
    assert not np.any(overlaps[np.ix_(chosen, chosen)] & ~np.eye(len(chosen), dtype=bool))

    def worst(some: list[int]) -> float:
        return float(np.linalg.norm(np.linalg.inv(moved[:, some]), axis=1).max())

    random = np.random.default_rng(1)
    drawn = [random.choice(len(candidates_mm), len(shapes), replace=False).tolist() for _ in range(1000)]
    assert worst(chosen) < 0.8 * min(map(worst, drawn))
    for at in range(len(chosen)):  # nor does one exchange make it better
        others = chosen[:at] + chosen[at + 1 :]
        tried = np.flatnonzero(~overlaps[others].any(axis=0))[::7]
        assert worst(chosen) <= min(worst([*others, one]) for one in tried.tolist()) * (1.0 + 1e-6)


def test_the_best_plate_comes_first_and_has_a_patch_for_each_mode(designs: list[FeltDesign]) -> None:
    assert [one.felt_frac for one in designs] == sorted((one.felt_frac for one in designs), reverse=True)
    for one in designs:
        assert len(one.plate.patches) == len(one.modes) == 3
        assert one.farthest_hz <= TASK.farthest_hz
        away_hz = [abs(hz - one.drive_hz) for hz in one.frequency_hz]
        assert away_hz == sorted(away_hz)
        reach_um = one.driven.reach_um(one.drive_hz)
        np.testing.assert_allclose(one.limits_um, np.minimum(one.share * reach_um, 6.0))
        assert np.all(one.modal_um <= np.array(one.limits_um) * (1.0 + 1e-12))
        assert one.felt_frac <= min(*one.each_frac, one.fits_frac)
        assert one.fits_frac == np.mean((one.patch_v <= one.driven.most_v).all(axis=1))


def test_a_larger_tenth_percentile_wins_over_a_larger_nominal_value(designs: list[FeltDesign]) -> None:
    higher, lower = designs[0], replace(designs[0], plate=designs[1].plate)

    def campaign(_: str, __: Callable[[Copy], float], copies: Sequence[Copy]) -> list[float]:
        return [0.9 - 0.1 * one.number if one.plate is higher.plate else 0.7 - 0.01 * one.number for one in copies]

    best, other = felt_tolerances([higher, lower], TASK, 4, campaign)
    assert (best.design is lower, best.nominal_frac, best.tenth_frac) == (True, 0.7, pytest.approx(0.663))
    assert (other.design is higher, other.nominal_frac, other.tenth_frac) == (True, 0.9, pytest.approx(0.53))


def test_fingers_that_feel_half_an_amplitude_as_the_whole_are_served_by_half(designs: list[FeltDesign]) -> None:
    plate, drive_hz = designs[0].plate, designs[0].drive_hz
    curve_um = tuple(DEFAULT_FRICTION_CURVE.amplitude_um(friction) / 2.0 for friction in np.linspace(1.0, 0.0, 201))
    person = replace(TASK, targets_um=(0.5, 0.0), curve_um=curve_um, floor_frac=DEFAULT_FRICTION_CURVE.floor_frac)
    usual, halved = (GluedModes(plate, (drive_hz - 250.0, drive_hz + 250.0), task, 100) for task in (TASK, person))
    chosen = usual.sets(3)[-1]
    one, other = (modes.judge(chosen, drive_hz) for modes in (usual, halved))
    assert other.felt_frac >= one.felt_frac - 0.05
    assert np.quantile(other.modal_um, 0.5) < np.quantile(one.modal_um, 0.5)


def test_places_beyond_the_patches_volts_do_not_count(designs: list[FeltDesign]) -> None:
    plate = designs[0].plate
    thinner = replace(plate, patches=tuple(replace(patch, thickness_mm=0.05) for patch in plate.patches))
    drive_hz = designs[0].drive_hz
    judged = []
    for one in (plate, thinner):
        modes = GluedModes(one, (drive_hz - 250.0, drive_hz + 250.0), TASK, 100)
        judged.append(max((modes.judge(chosen) for chosen in modes.sets(3)), key=lambda made: made.felt_frac))
    assert judged[1].driven.most_v.tolist() == [15.0] * 3
    assert judged[1].felt_frac < judged[0].felt_frac
