"""The board's limiter to the last bit: what its formula gives in IEEE single precision, in its own modes and no others.

These examples distinguish the limiter from every mutant of it: of each comparison, bound, sign, connective and choice.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pytest

from hapticd.sim.board import firmware

UNTOUCHED, SCALED, NOT_FINITE = range(3)
Floats = npt.NDArray[np.float32]

ROUND_DOWN = np.float32(1) - np.float32(2.0**-21)
OVER = np.float32(1) + np.float32(1e-6)  # what is tolerated above a limit, relative
LIMIT_UM = np.array([4.0, 2.5], dtype=np.float32)
LIMIT_V = np.float32(149.9)
AT_UM = LIMIT_UM[0] * OVER
ABOVE_UM = np.nextafter(AT_UM, np.float32(9))
ABOVE_V = np.nextafter(LIMIT_V, np.float32(200))
MOST = float(np.finfo(np.float32).max)


class Phasor(ctypes.Structure):
    """`hd_phasor_t`"""

    _fields_ = [("d", ctypes.c_float), ("q", ctypes.c_float)]


def between(guard: float, values: Sequence[float] | Floats) -> Floats:
    """The values with two guards on either side: a mode too far is seen."""
    return np.array([guard, guard, *values, guard, guard], dtype=np.float32)


def address(guarded: Floats) -> ctypes.c_void_p:
    return ctypes.c_void_p(guarded.ctypes.data + 2 * guarded.itemsize)


def inside(guarded: Floats) -> Floats:
    """The values again, the guards being what they were."""
    assert guarded[:2].tobytes() == guarded[-2:].tobytes()
    assert np.isnan(guarded[0]) or guarded[0] == 1e6
    return guarded[2:-2]


def magnitude(d: np.float32, q: np.float32) -> np.float32:
    return np.sqrt(d * d + q * q)


AMPLITUDES = [
    [0.3, -0.4, 1.0, 2.0],
    [30.0, 40.0, 0.3, -0.7],
    [0.3, 0.5, -6.0, 8.1],
    [-5.0, 3.1, 3.0, 7.7],
    [6.0, -2.3, 2.0, 2.9],
    [AT_UM, 0.0, 0.0, 0.0],
    [ABOVE_UM, 0.0, 0.1, 0.2],
    [0.0, -AT_UM, 1.0, 0.0],
    [0.0, ABOVE_UM, 1.0, 0.0],
    *[[MOST * (k == place) for k in range(4)] for place in range(4)],  # a number still, and scaled away
]
VOLTAGES = [
    [3.0, -4.0, 100.0, 20.0],
    [300.0, 40.0, 3.0, -7.0],
    [3.0, 5.0, -60.0, 810.0],
    [-500.0, 310.0, 300.0, 7.7],
    [LIMIT_V, 0.0, 0.0, -LIMIT_V],
    [ABOVE_V, 0.0, 0.0, 1.0],
]


def factors(phasors: Floats, limits: Sequence[np.float32], over: np.float32) -> list[np.float32]:
    """By which a phasor above its limit is scaled."""
    with np.errstate(over="ignore"):
        found = [magnitude(*phasors[at : at + 2]) for at in (0, 2)]
    return [
        np.float32(1) if size <= limit * over else ROUND_DOWN * limit / size
        for size, limit in zip(found, limits, strict=True)
    ]


@pytest.mark.parametrize("guard", [np.nan, 1e6])
@pytest.mark.parametrize("values", AMPLITUDES)
def test_amplitudes_are_scaled_together_to_the_last_bit(values: list[float], guard: float) -> None:
    phasors, limits = between(guard, values), between(1e-3, LIMIT_UM)
    factor = min(factors(inside(phasors), LIMIT_UM, OVER))
    wanted = factor * inside(phasors)
    reason = firmware.load(2).hd_limit_amplitudes(address(phasors), address(limits))
    assert reason == (UNTOUCHED if factor == 1 else SCALED)
    np.testing.assert_array_equal(inside(phasors), wanted)


@pytest.mark.parametrize("guard", [np.nan, 1e6])
@pytest.mark.parametrize("values", VOLTAGES)
def test_voltages_are_scaled_each_by_itself_to_the_last_bit(values: list[float], guard: float) -> None:
    voltages = between(guard, values)
    each = factors(inside(voltages), (LIMIT_V, LIMIT_V), np.float32(1))
    wanted = np.repeat(each, 2) * inside(voltages)
    reason = firmware.load(2).hd_limit_voltages(address(voltages), ctypes.c_float(LIMIT_V))
    assert reason == (UNTOUCHED if min(each) == 1 else SCALED)
    np.testing.assert_array_equal(inside(voltages), wanted)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", range(4))
def test_what_is_not_finite_is_silence_in_these_modes_alone(bad: float, place: int) -> None:
    values = [1.0, -1.0, 0.5, 2.0]
    values[place] = bad
    amplitudes, voltages, limits = between(1e6, values), between(1e6, values), between(1e-3, LIMIT_UM)
    library = firmware.load(2)
    assert library.hd_limit_amplitudes(address(amplitudes), address(limits)) == NOT_FINITE
    assert library.hd_limit_voltages(address(voltages), ctypes.c_float(LIMIT_V)) == NOT_FINITE
    for silenced in (amplitudes, voltages):
        assert inside(silenced).tobytes() == bytes(16)


@pytest.mark.parametrize("d", [ABOVE_V, np.float32(-160.5), np.float32(3e19)])
def test_a_phasor_above_its_limit_is_shortened_to_it(d: np.float32) -> None:
    shorten = firmware.load(2).hd_shorten
    shorten.argtypes, shorten.restype = [Phasor, ctypes.c_float], Phasor
    out = shorten(Phasor(d, 0.0), LIMIT_V)
    with np.errstate(over="ignore"):
        found = magnitude(d, np.float32(0))
    assert out.d == ROUND_DOWN * LIMIT_V / found * d
    assert out.q == 0
