"""Numbers for contacts of a device that gives none: each keeps that of the nearest one of the report before."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from .geometry import PadGeometry

_FARTHEST_MM: Final = 40.0  # between reports: 60 Hz at 2.4 m/s
_NUMBERS: Final = 1 << 16

RawPlace = tuple[int, int]


class ContactNumbers:
    """Nearest pairs first. `core.touch.tracking` judges by how fingers move whether a number can be right."""

    def __init__(self, geometry: PadGeometry) -> None:
        self._units_x, self._units_y = geometry.units_per_mm
        self.reset()

    def reset(self) -> None:
        self._last: dict[int, RawPlace] = {}
        self._next = 0

    def of(self, places: Sequence[RawPlace]) -> list[int]:
        """Return a number for each place (raw units)."""
        distances = sorted(
            (distance_mm, number, index)
            for number, before in self._last.items()
            for index, place in enumerate(places)
            if (distance_mm := self._distance_mm(before, place)) <= _FARTHEST_MM
        )
        found: dict[int, int] = {}
        for _, number, index in distances:
            if index not in found and number not in found.values():
                found[index] = number
        for index in range(len(places)):
            if index not in found:
                found[index] = self._unused()
        self._last = {found[index]: place for index, place in enumerate(places)}
        return [found[index] for index in range(len(places))]

    def _unused(self) -> int:
        """Return a number that no contact has had for long: there are many more numbers than contacts."""
        self._next = (self._next + 1) % _NUMBERS
        return self._next

    def _distance_mm(self, one: RawPlace, other: RawPlace) -> float:
        return math.hypot((one[0] - other[0]) / self._units_x, (one[1] - other[1]) / self._units_y)
