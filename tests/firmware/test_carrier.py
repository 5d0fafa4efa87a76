"""The signal chain alone: oscillator, synthesis and demodulation against exact integers, mpmath and least squares."""

from __future__ import annotations

import cmath
import ctypes
import math

import numpy as np
import numpy.typing as npt
import pytest
from carrier_board import SAMPLE_HZ
from hypothesis import example, given
from hypothesis import strategies as st

from hapticd.sim.board import firmware

from .signal_chain import CHUNK, MID_RAIL, SignalChain

TURN = 1 << 32
ENTRIES, ONE = 8192, 16384
DRIVE_HZ = 29205.0
LARGEST_LSB = 2047.0

PHASES = st.integers(0, TURN - 1)
DRIVES_HZ = st.floats(20000.0, 125000.0, width=32)

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]


def table() -> tuple[Integers, Integers]:
    """cos and -sin of all entries."""
    words = np.array((ctypes.c_uint32 * ENTRIES).in_dll(firmware.load(2), "hd_sine_table"), dtype=np.uint32)
    halves = words.view(np.int16).reshape(-1, 2).astype(np.int64)
    return halves[:, 0], halves[:, 1]


def phases(chain: SignalChain, start: int, samples: int) -> Integers:
    return (start + chain.step * np.arange(samples, dtype=np.int64)) % TURN


def sampled(steps: Floats) -> npt.NDArray[np.uint16]:
    """What a 12-bit converter gives: nearest steps around mid-rail, right-aligned in 16 bits."""
    return np.clip(np.floor(steps + 2048.5), 0, 4095).astype(np.uint16)


def steps(samples: npt.NDArray[np.uint16]) -> Integers:
    return samples.astype(np.int64) - MID_RAIL


def least_squares(angles_rad: Floats, x: Floats) -> complex:
    """The amplitude of the best a cos - b sin + c, in float64."""
    columns = np.stack((np.cos(angles_rad), -np.sin(angles_rad), np.ones_like(angles_rad)), axis=1)
    d, q, _ = np.linalg.lstsq(columns, x, rcond=None)[0]
    return complex(d, q)


def synthesised(chain: SignalChain, phase: int, level_lsb: complex) -> npt.NDArray[np.uint16]:
    """A chunk by exact integers: sixteenths of a step times 2^14, rounded once to a step."""
    index = (phases(chain, phase, CHUNK) + TURN // ENTRIES // 2) % TURN // (TURN // ENTRIES)
    cosine, minus_sine = table()
    d, q = (
        round(np.sign(part) * np.floor(np.float32(16 * abs(part)) + np.float32(0.5)))
        for part in (level_lsb.real, level_lsb.imag)
    )
    total = d * cosine[index] + q * minus_sine[index] + (16 * MID_RAIL + 8) * ONE
    return (total // (16 * ONE)).astype(np.uint16)


@given(PHASES, DRIVES_HZ, st.floats(0, LARGEST_LSB - 1), st.floats(-math.pi, math.pi))
def test_samples_are_those_of_exact_integer_arithmetic(
    phase: int, drive_hz: float, magnitude: float, angle_rad: float
) -> None:
    level = np.complex64(cmath.rect(magnitude, angle_rad))
    chain = SignalChain(drive_hz, phase=phase, modes=3)
    chain.drive((level, 0, level))
    expected = synthesised(chain, chain.phase, complex(level))
    samples = chain.synthesise()
    np.testing.assert_array_equal(samples[:, 0], expected)
    np.testing.assert_array_equal(samples[:, 1], MID_RAIL)
    np.testing.assert_array_equal(samples[:, 2], expected)


@given(st.floats(LARGEST_LSB, 1e17), st.floats(-math.pi, math.pi), PHASES)
def test_a_level_out_of_range_keeps_its_phase_and_never_wraps(magnitude: float, angle_rad: float, phase: int) -> None:
    chain, bounded = (SignalChain(DRIVE_HZ, phase=phase) for _ in range(2))
    chain.drive((cmath.rect(magnitude, angle_rad),) * 2)
    bounded.drive((cmath.rect(LARGEST_LSB, angle_rad),) * 2)
    samples = chain.synthesise()
    assert np.abs(np.diff(steps(samples), axis=0)).max() < 0.2 * 2048
    assert np.abs(steps(samples) - steps(bounded.synthesise())).max() <= 1


@given(
    st.floats(25000, 60000, width=32),
    PHASES,
    st.floats(20, 1900),
    st.floats(-math.pi, math.pi),
    st.floats(-140, 140),
    st.sampled_from([500.0, 2000.0, 5000.0]),
)
@example(31250.0, TURN // ENTRIES // 2, 1900.0, 0.0, 0.0, 2000.0)  # 32 entries for ever, each as wrong as can be
@example(DRIVE_HZ, 0, 20.0, 1.0, 140.0, 5000.0)
def test_the_amplitude_is_that_of_least_squares_within_half_a_thousandth(
    drive_hz: float, phase: int, magnitude: float, angle_rad: float, offset: float, control_hz: float
) -> None:
    chain = SignalChain(drive_hz, control_hz, phase=phase)
    angles_rad = 2 * np.pi * phases(chain, phase, round(SAMPLE_HZ / control_hz)) / TURN
    wave = sampled(magnitude * np.cos(angles_rad + angle_rad) + offset)
    (measured,) = chain.measure(np.stack((wave, wave), axis=1))
    expected = least_squares(angles_rad, steps(wave).astype(np.float64))
    # the weights of a pair's samples are off by +- tan(half a step) of the other axis: no matter for a sinusoid, but
    # half a step of rounding in every sample may add up where the frequency meets the same few phases for ever
    rounding = 0.5 * 4 / math.pi * math.tan(math.pi * drive_hz / SAMPLE_HZ)
    assert measured[0] == measured[1]
    assert abs(measured[0] - expected) < 0.0005 * (magnitude + abs(offset)) + rounding


@pytest.mark.parametrize(
    ("drive_hz", "control_hz"),
    [(0.0, 2000.0), (math.nan, 2000.0), (19999.0, 2000.0), (300000.0, 2000.0), (-DRIVE_HZ, 2000.0)]
    + [(DRIVE_HZ, rate) for rate in (0.0, -2000.0, math.nan, math.inf, 499.0, 3000.0, 1999.0, 20001.0, 1e-30)],
)
def test_rates_that_make_no_sense_are_refused(drive_hz: float, control_hz: float) -> None:
    with pytest.raises(ValueError, match="The firmware refuses"):
        SignalChain(drive_hz, control_hz)
