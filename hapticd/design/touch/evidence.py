"""How much better a calibration fits touches that did not teach it: by the plate's own sensors against what they
should read.

The residual's square is summed over turns of a second, which then count alike: a few with much residual would hide the
others. Turns are as good as independent, so that their spread tells how sure the mean is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .fit import Fit
from .observations import Windows

TURN_S = 1.0
SURE = 3.0  # standard errors
WORTH_FRAC = 0.002  # of the residual's square: less is not felt


class HeldOutGain(NamedTuple):
    """By how much of itself the residual's square falls, and of how many standard errors a turn's gain is."""

    frac: float
    standard_errors: float


def gain_of(windows: Windows, before: Fit, after: Fit) -> HeldOutGain:
    """Return what one fit gains over another on the same windows; both costs are in units of the same noise."""
    turn = np.unique(np.floor(windows.start_s / TURN_S), return_inverse=True)[1]
    before_cost, after_cost = np.bincount(turn, before.cost), np.bincount(turn, after.cost)
    worth = np.log(before_cost / after_cost)
    error = float(np.std(worth)) / np.sqrt(len(worth)) + 1e-12
    return HeldOutGain(float(1.0 - after_cost.sum() / before_cost.sum()), float(worth.mean()) / error)
