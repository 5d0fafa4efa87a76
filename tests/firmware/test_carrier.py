"""The signal chain alone: oscillator, synthesis and demodulation against exact integers, mpmath and least squares."""

from __future__ import annotations

import cmath
import ctypes
import math
from fractions import Fraction

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hapticd.sim.board import firmware
from hapticd.sim.board.carrier import SAMPLE_HZ

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


@settings(max_examples=1000)
@given(DRIVES_HZ)
@example(DRIVE_HZ)
def test_the_step_is_the_nearest_to_the_frequency(drive_hz: float) -> None:
    assert SignalChain(drive_hz).step == round(Fraction(drive_hz) * TURN / SAMPLE_HZ)


@given(st.integers(1, 1 << 40))
def test_the_phase_is_exact_wherever_it_wraps(chunks_before: int) -> None:
    """A jump to any later chunk lands on the phase, and on the samples, that the closed form tells."""
    here = SignalChain(DRIVE_HZ)
    there = SignalChain(DRIVE_HZ, phase=chunks_before * CHUNK * here.step % TURN)
    assert there.phase == ((chunks_before + 2) * CHUNK * here.step) % TURN
    near = SignalChain(DRIVE_HZ, phase=(TURN - here.phase - 7 * here.step) % TURN)
    near.drive((1000.0, 1000.0))
    expected = synthesised(near, near.phase, 1000 + 0j)
    np.testing.assert_array_equal(near.synthesise()[:, 0], expected)
    assert near.phase == 43 * here.step % TURN


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


def test_the_new_frequency_is_heard_as_well_as_the_old_one() -> None:
    """Two chunks of the old one are still on their way: the tick after those is right again."""
    chain = SignalChain(DRIVE_HZ)
    chain.drive((1500j, 700))
    chunks = [np.full((CHUNK, 2), MID_RAIL, dtype=np.uint16)] * 2
    heard = []
    for i in range(40):
        chunks.append(np.empty(0, dtype=np.uint16))
        measured = chain.demodulate(chunks[i])
        heard += [] if measured is None else [measured]
        if i == 19:
            chain.tune(30205.0)
        chunks[i + 2] = chain.synthesise()
    np.testing.assert_allclose(heard[1], (1500j, 700), rtol=3e-4, atol=0.3)
    np.testing.assert_allclose(heard[2], (1500j, 700), rtol=0.02)
    np.testing.assert_allclose(heard[3], (1500j, 700), rtol=3e-4, atol=0.3)


@settings(max_examples=300)
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


def test_a_full_scale_square_wave_fills_the_longest_tick_without_overflow() -> None:
    chain = SignalChain(DRIVE_HZ, 500.0)
    angles_rad = 2 * np.pi * phases(chain, 0, 2000) / TURN
    x = np.where(np.cos(angles_rad) > 0, 2047.0, -2048.0)
    (measured,) = chain.measure(np.stack((sampled(x), sampled(-1 - x)), axis=1))
    assert measured[0] == pytest.approx(least_squares(angles_rad, x), rel=5e-4)
    assert measured[1] == pytest.approx(-measured[0], rel=1e-6)


@pytest.mark.parametrize(
    ("drive_hz", "control_hz"),
    [(0.0, 2000.0), (math.nan, 2000.0), (19999.0, 2000.0), (300000.0, 2000.0), (-DRIVE_HZ, 2000.0)]
    + [(DRIVE_HZ, rate) for rate in (0.0, -2000.0, math.nan, math.inf, 499.0, 3000.0, 1999.0, 20001.0, 1e-30)],
)
def test_rates_that_make_no_sense_are_refused(drive_hz: float, control_hz: float) -> None:
    with pytest.raises(ValueError, match="The firmware refuses"):
        SignalChain(drive_hz, control_hz)
