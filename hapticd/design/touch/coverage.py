"""Where on the plate a recording shows fingers, and where they are missing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...core.plate.mode_shapes import ModeShapes
from ...values import FloatArray
from .observations import WINDOW_S, Windows

_COLUMNS, _ROWS = ("left", "", "right"), ("lower", "", "upper")


def touched_s(windows: Windows, modes: ModeShapes) -> FloatArray:
    """Return for how long fingers touched each ninth of the plate (3, 3), from its lower left on, rows along x."""
    position, _ = windows.fingers_mm()
    points = position[np.isfinite(position).all(axis=-1) & windows.is_used[..., None]]
    edges = [np.linspace(axis[0], axis[-1], 4)[1:3] for axis in (modes.x_mm, modes.y_mm)]
    column, row = (np.searchsorted(edge, points[:, axis]) for axis, edge in enumerate(edges))
    share_s = len(windows) * WINDOW_S / max(int(windows.is_used.sum()), 1)
    return np.asarray(share_s * np.bincount(3 * row + column, minlength=9).reshape(3, 3), np.float64)


class Ninth(NamedTuple):
    """A ninth of the plate, by row from below and column from the left, 0 .. 2, and how long it was touched."""

    row: int
    column: int
    touched_s: float

    @property
    def name(self) -> str:
        return " ".join(name for name in (_ROWS[self.row], _COLUMNS[self.column]) if name) or "middle"

    def sentence(self, of_s: float) -> str:
        """Return what to do next, after `of_s` seconds of touching."""
        place = f"the {self.name} of the plate"
        return f"Of {of_s:.0f} s of touching {self.touched_s:.0f} s were at {place}: touch there next."


def where_next(windows: Windows, modes: ModeShapes) -> Ninth:
    """Return the ninth of the plate that was touched least."""
    by_place_s = touched_s(windows, modes)
    row, column = divmod(int(np.argmin(by_place_s)), 3)
    return Ninth(row, column, float(by_place_s[row, column]))
