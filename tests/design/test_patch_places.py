"""Patches lie along the edges, apart, where they drive all modes; stamps where all modes are small."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.design import ModeShape, free_plate_modes
from hapticd.design.glued_plate import Patch
from hapticd.design.patch_places import couplings, edge_places, four_stamps, place_patches

SIZE_MM, PATCH_MM = (200.0, 200.0), (10.0, 10.0)


@pytest.fixture(scope="module")
def shapes() -> list[ModeShape]:
    named = {shape.name: shape for _, shape in free_plate_modes(SIZE_MM, 3.0, band_hz=(27600.0, 27900.0))}
    return [named[name] for name in ("13x1-1x13", "10x8-8x10", "13x0", "0x13")]


def test_a_patch_on_a_thin_plate_is_stretched_by_the_curvature_under_it() -> None:
    shapes = [shape for _, shape in free_plate_modes(SIZE_MM, 0.1, band_hz=(960.0, 980.0))]
    places_mm = edge_places(SIZE_MM, PATCH_MM)[::37]
    found = couplings(shapes, places_mm, PATCH_MM, 1.0)
    step_mm = 0.05
    inner = np.linspace(-4.5, 4.5, 10)
    cells = np.stack(np.meshgrid(inner, inner), axis=-1).reshape(-1, 2)
    for shape, row in zip(shapes, found, strict=True):
        for place_mm, stretch in zip(places_mm, row, strict=True):
            points = np.clip(place_mm + cells, -99.9, 99.9)
            around = [points + np.array(offset) * step_mm for offset in ((1, 0), (-1, 0), (0, 1), (0, -1))]
            laplacian = (sum(map(shape.evaluate, around)) - 4.0 * shape.evaluate(points)) / step_mm**2
            assert stretch == pytest.approx(-float(np.sum(laplacian)), abs=0.02 * np.abs(found).max())


@pytest.mark.parametrize("patch_mm", [(10.0, 10.0), (5.0, 5.0), (15.0, 10.0)])
def test_drive_and_sense_matrix_are_better_than_a_thousand_random_ones(
    shapes: list[ModeShape], patch_mm: tuple[float, float]
) -> None:
    random, candidates_mm = np.random.default_rng(1), edge_places(SIZE_MM, patch_mm)
    coupling = couplings(shapes, candidates_mm, patch_mm, 1.65)
    coupling /= np.abs(coupling).max(axis=1, keepdims=True)
    drawn = [random.choice(len(candidates_mm), len(shapes), replace=False) for _ in range(1000)]
    least = np.linalg.svd(coupling.T[drawn], compute_uv=False)[:, -1].max()
    driving = place_patches(shapes, patch_mm, 1.65)
    taken = [Patch(x_mm, y_mm, patch_mm, 0.3) for x_mm, y_mm in driving.places_mm.tolist()]
    sensing = place_patches(shapes, patch_mm, 1.65, taken)
    for patches in (driving, sensing):
        assert np.linalg.svd(patches.coupling, compute_uv=False)[-1] > least
        assert patches.condition < 2.0
    apart_mm = np.abs(driving.places_mm[:, None] - sensing.places_mm)
    assert np.any(apart_mm >= np.array(patch_mm) - 1e-9, axis=2).all()


def test_a_stamp_moves_as_the_worst_point_within_it_and_a_wider_one_more(shapes: list[ModeShape]) -> None:
    stamps = four_stamps(shapes, 2.0)
    angles = np.linspace(0.0, 2.0 * np.pi, 721)
    rim = np.stack((stamps[0].x_mm + 2.0 * np.cos(angles), stamps[0].y_mm + 2.0 * np.sin(angles)), axis=-1)
    assert stamps[0].moved_frac >= 0.97 * float(sum(np.abs(shape.evaluate(rim)) for shape in shapes).max())
    assert four_stamps(shapes, 4.0)[0].moved_frac > 1.2 * stamps[0].moved_frac
    corners = [(one.x_mm > 0.0, one.y_mm > 0.0) for one in stamps]
    assert sorted(corners) == [(False, False), (False, True), (True, False), (True, True)]
