"""What a patch takes and gives: a plate capacitor, and reciprocity."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hapticd.design.glued_plate import Patch
from hapticd.design.patch_load import CLAMPED_FRAC, charge_nc_um, moving_ma, patch_load
from hapticd.design.patch_reach import patch_drive

from .sine_mode import sine_mode

PATCHES = (Patch(20.0, 4.0, (10.0, 10.0), 0.3), Patch(-50.0, 12.0, (8.0, 12.0), 0.5))


def test_a_patch_takes_the_current_and_the_power_of_its_glued_capacitance() -> None:
    load = patch_load(PATCHES[0], 29375.0, 150.0)
    assert load.free_nf == pytest.approx(1750.0 * 8.854e-3 * 100.0 / 0.3 * 1e-3)
    assert load.glued_nf == pytest.approx(CLAMPED_FRAC * load.free_nf)
    assert load.peak_ma == pytest.approx(2e-3 * math.pi * 29.375 * load.glued_nf * 150.0)
    assert load.rms_ma == pytest.approx(load.peak_ma / math.sqrt(2.0))
    assert load.apparent_va == pytest.approx(load.rms_ma * 1e-3 * 150.0 / math.sqrt(2.0))
    assert load.loss_w == pytest.approx(0.02 * load.apparent_va)
    assert load.slew_v_us == pytest.approx(27.685, rel=1e-4)


def test_without_volts_it_is_driven_to_what_its_field_or_the_amplifier_allows() -> None:
    assert [patch_load(patch, 29375.0).volts_v for patch in PATCHES] == [90.0, 150.0]


def test_a_moving_mode_gives_back_what_the_patch_drives_it_with() -> None:
    modes = [(29000.0, sine_mode((4, 3))), (29050.0, sine_mode((3, 4)))]
    shapes = [shape for _, shape in modes]
    charge = charge_nc_um(3.0, PATCHES, shapes)
    gain = patch_drive(3.0, PATCHES, modes, 500.0).gain_um_per_v_s
    for mode, (hz, shape) in enumerate(modes):
        newton_per_v = np.abs(gain[mode]) * 2.0 * shape.mass_kg * 2.0 * math.pi * hz / 2e6
        np.testing.assert_allclose(charge[mode], newton_per_v * 0.5e-6 * 1e9)


def test_the_modes_current_is_the_rate_of_their_charge() -> None:
    charge_nc = np.array([[20.0, 5.0], [8.0, 0.0]])
    found_ma = moving_ma(charge_nc, 29375.0, np.array([4.0, 2.0]))
    np.testing.assert_allclose(found_ma, 2e-6 * math.pi * 29375.0 * np.array([96.0, 20.0]))
