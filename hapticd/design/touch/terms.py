"""Terms of the model of the plate, which are linear in its unknowns, and the shapes under fingers."""

from __future__ import annotations

import numpy as np

from ...core.plate.mode_shapes import ModeShapes
from ...values import ComplexArray, FloatArray
from .observations import Windows

DRIFT_EVERY_S = 4.0  # knots of the modes' own rates: splines, as a plate warms up smoothly
MOST_SPANS = 24  # between them, of all sessions: a longer recording gets longer ones


def regressors(windows: Windows) -> ComplexArray:
    """Return what is linear in all modes' rows (B, S, L): amplitudes, voltages, corrections."""
    return np.concatenate((windows.measured_um, windows.voltage_v, windows.behind_um_s), axis=-1)


def own_rates(windows: Windows) -> FloatArray:
    """Return the splines in time (B, S, K) of which the modes' own rates are made: 1, and those of each session."""
    blocks = [np.ones((*windows.t_s.shape, 1))]
    sessions = windows.sessions
    for chosen in sessions:
        t_s = windows.t_s[chosen]
        start_s, end_s = float(t_s.min()), float(t_s.max())
        spans = min(max(1, round((end_s - start_s) / DRIFT_EVERY_S)), max(1, MOST_SPANS // len(sessions)))
        place = (t_s - start_s) / max(end_s - start_s, 1e-9) * spans
        splines = np.zeros((*windows.t_s.shape, spans + 3))
        splines[chosen] = _cubic(place[..., None] - np.arange(-1, spans + 2))
        blocks.append(splines)
    return np.concatenate(blocks, axis=-1)


def _cubic(place: FloatArray) -> FloatArray:
    """The cubic B-spline over (-2, 2)."""
    far, near = np.maximum(2.0 - np.abs(place), 0.0), np.maximum(1.0 - np.abs(place), 0.0)
    return np.asarray((far**3 - 4.0 * near**3) / 6.0, np.float64)


def shapes_at(modes: ModeShapes, points: FloatArray) -> FloatArray:
    """Return shapes and their derivatives along x and y (..., 3, M) at points (..., 2), zero where one is NaN."""
    flat = points.reshape(-1, 2)
    return with_slope(modes.evaluate(flat), modes.gradient(flat)).reshape(*points.shape[:-1], 3, -1)


def with_slope(value: FloatArray, slope: FloatArray) -> FloatArray:
    """Join values (N, K) and gradients (N, K, 2) to (N, 3, K)."""
    return np.concatenate((value[:, None], np.moveaxis(slope, -1, 1)), axis=1)
