"""A minute of guided touching: where two fingers stroke next, so that they meet every ninth of the plate's middle.

A finger stays in a ninth for some seconds, while the other one strokes the opposite ninth.
"""

from __future__ import annotations

from typing import NamedTuple

from .coverage import Ninth

EACH_S = 6.0  # in one pair of places
CORNER = (-1, -1)
# Of one finger, by columns and rows from the middle; the other's are opposite, and a corner where this one is central.
_PLACES = (CORNER, (-1, 0), (-1, 1), (0, 1), (0, 0), (1, 1), (1, 0), (1, -1), (0, -1))
GUIDED_S = EACH_S * (len(_PLACES) + 1)


class GuidedPlaces(NamedTuple):
    """Places (column, row) of two fingers from the middle, -1 .. 1 each, and how long they are to stay."""

    first: tuple[int, int]
    second: tuple[int, int]
    left_s: float

    def sentence(self, of_s: float) -> str:
        """Return what to do, of `of_s` seconds that are left in all."""
        one, other = (Ninth(row + 1, column + 1, 0.0).name for column, row in (self.first, self.second))
        return f"{of_s:3.0f} s left: stroke the {one} with one finger, the {other} with another"


def places_at(t_s: float) -> GuidedPlaces:
    """Return where the fingers are to be `t_s` seconds after the start; at the last places after the end."""
    step = min(int(t_s / EACH_S), len(_PLACES))
    left_s = max((step + 1) * EACH_S - t_s, 0.0)
    if step == len(_PLACES):
        return GuidedPlaces(CORNER, (0, 0), left_s)
    column, row = _PLACES[step]
    return GuidedPlaces((column, row), CORNER if (column, row) == (0, 0) else (-column, -row), left_s)
