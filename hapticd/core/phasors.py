"""Modal amplitudes and mode shapes: their types, and magnitudes to the last bit."""

from __future__ import annotations

import math
from typing import Final

Row = tuple[complex, ...]  # modal amplitudes (M,) in um
ModeRow = tuple[float, ...]  # shapes of all modes at one finger, or real modal amplitudes
ModeRows = tuple[ModeRow, ...]

_LEAST_SQUARE: Final = 1e-280  # below it a square has lost digits


def re_im(w_um: complex) -> tuple[float, float]:
    """Real and imaginary part."""
    return w_um.real, w_um.imag


def magnitude(w_d_um: float, w_q_um: float) -> float:
    """|w| from both parts, to the last bit but one."""
    if w_q_um == 0.0:
        return abs(w_d_um)
    square = w_d_um * w_d_um + w_q_um * w_q_um
    return math.sqrt(square) if _LEAST_SQUARE < square < math.inf else math.hypot(w_d_um, w_q_um)
