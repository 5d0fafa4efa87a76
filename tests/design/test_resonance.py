"""The fit of a sweep, and the drive frequency that minimises the largest voltage."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.design.resonance import Resonance, fit_resonance

F_HZ = np.linspace(29145.0, 29265.0, 41)


def resonance(f0_hz: float = 29195.0, q: float = 500.0, gain: float = 5.0, phase_deg: float = 0.0) -> Resonance:
    return Resonance(f0_hz, q, gain, math.radians(phase_deg), 0.002 - 0.001j, 0.0)


def noisy(truth: Resonance, noise_frac: float, seed: int = 1) -> npt.NDArray[np.complex128]:
    rng = np.random.default_rng(seed)
    y = truth.response(F_HZ)
    return y + noise_frac * np.abs(y).max() * (rng.standard_normal(41) + 1j * rng.standard_normal(41))


@given(st.floats(29160, 29250), st.floats(150, 1500), st.floats(0.01, 100), st.floats(-179, 179))
def test_a_resonance_without_noise_is_found_to_many_digits(f0_hz: float, q: float, gain: float, deg: float) -> None:
    truth = resonance(f0_hz, q, gain, deg)
    found = fit_resonance(F_HZ, truth.response(F_HZ))
    assert found.frequency_hz == pytest.approx(f0_hz, abs=1e-4)
    assert found.q_factor == pytest.approx(q, rel=1e-5)
    assert found.gain_um_per_v_s == pytest.approx(gain, rel=1e-5)
    assert math.remainder(found.loop_phase_rad - truth.loop_phase_rad, 2 * math.pi) == pytest.approx(0, abs=1e-5)
    assert found.residual_frac < 1e-8


@pytest.mark.parametrize("phase_deg", [-120.0, 5.3, 175.0])
def test_one_percent_of_noise_moves_the_resonance_by_little(phase_deg: float) -> None:
    truth = resonance(phase_deg=phase_deg)
    for seed in range(20):
        found = fit_resonance(F_HZ, noisy(truth, 0.01, seed))
        assert abs(found.frequency_hz - 29195.0) < 1.0
        assert found.q_factor == pytest.approx(500.0, rel=0.06)
        assert found.gain_um_per_v_s == pytest.approx(5.0, rel=0.06)
        assert abs(math.degrees(found.loop_phase_rad) - phase_deg) < 3.0
        assert found.residual_frac == pytest.approx(0.014, rel=0.3)


def test_what_is_no_resonance_is_refused() -> None:
    growing = np.conj(resonance().response(F_HZ))  # turns the other way: as if it grew
    for f_hz, y, sentence in (
        (F_HZ[:4], np.ones(4, complex), "5 or more points"),
        (np.full(41, 29200.0), np.ones(41, complex), "different frequencies"),
        (F_HZ, np.zeros(41, complex), "no vibration"),
        (F_HZ, np.full(41, complex("nan")), "not finite"),
        (F_HZ, growing, "does not look like a resonance"),
    ):
        with pytest.raises(ValueError, match=sentence):
            fit_resonance(f_hz, y)


def test_a_calibration_has_the_model_in_the_frame_of_the_drive() -> None:
    model = resonance(29195.0, 500.0, 5.0, 60.0).calibration(1).model(29205.0)
    assert model.decay_1_s == pytest.approx(math.pi * 29195 / 500)
    assert model.detuning_rad_s == pytest.approx(-20 * math.pi)
    assert model.gain_um_per_v_s == 5.0
    assert model.loop == pytest.approx(complex(0.5, math.sqrt(0.75)))
