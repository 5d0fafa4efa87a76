"""Patches on a plate: limits with known answers."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.design.free_plate import free_plate_modes
from hapticd.design.glued_plate import Patch, glued_plate_modes
from hapticd.design.materials import MATERIALS

GLASS, SIZE_MM, BAND_HZ = MATERIALS["glass"], (100.0, 80.0), (14000.0, 16000.0)


def test_a_plate_without_patches_has_the_free_plates_modes() -> None:
    free = free_plate_modes(SIZE_MM, 2.0, band_hz=BAND_HZ)
    bare = glued_plate_modes(SIZE_MM, 2.0, GLASS, (), BAND_HZ)
    assert [hz for hz, _ in bare] == pytest.approx([hz for hz, _ in free], rel=1e-6)
    assert [shape.name for _, shape in bare] == [shape.name for _, shape in free]
    points_mm = np.random.default_rng(1).uniform(-40.0, 40.0, (20, 2))
    np.testing.assert_allclose(bare[0][1].evaluate(points_mm), free[0][1].evaluate(points_mm), atol=1e-5)


def test_a_patch_of_the_plates_glass_all_over_it_makes_a_thicker_plate() -> None:
    whole = Patch(0.0, 0.0, SIZE_MM, 0.5, GLASS)
    thicker = [hz for hz, _ in free_plate_modes(SIZE_MM, 2.5, band_hz=BAND_HZ)]
    glued = [hz for hz, _ in glued_plate_modes(SIZE_MM, 2.0, GLASS, (whole,), BAND_HZ)]
    assert glued == pytest.approx(thicker, rel=1e-4)
