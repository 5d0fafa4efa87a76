"""Coverage of the plate by a recording's fingers: where they were, where they lack, how well the map is known there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...core.plate.mode_shapes import ModeShapes
from ...values import FloatArray
from .observations import WINDOW_S, Windows
from .waves import MAP_PRIOR, Waves

_COLUMNS, _ROWS = ("left", "", "right"), ("lower", "", "upper")
_FEW = 0.01
_EACH = 5  # points along each edge of a ninth


def touched_s(windows: Windows, modes: ModeShapes) -> FloatArray:
    """Return for how long fingers touched each ninth of the plate (3, 3), from its lower left on, rows along x."""
    position, _ = windows.fingers_mm()
    points = position[np.isfinite(position).all(axis=-1) & windows.is_used[..., None]]
    edges = [np.linspace(axis[0], axis[-1], 4)[1:3] for axis in (modes.x_mm, modes.y_mm)]
    column, row = (np.searchsorted(edge, points[:, axis]) for axis, edge in enumerate(edges))
    share_s = len(windows) * WINDOW_S / max(int(windows.is_used.sum()), 1)
    return np.asarray(share_s * np.bincount(3 * row + column, minlength=9).reshape(3, 3), np.float64)


def place_name(row: int, column: int) -> str:
    """Return the name of a ninth of the plate, by row from below and column from the left, 0 .. 2."""
    return " ".join(name for name in (_ROWS[row], _COLUMNS[column]) if name) or "middle"


def map_sigma(waves: Waves, precision: FloatArray, modes: ModeShapes) -> FloatArray:
    """Return one sigma of the map with its waves in each ninth of the plate (3, 3), as `touched_s`: RMS over modes and
    places. `precision` (M K, M K) is the inverse of the waves' covariance; what they leave out is as unknown as before.
    """
    inner = (np.arange(3 * _EACH) + 0.5) / (3 * _EACH)
    x_mm, y_mm = (axis[0] + (axis[-1] - axis[0]) * inner for axis in (modes.x_mm, modes.y_mm))
    at = waves.at(np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2))
    covariance = np.linalg.inv(precision).reshape(modes.M, len(waves), modes.M, len(waves))
    variance = np.mean([((at @ covariance[mode, :, mode]) * at).sum(axis=1) for mode in range(modes.M)], axis=0)
    smooth = slice(waves.smooth)
    variance += np.maximum(MAP_PRIOR**2 - (at[:, smooth] ** 2) @ waves.prior[0, smooth] ** 2, 0.0)
    return np.asarray(np.sqrt(variance.reshape(3, _EACH, 3, _EACH).mean(axis=(1, 3))), np.float64)


def known_sentence(sigma: FloatArray) -> str:
    """Return where a map with such sigmas (3, 3) is known best and least."""
    (best, least) = (divmod(int(place), 3) for place in (np.argmin(sigma), np.argmax(sigma)))
    return (
        f"The map found errs by {100.0 * sigma[best]:.1f} % of its peak in the {place_name(*best)} of the plate, by "
        f"{100.0 * sigma[least]:.1f} % in the {place_name(*least)} (one sigma)."
    )


def touched_box(windows: Windows, modes: ModeShapes) -> FloatArray:
    """Return the least and largest x and y (2, 2) of where fingers were, but for a hundredth at either end."""
    position, _ = windows.fingers_mm()
    points = position[np.isfinite(position).all(axis=-1) & windows.is_used[..., None]]
    box = np.quantile(points, (_FEW, 1.0 - _FEW), axis=0)
    return np.clip(box, (modes.x_mm[0], modes.y_mm[0]), (modes.x_mm[-1], modes.y_mm[-1]))


class Ninth(NamedTuple):
    """A ninth of the plate, by row from below and column from the left, 0 .. 2, and how long it was touched."""

    row: int
    column: int
    touched_s: float

    @property
    def name(self) -> str:
        return place_name(self.row, self.column)

    def sentence(self, of_s: float) -> str:
        """Return what to do next, after `of_s` seconds of touching."""
        place = f"the {self.name} of the plate"
        return f"Of {of_s:.0f} s of touching {self.touched_s:.0f} s were at {place}: touch there next."


def where_next(windows: Windows, modes: ModeShapes) -> Ninth:
    """Return the ninth of the plate that was touched least."""
    by_place_s = touched_s(windows, modes)
    return Ninth(*divmod(int(np.argmin(by_place_s)), 3), float(by_place_s.min()))
