"""Simulated observers, who compare the plate with a reference as persons do: coarsely, with lapses, leaning to a side.

Each has a friction curve, a Weber fraction and a reference of its own; the noise of its answers is normal.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from ..core.friction import FrictionCurve
from ..design.person import Answer

REFERENCE: Final = 0.17  # the friction that is believed of the reference, relative to bare glass
REFERENCE_SIGMA: Final = 0.05  # of its true one
PERSONS: Final = 1.4  # by which factor the decay differs from the usual one at most
WEBER_SPREAD: Final = 0.2


class ObserverKind(NamedTuple):
    """Weber fraction (three of four right), lapses, and by how much the plate seems more slippery, or less."""

    weber_frac: float
    lapse_frac: float = 0.02
    leaning_frac: float = 0.0


KINDS: Final = {
    "usual": ObserverKind(0.11),
    "keen": ObserverKind(0.07),
    "dull": ObserverKind(0.17),
    "absent": ObserverKind(0.11, lapse_frac=0.1),
    "leaning": ObserverKind(0.11, leaning_frac=0.05),
}


class SimulatedObserver:
    """One observer of a kind."""

    def __init__(self, kind: ObserverKind, seed: int) -> None:
        self._random: Final = np.random.default_rng(seed)
        decay, reference, noise = self._random.uniform(-1.0, 1.0), *self._random.standard_normal(2)
        self.curve: Final = FrictionCurve.exponential(decay_um=0.7 * PERSONS**decay)
        self._seems: Final = REFERENCE * math.exp(REFERENCE_SIGMA * reference + kind.leaning_frac * (-1.0) ** seed)
        self._noise: Final = kind.weber_frac / 0.6745 * math.exp(WEBER_SPREAD * noise)
        self._lapse_frac: Final = kind.lapse_frac

    def compare(self, amplitude_um: float) -> Answer:
        """Return whether the plate seems more slippery than the reference."""
        felt = math.log(self._seems / self.curve.friction(amplitude_um)) + self._noise * self._random.standard_normal()
        guess, lapse = self._random.uniform(-1.0, 1.0), self._random.random() < self._lapse_frac
        return Answer(amplitude_um, bool((guess if lapse else felt) > 0.0))
