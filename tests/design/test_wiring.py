"""The fit of modes and wires to sweeps whose truth is known, and its refusals."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from hapticd.design.wiring import AmplifierSweep, MeasuredWiring, fit_wiring

F_HZ = np.linspace(29105.0, 29305.0, 41)
MODES_HZ = np.array([29195.0, 29215.0, 29250.0])
DECAY_1_S = 183.5
THROUGH_UM_PER_V = 0.004 - 0.002j
SUM_AND_DIFFERENCE = np.array([[1.0, 1.0], [1.0, -1.0]])
SWAP, INVERT = np.array([[0.0, 1.0], [1.0, 0.0]]), np.diag([1.0, -1.0])


def sweeps(
    drives: npt.ArrayLike,
    senses: npt.ArrayLike,
    *,
    noise_um_per_v: float = 1e-5,
    all_hz: npt.NDArray[np.float64] = MODES_HZ,
) -> list[AmplifierSweep]:
    """Responses of modes that `drives` (M, M) amplifiers move by 5 um/(V s), and that `senses` (M, M) sensors see."""
    gain, seen = 5.0 * np.asarray(drives), np.asarray(senses)
    modes_hz, random = all_hz[: len(gain)], np.random.default_rng(3)
    found = []
    for amplifier in range(len(gain)):
        turned = -1j * np.exp(0.3j) * gain[:, amplifier]
        modal = turned / (DECAY_1_S - 2j * np.pi * (modes_hz - F_HZ[:, None]))
        noise = noise_um_per_v * random.standard_normal((2, len(F_HZ), len(gain)))
        found.append(AmplifierSweep(amplifier, F_HZ, modal @ seen.T + THROUGH_UM_PER_V + noise[0] + 1j * noise[1]))
    return found


def is_decoupled(found: MeasuredWiring, drives: npt.ArrayLike, senses: npt.ArrayLike) -> bool:
    """Whether the calibration turns this plate into modes that are driven and seen one by one, at their gains."""
    modes = found.calibrations()
    drive, sense = np.array([mode.drive for mode in modes]).T, np.array([mode.sense for mode in modes])
    whole = sense @ np.asarray(senses) @ (5.0 * np.asarray(drives)) @ drive
    turned = np.diag(whole) * np.exp(0.3j)
    gains = [mode.gain_um_per_v_s * np.exp(1j * mode.loop_phase_rad) for mode in modes]
    return bool(np.allclose(whole, np.diag(np.diag(whole)), atol=0.05) and np.allclose(turned, gains, rtol=0.01))


@pytest.mark.parametrize("senses", [np.eye(2), SUM_AND_DIFFERENCE / np.sqrt(2.0), [[1.0, 0.05], [-0.03, 1.0]]])
@pytest.mark.parametrize("drives", [np.eye(2), SUM_AND_DIFFERENCE, [[1.0, 0.2], [0.1, 0.7]]])
def test_any_wiring_is_decoupled(drives: npt.ArrayLike, senses: npt.ArrayLike) -> None:
    found = fit_wiring(sweeps(drives, senses))
    assert is_decoupled(found, drives, np.asarray(senses) / np.linalg.norm(senses, axis=0))
    for fit, f_hz in zip(found.fits, MODES_HZ, strict=False):
        assert fit.frequency_hz == pytest.approx(f_hz, abs=0.1)
        assert fit.q_factor == pytest.approx(np.pi * f_hz / DECAY_1_S, rel=0.01)
        assert fit.residual_frac < 0.01
    np.testing.assert_allclose(found.background_um_per_v, THROUGH_UM_PER_V, atol=3e-4)


@pytest.mark.parametrize("wires", [np.eye(2), SUM_AND_DIFFERENCE])
def test_swapped_and_inverted_wires_are_named(wires: npt.NDArray[np.float64]) -> None:
    assert fit_wiring(sweeps(wires, wires)).wrong_wires() == []
    for drives, senses in ((wires @ SWAP, wires), (wires, SWAP @ wires)):
        (sentence,) = fit_wiring(sweeps(drives, senses)).wrong_wires()
        assert sentence.startswith("Amplifiers 0 and 1, or their sensors, are swapped")
    for drives, senses in ((wires @ INVERT, wires), (wires, INVERT @ wires)):
        (sentence,) = fit_wiring(sweeps(drives, senses)).wrong_wires()
        assert sentence.startswith("Amplifier 1 or sensor 1 is inverted")


@pytest.mark.parametrize("drives", [SUM_AND_DIFFERENCE, [[1.0, 0.8], [0.7, -0.4]], [[1.0, -0.6], [-0.9, -1.0]]])
def test_amplifiers_that_move_both_sensors_alike_have_no_inverted_or_swapped_ones(drives: npt.ArrayLike) -> None:
    """As the paper's amplifiers, sum and difference, with a sensor for each mode."""
    found = fit_wiring(sweeps(drives, np.eye(2)))
    assert found.wrong_wires() == []
    assert is_decoupled(found, drives, np.eye(2))


def test_sweeps_that_show_no_two_resonances_are_refused() -> None:
    with pytest.raises(ValueError, match="resonances"):
        fit_wiring(sweeps([[1.0, 0.0], [0.0, 1e-6]], np.eye(2), noise_um_per_v=0.0))
    with pytest.raises(ValueError, match="5 or more points"):
        fit_wiring(
            [AmplifierSweep(one.amplifier, F_HZ[:4], one.response_um_per_v[:4]) for one in sweeps(np.eye(2), np.eye(2))]
        )
    with pytest.raises(ValueError, match="not finite"):
        fit_wiring([AmplifierSweep(k, F_HZ, np.full((41, 2), np.nan + 0j)) for k in range(2)])
    with pytest.raises(ValueError, match="no vibration"):
        fit_wiring([AmplifierSweep(k, F_HZ, np.zeros((41, 2), complex)) for k in range(2)])


def test_eight_modes_are_told_apart_by_sensors_where_two_are_within_5_percent() -> None:
    """As on the wide plate, by the noise of its sweeps."""
    all_hz = 29205.0 + np.array([-90.0, -70.0, -50.0, 0.0, 17.2, 18.2, 60.0, 80.0])
    senses = np.eye(8) + 0.01 * (1.0 - np.eye(8))
    found = fit_wiring(sweeps(np.eye(8), senses, noise_um_per_v=4e-6, all_hz=all_hz))
    assert [fit.frequency_hz for fit in found.fits] == pytest.approx(all_hz, abs=0.05)
    seen = np.array([mode.sense for mode in found.calibrations()]) @ senses
    assert np.abs(seen / np.diag(seen)[:, None] - np.eye(8)).max() < 0.01
