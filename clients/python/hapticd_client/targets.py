"""Targets of fingers: maps of rows, pictures and assets, and the one content of a target."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol, SupportsFloat, SupportsIndex

from hapticd_contract.base import AmplitudeUm
from hapticd_contract.contents import CONTENTS, MAX_MAP_SIDE, NAMES, GivenContent, LevelMap

from .checks import checked, plain, shown
from .errors import RefusedError

MAX_LEVEL = 255  # of a map's pixel
NOT_ROWS = "must have rows of numbers, such as a two-dimensional array."


@dataclass(frozen=True, slots=True)
class Asset:
    """Levels of a map that the daemon has, as `Client.asset` returns it: give it to a Map instead of rows."""

    digest: bytes
    width: int
    height: int
    levels: bytes = field(repr=False, compare=False)


class LevelRow(Protocol):
    """A row of levels: a list, bytes, or a row of an array."""

    def __len__(self) -> int: ...

    def __iter__(self) -> Iterator[SupportsIndex]: ...


class LevelRows(Protocol):
    """Rows of equal length: nested lists, or a two-dimensional array."""

    def __iter__(self) -> Iterator[LevelRow]: ...


RowsUm = Iterable[Iterable[SupportsFloat]]


@dataclass(frozen=True, slots=True)
class Map:
    """An image over the whole plate. `rows` from the top (+y) down contain levels 0 .. 255, from left to right.

    Level 0 is `low_um`, 255 is `high_um`; between pixels the amplitude is interpolated. At most 128 x 128, for example
    a numpy array of uint8; with an Asset instead of rows 1024 x 1024. `frictions`, of level 0 and 255, instead of the
    amplitudes make it a map of frictions. `from_um` takes amplitudes instead of levels, `from_image` a picture.
    """

    rows: LevelRows | Asset
    high_um: float | None = None
    low_um: float = 0.0
    frictions: tuple[float, float] | None = None

    @classmethod
    def from_um(cls, rows_um: RowsUm) -> Map:
        """Make a map of amplitudes (um), such as a two-dimensional numpy array, in 255 steps from minimum to maximum.

        Raises RefusedError for NaN and values out of bounds.
        """
        try:
            rows = [[plain("map", value, AmplitudeUm) for value in row] for row in rows_um]
        except TypeError:
            raise RefusedError(f"map: {NOT_ROWS}") from None
        low_um = min((min(row, default=math.inf) for row in rows), default=math.inf)
        high_um = max((max(row, default=-math.inf) for row in rows), default=-math.inf)
        if not low_um <= high_um:
            raise RefusedError("map: has no pixels.")
        step_um = (high_um - low_um) / MAX_LEVEL
        levels = [[round((value - low_um) / step_um) if step_um > 0 else 0 for value in row] for row in rows]
        return cls(levels, high_um, low_um)

    @classmethod
    def from_image(
        cls,
        path: str | os.PathLike[str],
        high_um: float | None = None,
        low_um: float = 0.0,
        *,
        frictions: tuple[float, float] | None = None,
    ) -> Map:
        """Make a map of a picture file, in grey: white is `high_um`, black `low_um`, or `frictions` are those of black
        and white; swap the two for a negative.

        The plate is square: the middle square of the picture is used, scaled down to at most 128 x 128, with the
        camera's orientation applied. Transparent parts are black. Needs Pillow, the extra `image`.
        Raises HapticdError without Pillow, RefusedError for a file that is no picture.
        """
        from .image import grey_rows

        return cls(grey_rows(path, MAX_MAP_SIDE), high_um, low_um, frictions)

    @property
    def message(self) -> LevelMap:
        """The map as a message has it. Raises RefusedError."""
        if (self.high_um is None) == (self.frictions is None):
            raise RefusedError("map: give exactly one of high_um and frictions.")
        friction: Any = self.frictions
        if isinstance(self.rows, Asset):
            asset = self.rows
            made = LevelMap(asset.width, asset.height, b"", self.low_um, self.high_um, asset.digest, friction)
        else:
            made = LevelMap(*levels_of(self.rows, MAX_MAP_SIDE), self.low_um, self.high_um, None, friction)
        return checked(made)


def levels_of(rows: LevelRows, most_side: int) -> tuple[int, int, bytes]:
    """Return width, height and levels of rows. Raises RefusedError."""
    try:
        listed = list(rows)
        height, width = len(listed), len(listed[0]) if listed else 0
        has_one_width = all(len(row) == width for row in listed)
    except TypeError:
        raise RefusedError(f"map: {NOT_ROWS}") from None
    if not (1 <= width <= most_side and 1 <= height <= most_side):
        raise RefusedError(f"map: {width} x {height} pixels, each side must have 1 .. {most_side}.")
    if not has_one_width:
        raise RefusedError("map: all rows must have the same length.")
    try:
        return width, height, b"".join(row if type(row) is bytes else bytes(list(row)) for row in listed)
    except (TypeError, ValueError):
        raise RefusedError("map: levels must be whole numbers from 0 to 255.") from None


def content_fields(where: str, given: GivenContent) -> dict[str, Any]:
    """Return the field of the one content; `where` is the caller in errors. Raises RefusedError, and TypeError for an
    unknown name."""
    contents = {name: value for name, value in given.items() if value is not None}
    for name, value in contents.items():
        if name not in _KINDS:
            raise TypeError(f"{where}() got an unexpected keyword argument {name!r}")
        if name not in ("amplitude_um", "friction") and not isinstance(value, _KINDS[name]):
            raise RefusedError(f"{name}: must be a {_KINDS[name].__name__}, not {shown(value)}.")
    if len(contents) != 1:
        raise RefusedError(f"{where}: give exactly one of {', '.join(CONTENTS)}.")
    return {name: value.message if isinstance(value, Map) else value for name, value in contents.items()}


_KINDS: dict[str, type] = {name: kind for kind, name in NAMES.items()} | {"map": Map}
