"""Live view in a terminal: positions, targets, achieved amplitudes, limits, latency, rates.

Redrawn in place on a terminal, one line a second elsewhere.
"""

from __future__ import annotations

import math
import os
from collections import deque
from collections.abc import Sequence
from itertools import zip_longest
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from hapticd_client import PlateState

REDRAW_S = 0.1
LINE_S = 1.0
RATE_OVER = 64
COLUMNS, ROWS = 45, 15
DEFAULT_COLUMNS = 80  # of a terminal that does not report its width
LEAST_UM = 0.005  # less is shown as 0
CLEAR_TO_END = "\x1b[J"


class LiveView:
    """Draws telemetry states at a readable rate. `update` takes every state and the time."""

    def __init__(self, out: TextIO, size_mm: Sequence[float]) -> None:
        self._out = out
        self._size_mm = size_mm
        self._in_place = out.isatty()
        self._instants_s: deque[float] = deque(maxlen=RATE_OVER)
        self._t_drawn_s = -float("inf")
        self._lines = 0
        self._limited = 0
        self._states = 0

    def update(self, state: PlateState, t_now_s: float) -> None:
        """Count a state; draw it if a redraw is due."""
        self._instants_s.append(t_now_s)
        self._states += 1
        self._limited += bool(state.limited)
        if t_now_s - self._t_drawn_s < (REDRAW_S if self._in_place else LINE_S):
            return
        self._t_drawn_s = t_now_s
        lines = self._picture(state) if self._in_place else [self._line(state)]
        if self._in_place:  # a line that wraps would be two, and shift the next picture
            width = _columns(self._out)
            lines = [line[:width] for line in lines]
        if self._in_place and self._lines > 0:
            self._out.write(f"\x1b[{self._lines}A\r{CLEAR_TO_END}")
        self._out.write("\n".join(lines) + "\n")
        self._out.flush()
        self._lines = len(lines)

    def _rate_hz(self) -> float:
        if len(self._instants_s) < 2:
            return 0.0
        span_s = self._instants_s[-1] - self._instants_s[0]
        return (len(self._instants_s) - 1) / span_s if span_s > 0 else 0.0

    def _line(self, state: PlateState) -> str:
        fingers = "  ".join(
            f"{finger.id}: {_um(finger.target_um)} -> {_um(finger.achieved_um)} um" for finger in state.fingers
        )
        flag = "  limited" if state.limited else ""
        return f"{state.state:<7} {self._rate_hz():5.1f}/s  horizon {state.horizon_ms:4.1f} ms  {fingers}{flag}"

    def _picture(self, state: PlateState) -> list[str]:
        lines = [
            "+" + "-" * COLUMNS + "+",
            *(f"|{row}|" for row in _plate(state, self._size_mm)),
            "+" + "-" * COLUMNS + "+",
        ]
        lines.append(f"{'finger':<10}{'x mm':>8}{'y mm':>8}{'target um':>11}{'actual um':>10}")
        lines += [
            f"{finger.id!s:<10}{finger.x_mm:>8.1f}{finger.y_mm:>8.1f}"
            f"{_um(finger.target_um):>11}{_um(finger.achieved_um):>10}"
            for finger in state.fingers
        ]
        phasors = _phasors(state)
        names = "XYZ" if len(phasors) <= 3 else "12345678"
        modes = "  ".join(f"W{name} {w}" for name, w in zip(names, phasors, strict=False))
        share = self._limited / self._states
        lines.append(f"{modes} um   {'LIMITED' if state.limited else '       '} ({share:.0%} of the time)")
        lines.append(
            f"{state.state:<7} {self._rate_hz():5.1f} passes/s   sample {state.age_ms:4.1f} ms old   "
            f"horizon {state.horizon_ms:4.1f} ms"
        )
        return lines


def _columns(out: TextIO) -> int:
    try:
        return os.get_terminal_size(out.fileno()).columns or DEFAULT_COLUMNS
    except (OSError, ValueError):  # an object that only claims to be a terminal
        return DEFAULT_COLUMNS


def _plate(state: PlateState, size_mm: Sequence[float]) -> list[str]:
    """Return the plate from above: a slippery finger is drawn as o, a sticky one as #, one without target as +."""
    rows = [[" "] * COLUMNS for _ in range(ROWS)]
    for finger in state.fingers:
        if not (math.isfinite(finger.x_mm) and math.isfinite(finger.y_mm)):
            continue
        column = round((finger.x_mm / size_mm[0] + 0.5) * (COLUMNS - 1))
        row = round((0.5 - finger.y_mm / size_mm[1]) * (ROWS - 1))
        if 0 <= column < COLUMNS and 0 <= row < ROWS:
            target_um = finger.target_um
            rows[row][column] = "+" if target_um is None else "#" if target_um == 0 else "o"
    return ["".join(row) for row in rows]


def _phasors(state: PlateState) -> list[str]:
    """Return the modes' amplitudes, with imaginary parts while slipping fingers differ in phase."""
    parts_um = zip_longest(state.modal_um, state.modal_q_um, fillvalue=0.0)
    is_turned = any(abs(q_um) >= LEAST_UM for q_um in state.modal_q_um)
    return [f"{d_um:+.2f}{q_um:+.2f}j" if is_turned else f"{d_um:+.2f}" for d_um, q_um in parts_um]


def _um(amplitude_um: float | None) -> str:
    return "-" if amplitude_um is None else f"{amplitude_um:.2f}"
