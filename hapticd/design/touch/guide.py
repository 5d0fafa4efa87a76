"""A minute of guided touching: which quarter of the plate's middle each of two fingers strokes next.

They are in opposite quarters, so that the plate moves differently under each. Smaller places teach less: strokes are
shorter and slower there, and cross fewer waves.
"""

from __future__ import annotations

from typing import NamedTuple

from .coverage import Ninth

EACH_S = 5.0  # in one pair of places
_PLACES = ((-1, -1), (-1, 1), (1, 1), (1, -1))  # of one finger, by column and row from the middle
_ROUNDS = 3
GUIDED_S = EACH_S * _ROUNDS * len(_PLACES)


class GuidedPlaces(NamedTuple):
    """Quarters (column, row) of two fingers from the middle, -1 or 1 each."""

    first: tuple[int, int]
    second: tuple[int, int]

    def sentence(self, of_s: float) -> str:
        """Return what to do, of `of_s` seconds that are left in all."""
        one, other = (Ninth(row + 1, column + 1, 0.0).name for column, row in (self.first, self.second))
        return f"{of_s:3.0f} s left: stroke the {one} quarter with one finger, the {other} one with another"


def places_at(t_s: float) -> GuidedPlaces:
    """Return where the fingers are to be `t_s` seconds after the start; at the last places after the end."""
    step = min(int(t_s / EACH_S), _ROUNDS * len(_PLACES) - 1)
    column, row = _PLACES[step % len(_PLACES)]
    return GuidedPlaces((column, row), (-column, -row))
