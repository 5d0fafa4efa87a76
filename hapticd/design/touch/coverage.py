"""Where on the plate a recording shows fingers, and where they are missing."""

from __future__ import annotations

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


def where_next(windows: Windows, modes: ModeShapes) -> str:
    """Say in a sentence which ninth of the plate was touched least."""
    by_place_s = touched_s(windows, modes)
    row, column = np.unravel_index(int(np.argmin(by_place_s)), by_place_s.shape)
    place = " ".join(name for name in (_ROWS[row], _COLUMNS[column]) if name) or "middle"
    touched = len(windows) * WINDOW_S
    return (
        f"Of {touched:.0f} s of touching {by_place_s[row, column]:.0f} s were at the {place} of the plate: "
        "touch there next."
    )
