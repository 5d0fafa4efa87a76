"""Stress, heat, current and sound of a plate whose figures are elementary."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from hapticd.design import ModeShape
from hapticd.design.felt_search import FeltDesign
from hapticd.design.glued_plate import GluedPlate, Patch
from hapticd.design.materials import MATERIALS
from hapticd.design.patch_reach import capacitance_f, patch_drive
from hapticd.design.plate_bounds import bounds, stress_mpa

from .sine_mode import SIZE_MM, sine_mode

GLASS, WAVES = MATERIALS["glass"], (4, 3)
PATCH = Patch(20.0, 0.0, (10.0, 10.0), 0.3)


@pytest.fixture(scope="module")
def sine() -> ModeShape:
    """sin(k_x x) sin(k_y y)."""
    return sine_mode(WAVES)


@pytest.fixture
def design(sine: ModeShape) -> FeltDesign:
    plate = GluedPlate(SIZE_MM, 3.0, GLASS, (PATCH,))
    modes = ((29000.0, sine),)
    driven = patch_drive(3.0, plate.patches, modes, 500.0)
    um, volts = np.full((10, 1), 4.0), np.full((10, 1), 80.0)
    return FeltDesign(plate, 29000.0, modes, 300.0, driven, 1.0, (5.0,), 1.0, (1.0,), 1.0, um, volts)


def test_stress_is_that_of_the_bending_moment_of_a_sinusoidal_mode(sine: ModeShape, design: FeltDesign) -> None:
    kx, ky = (2.0 * math.pi * n / (edge_mm * 1e-3) for n, edge_mm in zip(WAVES, SIZE_MM, strict=True))
    at_antinode_pa = 72.5e9 / (1.0 - 0.22**2) * 1.5e-3 * max(kx**2 + 0.22 * ky**2, ky**2 + 0.22 * kx**2) * 0.5e-6
    assert stress_mpa(sine, 3.0, GLASS) == pytest.approx(at_antinode_pa * 1e-6, rel=0.02)
    assert bounds(design, 500.0)[0].value == pytest.approx(5.0 * stress_mpa(sine, 3.0, GLASS))


def test_heat_is_what_the_modes_and_the_ceramic_lose(design: FeltDesign) -> None:
    omega = 2.0 * math.pi * 29000.0
    modes_w = sine_mode(WAVES).mass_kg * omega**3 * (2e-6) ** 2 / (2.0 * 500.0)
    ceramic_w = omega * capacitance_f(PATCH) * 80.0**2 / 2.0 * 0.02
    detuned_hz = bounds(design, 500.0)[1].value
    per_w = 2.0 / (10.0 * 2.0 * 0.160 * 0.120)
    assert detuned_hz == pytest.approx((modes_w + ceramic_w) * per_w)


def test_current_is_that_of_the_clamped_capacitance(design: FeltDesign) -> None:
    assert capacitance_f(PATCH) == pytest.approx(3.1e-9, rel=0.01)
    assert bounds(design, 500.0)[2].value == pytest.approx(1e3 * 2.0 * math.pi * 29000.0 * 3.1e-9 * 80.0, rel=0.01)


def test_a_bound_says_whether_it_is_kept(design: FeltDesign) -> None:
    stress, *_, sound = bounds(design, 500.0)
    assert stress.is_kept
    assert "MPa" in str(stress)
    assert ", within 70 (" in str(stress)
    assert not sound.is_kept
    assert ", BEYOND 100 (" in str(sound)


def test_modes_of_nearly_one_frequency_turn_into_each_other(design: FeltDesign, sine: ModeShape) -> None:
    def with_gap(gap_hz: float) -> FeltDesign:
        modes = tuple((hz, sine) for hz in (29000.0, 29100.0, 29100.0 + gap_hz))
        return replace(design, modes=modes, limits_um=(5.0,) * 3, modal_um=np.full((10, 3), 4.0))

    near, far = with_gap(2.0), with_gap(20.0)
    turn = bounds(near, 500.0)[3]
    assert turn.value == pytest.approx(math.degrees(math.atan(2.0 * 2.0 / 2.0) / 2.0))
    assert not turn.is_kept
    assert "2 Hz apart" in str(turn)
    assert bounds(far, 500.0)[3].is_kept
    assert far.rank > replace(near, felt_frac=1.0).rank
    assert far.rank < replace(far, felt_frac=1.1).rank
    assert replace(far, felt_frac=0.0).rank < near.rank
