"""How much better a calibration fits touches that did not teach it: by the plate's own sensors against what they
should read.

The residual's square is summed over turns of a second, which then count alike: a few with much residual would hide the
others. Turns are as good as independent, so that their spread tells how sure the mean is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...core.plate.mode_shapes import ModeShapes
from ...core.plate.parasitic_modes import ParasiticModes
from .fit import Fit, fit
from .model import LEAST_SIZED_MODES, Calibration, Free
from .observations import Windows

TURN_S = 1.0
FEWEST_TURNS = 5  # whose spread tells something
SURE = 3.0  # standard errors
WORTH_FRAC = 0.002  # of the residual's square: less is not felt


class HeldOutGain(NamedTuple):
    """By how much of itself the residual's square falls, and of how many standard errors a turn's gain is."""

    frac: float
    standard_errors: float

    @property
    def is_worse(self) -> bool:
        """Whether these touches alone show that the calibration does harm."""
        return self.frac <= -WORTH_FRAC and self.standard_errors <= -SURE

    @property
    def is_sure(self) -> bool:
        """Whether these touches alone show that it is right."""
        return self.frac >= WORTH_FRAC and self.standard_errors >= SURE


def gain_of(windows: Windows, before: Fit, after: Fit) -> HeldOutGain:
    """Return what one fit gains over another on the same windows; both costs are in units of the same noise."""
    turn = np.unique(np.floor(windows.start_s / TURN_S), return_inverse=True)[1]
    before_cost, after_cost = np.bincount(turn, before.cost), np.bincount(turn, after.cost)
    worth = np.log(before_cost / after_cost)
    error = float(np.std(worth)) / np.sqrt(len(worth)) + 1e-12
    return HeldOutGain(float(1.0 - after_cost.sum() / before_cost.sum()), float(worth.mean()) / error)


class Taken(NamedTuple):
    """What the plate is taken to be: its map, and pad and sensors relative to the configured ones."""

    modes: ModeShapes
    calibration: Calibration

    @classmethod
    def as_configured(cls, modes: ModeShapes) -> Taken:
        """Return the plate as it was scanned and calibrated."""
        return cls(modes, Calibration.nominal(modes.M))


def gained(
    windows: Windows, configured: Taken, in_force: Taken, parasitic_modes: ParasiticModes | None = None
) -> HeldOutGain | None:
    """Return what the calibration in force gains on touches that came after it; None for too few of them."""
    if len(np.unique(np.floor(windows.start_s / TURN_S))) < FEWEST_TURNS:
        return None
    are_points = configured.modes.M < LEAST_SIZED_MODES
    before = fit(
        *(windows, configured.modes, Free(), configured.calibration),
        parasitic_modes=parasitic_modes,
        are_points=are_points,
    )
    after = fit(
        *(windows, in_force.modes, Free(), in_force.calibration),
        judged_by_um_s=before.noise_um_s,
        parasitic_modes=parasitic_modes,
        are_points=are_points,
    )
    return gain_of(windows, before, after)
