"""Targets of fingers, validated like in the daemon.

All targets of a client share one message, and one invalid value would make the daemon refuse the whole message.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol, SupportsFloat, SupportsIndex

from .errors import RefusedError

Fields = dict[str, object]

MAX_AMPLITUDE_UM = 1000.0
MAX_LEVEL = 255  # of a map's pixel
MAX_MAP_SIDE = 128
MAX_MARKER_CHARACTERS = 100
MAX_PATH_POINTS = 64
MAX_POSITION_MM = 1000.0
MAX_PRIORITY = 3
MAX_SPEED_MM_S = 2000.0
MIN_TTL_S, MAX_TTL_S = 0.02, 5.0
NOT_ROWS = "must have rows of numbers, such as a two-dimensional array."


@dataclass(frozen=True, slots=True)
class Grating:
    """Stripes across `angle_rad` (anticlockwise from +x), with a crest of `high_um` through the plate's centre.

    A sine between the two amplitudes, or for `duty_frac` above 0 a square wave with that share of the period high.
    """

    period_mm: float
    high_um: float
    low_um: float = 0.0
    angle_rad: float = 0.0
    duty_frac: float = 0.0

    def fields(self) -> Fields:
        """Return the fields of the message. Raises RefusedError."""
        return {
            "period_mm": number("period_mm", self.period_mm, 0.1, 1000.0),
            "high_um": number("high_um", self.high_um, 0.0, MAX_AMPLITUDE_UM),
            "low_um": number("low_um", self.low_um, 0.0, MAX_AMPLITUDE_UM),
            "angle_rad": number("angle_rad", self.angle_rad, -2 * math.pi, 2 * math.pi),
            "duty_frac": number("duty_frac", self.duty_frac, 0.0, 1.0),
        }


@dataclass(frozen=True, slots=True)
class Gradient:
    """An amplitude from `from_um` to `to_um`, linear along `angle_rad` over `length_mm` around the centre."""

    length_mm: float
    to_um: float
    from_um: float = 0.0
    angle_rad: float = 0.0

    def fields(self) -> Fields:
        """Return the fields of the message. Raises RefusedError."""
        return {
            "length_mm": number("length_mm", self.length_mm, 0.1, 1000.0),
            "angle_rad": number("angle_rad", self.angle_rad, -2 * math.pi, 2 * math.pi),
            "from_um": number("from_um", self.from_um, 0.0, MAX_AMPLITUDE_UM),
            "to_um": number("to_um", self.to_um, 0.0, MAX_AMPLITUDE_UM),
        }


@dataclass(frozen=True, slots=True)
class Noise:
    """A random texture with wavelengths from `shortest_mm` to `longest_mm`, the same for the same `seed`.

    `rms_um` is the deviation from `mean_um`, cut at three times as much and at 0. The height of a wave is proportional
    to its wavelength to the power `exponent`: 0 gives all octaves the same height, 1 looks alike at each scale.
    """

    shortest_mm: float
    longest_mm: float
    rms_um: float
    mean_um: float
    exponent: float = 0.0
    seed: int = 0

    def fields(self) -> Fields:
        """Return the fields of the message. Raises RefusedError."""
        shortest_mm = number("shortest_mm", self.shortest_mm, 0.1, 1000.0)
        if type(self.seed) is not int or not 0 <= self.seed < 2**32:
            raise RefusedError("seed: must be a whole number, 0 .. 4294967295.")
        return {
            "seed": self.seed,
            "shortest_mm": shortest_mm,
            "longest_mm": number("longest_mm", self.longest_mm, shortest_mm, 1000.0),
            "exponent": number("exponent", self.exponent, 0.0, 4.0),
            "mean_um": number("mean_um", self.mean_um, 0.0, MAX_AMPLITUDE_UM),
            "rms_um": number("rms_um", self.rms_um, 0.0, MAX_AMPLITUDE_UM),
        }


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
            rows = [[number("map", value, 0.0, MAX_AMPLITUDE_UM) for value in row] for row in rows_um]
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
    def from_image(cls, path: str | os.PathLike[str], high_um: float, low_um: float = 0.0) -> Map:
        """Make a map of a picture file, in grey: white is `high_um`, black `low_um`; swap the two for a negative.

        The plate is square: the middle square of the picture is used, scaled down to at most 128 x 128, with the
        camera's orientation applied. Transparent parts are black. Needs Pillow, the extra `image`.
        Raises HapticdError without Pillow, RefusedError for a file that is no picture.
        """
        from .image import grey_rows

        return cls(grey_rows(path, MAX_MAP_SIDE), high_um, low_um)

    def fields(self) -> Fields:
        """Return the fields of the message. Raises RefusedError."""
        if isinstance(self.rows, Asset):
            image: Fields = {"width": self.rows.width, "height": self.rows.height, "asset": self.rows.digest}
        else:
            width, height, levels = levels_of(self.rows, MAX_MAP_SIDE)
            image = {"width": width, "height": height, "levels": levels}
        if (self.high_um is None) == (self.frictions is None):
            raise RefusedError("map: give exactly one of high_um and frictions.")
        if self.frictions is not None:
            return {**image, "friction": _two_frictions(self.frictions)}
        return {
            **image,
            "low_um": number("low_um", self.low_um, 0.0, MAX_AMPLITUDE_UM),
            "high_um": number("high_um", self.high_um, 0.0, MAX_AMPLITUDE_UM),
        }


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


def _two_frictions(frictions: Sequence[float]) -> list[float]:
    ends = [number("frictions", friction, 0.0, 1.0) for friction in frictions]
    if len(ends) != 2:
        raise RefusedError("frictions: must have two numbers, of level 0 and of level 255.")
    return ends


def target_fields(
    *,
    friction: float | None,
    amplitude_um: float | None,
    grating: Grating | None,
    image: Map | None,
    gradient: Gradient | None = None,
    noise: Noise | None = None,
    where: str = "set",
) -> Fields:
    """Return the field of the one given argument; `where` is the caller in errors. Raises RefusedError."""
    given: Fields = {}
    if friction is not None:
        given["friction"] = number("friction", friction, 0.0, 1.0)
    if amplitude_um is not None:
        given["amplitude_um"] = number("amplitude_um", amplitude_um, 0.0, MAX_AMPLITUDE_UM)
    kinds = {
        "grating": (grating, Grating),
        "map": (image, Map),
        "gradient": (gradient, Gradient),
        "noise": (noise, Noise),
    }
    for name, (value, kind) in kinds.items():
        if value is not None and not isinstance(value, kind):
            raise RefusedError(f"{name}: must be a {kind.__name__}, not {_shown(value)}.")
        if value is not None:
            given[name] = value.fields()
    if len(given) != 1:
        raise RefusedError(f"{where}: give exactly one of friction, amplitude_um, {', '.join(kinds)}.")
    return given


def priority_field(priority: int) -> Fields:
    """Return the field of a target's priority; none for 0, which an older daemon serves too. Raises RefusedError."""
    if type(priority) is not int or not 0 <= priority <= MAX_PRIORITY:
        raise RefusedError(f"priority: must be a whole number, 0 .. {MAX_PRIORITY}.")
    return {"priority": priority} if priority > 0 else {}


