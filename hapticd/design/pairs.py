"""Which two modes a plate could be driven with: near a frequency, close to each other, and unlike each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from .free_plate import ModeShape

THEORY_FRAC = 0.01  # of the frequency: what a plate's modulus and thickness are known to, at best


@dataclass(frozen=True, slots=True)
class ModePair:
    """Two modes, the lower first. `next_hz` is how far the nearest other mode lies from either, inf where none is
    known: nearer than a few f / Q it is driven too."""

    frequency_hz: tuple[float, float]
    shapes: tuple[ModeShape, ModeShape]
    next_hz: float

    @property
    def centre_hz(self) -> float:
        """Half-way between the two."""
        return sum(self.frequency_hz) / 2.0

    @property
    def splitting_hz(self) -> float:
        """From the one to the other."""
        return self.frequency_hz[1] - self.frequency_hz[0]

    @property
    def name(self) -> str:
        """Both shapes' nodal lines."""
        return " + ".join(shape.name for shape in self.shapes)


def mode_pairs(
    modes: Sequence[tuple[float, ModeShape]], near_hz: float, most_splitting_hz: float
) -> tuple[ModePair, ...]:
    """The pairs of `modes` (as `free_plate_modes` gives them) that lie close enough together.

    Those nearest to `near_hz` come first, in steps of what theory is good to, and of these the one whose next mode is
    farthest away.
    """
    pairs = []
    for one, other in combinations(sorted(modes, key=lambda mode: mode[0]), 2):
        if other[0] - one[0] > most_splitting_hz:
            continue
        others_hz = [
            abs(hz - mine_hz) for hz, shape in modes for mine_hz in (one[0], other[0]) if _is_new(shape, one, other)
        ]
        next_hz = min(others_hz, default=float("inf"))
        pairs.append(ModePair((one[0], other[0]), (one[1], other[1]), next_hz))
    return tuple(
        sorted(
            pairs, key=lambda pair: (round(abs(pair.centre_hz / near_hz - 1.0) / THEORY_FRAC), -round(pair.next_hz, 3))
        )
    )


def _is_new(shape: ModeShape, one: tuple[float, ModeShape], other: tuple[float, ModeShape]) -> bool:
    return shape is not one[1] and shape is not other[1]
