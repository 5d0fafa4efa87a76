"""Candidate pairs of modes to drive a plate with: near a frequency and close to each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from .mode_shape import ModeShape

THEORY_FRAC = 0.01  # of the frequency: the accuracy of a plate's modulus and thickness, at best


@dataclass(frozen=True, slots=True)
class ModePair:
    """Two modes, the lower first. `next_hz` is the distance of the nearest other mode, inf where none is known: one
    nearer than a few f / Q is driven too."""

    frequency_hz: tuple[float, float]
    shapes: tuple[ModeShape, ModeShape]
    next_hz: float

    @property
    def centre_hz(self) -> float:
        """The mean of both frequencies."""
        return sum(self.frequency_hz) / 2.0

    @property
    def splitting_hz(self) -> float:
        """The difference of both frequencies."""
        return self.frequency_hz[1] - self.frequency_hz[0]

    @property
    def name(self) -> str:
        """Both shapes' names."""
        return " + ".join(shape.name for shape in self.shapes)


def mode_pairs(
    modes: Sequence[tuple[float, ModeShape]], near_hz: float, most_splitting_hz: float
) -> tuple[ModePair, ...]:
    """Return the pairs of `modes` (as of `GluedPlate`) at most `most_splitting_hz` apart.

    They are sorted by distance from `near_hz`, in steps of THEORY_FRAC, then by distance of the next mode, farthest
    first.
    """
    pairs = []
    for one, other in combinations(sorted(modes, key=lambda mode: mode[0]), 2):
        if other[0] - one[0] > most_splitting_hz:
            continue
        rest_hz = [hz for hz, shape in modes if shape is not one[1] and shape is not other[1]]
        next_hz = min((abs(hz - own_hz) for hz in rest_hz for own_hz in (one[0], other[0])), default=float("inf"))
        pairs.append(ModePair((one[0], other[0]), (one[1], other[1]), next_hz))

    def rank(pair: ModePair) -> tuple[int, float]:
        return round(abs(pair.centre_hz / near_hz - 1.0) / THEORY_FRAC), -round(pair.next_hz, 3)

    return tuple(sorted(pairs, key=rank))
