"""Modal amplitudes and mode shapes on plain floats: their types, clamping, and what counts as rounding.

Amplitudes are real (float) until a phase turns, then complex.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

Row = tuple[complex, ...]  # modal amplitudes (M,) in um: plain floats while no phase turns
ModeRow = tuple[float, ...]  # shapes of all modes at one finger, or modal amplitudes
ModeRows = tuple[ModeRow, ...]
Phasors = tuple[complex, ...]
Pair = tuple[float, float]
Shapes2 = tuple[float, float, float, float]  # of two modes at the first finger, then at the second

NOISE: Final = 8 * 2.0**-52  # a sum of products below this share of its terms is rounding, not signal
SAFE: Final = 1e100  # squares of larger numbers, or of their inverses, leave the range of floats
EQUAL_ERROR: Final = 1e-13  # of the targets' scale, squared: solutions that differ by rounding alone
EQUAL_NORM: Final = 1e-9  # least norms of exact solutions carry the conditioning of phi
MISSED: Final = 1e-9  # of a target: a finger that lacks more than this does not get it
_LEAST_SQUARE: Final = 1e-280  # below it a square has lost digits


def re_im(w_um: complex) -> tuple[float, float]:
    """Real and imaginary part: two plain floats in machine code, where a complex number would be an object."""
    if isinstance(w_um, float):
        return w_um, 0.0
    return w_um.real, w_um.imag


def magnitude(w_d_um: float, w_q_um: float) -> float:
    """|w| from both parts, to the last bit but one."""
    if w_q_um == 0.0:
        return abs(w_d_um)
    square = w_d_um * w_d_um + w_q_um * w_q_um
    return math.sqrt(square) if _LEAST_SQUARE < square < math.inf else math.hypot(w_d_um, w_q_um)


def within(modal: Pair, limits: Pair) -> Pair:
    """Clamp each amplitude to its limit: removes what rounding left beyond it."""
    return clamped(modal[0], limits[0]), clamped(modal[1], limits[1])


def clamped(value: float, limit: float) -> float:
    """Clamp a value to +-limit; NaN becomes 0."""
    if -limit <= value <= limit:
        return value
    return math.copysign(limit, value) if value == value else 0.0


def unscaled(reach: float, modal: Sequence[float], limits: ModeRow) -> ModeRow:
    """Amplitudes in units of `reach`, in um and within the limits to the last bit."""
    return tuple([clamped(modal[mode] * reach, limits[mode]) for mode in range(len(limits))])


def all_finite(rows: ModeRows) -> bool:
    """No shape is NaN or infinite."""
    return all(-math.inf < value < math.inf for row in rows for value in row)


def amplitudes(rows: ModeRows, modal: ModeRow) -> list[float]:
    """|w_i| of each finger, from real modal amplitudes."""
    found: list[float] = []
    for row in rows:
        amplitude = abs(_product(row, modal, 1.0))
        if not amplitude < math.inf:  # products beyond the range of floats may still cancel
            size = max([abs(shape) for shape in row])
            amplitude = abs(_product(row, modal, size)) * size
        found.append(amplitude)
    return found


def _product(row: ModeRow, modal: ModeRow, size: float) -> float:
    total = 0.0
    for mode in range(len(row)):
        total += row[mode] / size * modal[mode]
    return total
