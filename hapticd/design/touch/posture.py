"""A pad's own part of its pose: the centroid that a posture's fingers share passes for it, as errors of the map do.

Sessions differ in their postures. The farther apart these are, the less of what is found is the pad's; and the more
there are, the more.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...values import FloatArray
from .fit import Fit
from .model import Calibration
from .observations import Windows

# One sigma of x, y in mm, rotation and scales: of a pad that was placed with care, and of what passes for it in one
# session (laboratories of `sim` on two modes): the centroid that a posture's fingers share, and errors of the map.
USUAL = np.array((0.28, 0.28, 0.003, 0.0017, 0.0017))
PASSING = np.array((0.3, 0.3, 0.0017, 0.003, 0.003))
PASSING_WEIGHT = 8.0  # numbers that it counts as, where postures say how far apart they are
CAUTION = 2.0 / 3.0  # of one session's best share: nine tenths of what it gains on average, less harm where it is wrong
MOVED_MM = 0.85  # of a shift, twice what is found usually: a pad that is farther off was moved


def session_postures_mm(windows: Windows, found: Fit) -> FloatArray:
    """Return where the touches of each session are, the mean of all being 0 (K, 2)."""
    touches = [np.unique(windows.track[chosen]) for chosen in windows.sessions]
    return np.array([found.apart_mm[one[one >= 0]].mean(axis=0) for one in touches])


def pose_share(postures_mm: FloatArray) -> FloatArray:
    """Return which share of the pad's pose (5,) is its own, by the postures (K, 2) that K sessions show."""
    sessions = len(postures_mm)
    passing = PASSING**2
    learned = PASSING_WEIGHT * passing[:2] + ((postures_mm - postures_mm.mean(axis=0)) ** 2).sum(axis=0)
    passing[:2] = learned / (PASSING_WEIGHT + sessions - 1)
    return np.asarray((1.0 - (1.0 - CAUTION) / sessions) * USUAL**2 / (USUAL**2 + passing / sessions), np.float64)


def transferable(windows: Windows, found: Calibration) -> Calibration:
    """Return what of a half's fit is judged on the other: of other sessions, as much of the pose as is its own."""
    if len(windows.sessions) == 1:
        return found
    pad = found.pad.copy()
    pad[: len(USUAL)] *= pose_share(np.zeros((1, 2)))
    return replace(found, pad=pad)


def without_bias(found: Calibration, postures_mm: FloatArray) -> Calibration:
    """Return the share of the pad's pose that is its own; other sessions, with other postures, show the rest. Of a
    pad that was moved it is as far as the shift is above MOVED_MM (James and Stein)."""
    pad = found.pad.copy()
    share = pose_share(postures_mm)
    moved = 1.0 - MOVED_MM**2 / max(float(pad[:2] @ pad[:2]), 1e-12)
    pad[:2] *= np.maximum(share[:2], moved)
    pad[2 : len(USUAL)] *= share[2:]
    return replace(found, pad=pad)