def path_fields(points_mm: Iterable[Sequence[float]], speed_mm_s: float, loop: bool) -> Fields:
    """Return the fields of a virtual finger's path. Raises RefusedError."""
    try:
        points = [[number("position", value, -MAX_POSITION_MM, MAX_POSITION_MM) for value in one] for one in points_mm]
    except TypeError:
        raise RefusedError("path: a point has two numbers, x and y.") from None
    if not 1 <= len(points) <= MAX_PATH_POINTS:
        raise RefusedError(f"path: has {len(points)} points, it must have 1 .. {MAX_PATH_POINTS}.")
    if any(len(point) != 2 for point in points):
        raise RefusedError("path: a point has two numbers, x and y.")
    speed = number("speed_mm_s", speed_mm_s, 0.0, MAX_SPEED_MM_S)
    return {"path_mm": points, "speed_mm_s": speed, "loop": bool(loop)}


def number(name: str, value: object, low: float, high: float) -> float:
    """Validate a number within low .. high; NaN is refused."""
    try:
        given = math.nan if isinstance(value, str) else float(value)  # type: ignore[arg-type]
    except TypeError:
        given = math.nan
    if math.isnan(given) and not isinstance(value, float):
        raise RefusedError(f"{name}: must be a number, not {_shown(value)}.")
    if low <= given <= high:
        return given
    raise RefusedError(f"{name}: {given:g} is out of bounds, it must be {low:g} .. {high:g}.")


def label(name: str, value: object) -> str:
    """Validate a name of 1 .. 32 printable characters."""
    return printable(name, value, 32)


def printable(name: str, value: object, longest: int) -> str:
    """Validate a text of 1 .. `longest` printable characters."""
    if isinstance(value, str) and 1 <= len(value) <= longest and value.isprintable():
        return value
    raise RefusedError(f"{name}: must have 1 .. {longest} printable characters.")


def _shown(value: object) -> str:
    return repr(value)[:40]
