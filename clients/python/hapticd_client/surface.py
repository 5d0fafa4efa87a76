"""Shapes and poses of surfaces, validated like in the daemon."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from .errors import RefusedError
from .targets import MAX_POSITION_MM, MAX_SPEED_MM_S, Fields, number, path_fields

MAX_POLYGON_POINTS = 16
MIN_SIZE_MM = 0.1
MAX_TURNING_RAD_S = 20 * math.pi
MAX_Z = 1000
BLENDS = ("replace", "add", "max")


@dataclass(frozen=True, slots=True)
class Circle:
    """A disc around the surface's position."""

    radius_mm: float

    def fields(self) -> Fields:
        """Return the field of the message. Raises RefusedError."""
        return {"circle_mm": number("radius_mm", self.radius_mm, MIN_SIZE_MM, MAX_POSITION_MM)}


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A rectangle centred on the surface's position."""

    width_mm: float
    height_mm: float

    def fields(self) -> Fields:
        """Return the field of the message. Raises RefusedError."""
        width_mm = number("width_mm", self.width_mm, MIN_SIZE_MM, MAX_POSITION_MM)
        return {"rectangle_mm": [width_mm, number("height_mm", self.height_mm, MIN_SIZE_MM, MAX_POSITION_MM)]}


@dataclass(frozen=True, slots=True)
class Polygon:
    """3 .. 16 corners (x, y) around the surface's position, which enclose 0.01 mm^2 or more."""

    corners_mm: Iterable[Sequence[float]]

    def fields(self) -> Fields:
        """Return the field of the message. Raises RefusedError."""
        try:
            corners = [point("corners_mm", corner, MAX_POSITION_MM) for corner in self.corners_mm]
        except TypeError:
            raise RefusedError("corners_mm: must be a list of points.") from None
        if not 3 <= len(corners) <= MAX_POLYGON_POINTS:
            raise RefusedError(f"corners_mm: has {len(corners)} points, it must have 3 .. {MAX_POLYGON_POINTS}.")
        doubled_mm2 = sum(before[0] * here[1] - here[0] * before[1] for before, here in _pairs(corners))
        if not abs(doubled_mm2) >= 2.0 * MIN_SIZE_MM**2:
            raise RefusedError(f"corners_mm: encloses less than {MIN_SIZE_MM**2:g} mm^2.")
        return {"polygon_mm": corners}


Shape = Circle | Rectangle | Polygon


def surface_fields(
    shape: Shape | None,
    *,
    position_mm: Sequence[float] | None,
    angle_rad: float,
    scale: float,
    velocity_mm_s: Sequence[float] | None,
    turning_rad_s: float,
    t_pose_ns: int | None,
    z: int,
    blend: str,
    path: Iterable[Sequence[float]] | None = None,
    speed_mm_s: float = 50.0,
    loop: bool = True,
) -> Fields:
    """Return the fields of a surface apart from its name and content. Raises RefusedError."""
    if shape is not None and not isinstance(shape, Shape):
        raise RefusedError(f"shape: must be a Circle, a Rectangle or a Polygon, not {repr(shape)[:40]}.")
    if blend not in BLENDS:
        raise RefusedError(f"blend: must be one of {', '.join(BLENDS)}.")
    if path is not None and (position_mm is not None or velocity_mm_s is not None):
        raise RefusedError("path: with it there is no position_mm and no velocity_mm_s.")
    straight = {
        "position_mm": point("position_mm", (0, 0) if position_mm is None else position_mm, MAX_POSITION_MM),
        "velocity_mm_s": point("velocity_mm_s", (0, 0) if velocity_mm_s is None else velocity_mm_s, MAX_SPEED_MM_S),
    }
    return {
        **({} if shape is None else shape.fields()),
        **(straight if path is None else path_fields(path, speed_mm_s, loop)),
        "angle_rad": number("angle_rad", angle_rad, -2 * math.pi, 2 * math.pi),
        "scale": number("scale", scale, 0.01, 100.0),
        "turning_rad_s": number("turning_rad_s", turning_rad_s, -MAX_TURNING_RAD_S, MAX_TURNING_RAD_S),
        **({} if t_pose_ns is None else {"t_pose_ns": _whole("t_pose_ns", t_pose_ns, 0, 2**63 - 1)}),
        "z": _whole("z", z, -MAX_Z, MAX_Z),
        "blend": blend,
    }


def point(name: str, value: Sequence[float], most: float) -> list[float]:
    """Validate two numbers within -`most` .. `most`."""
    try:
        numbers = [number(name, part, -most, most) for part in value]
    except TypeError:
        numbers = []
    if len(numbers) != 2:
        raise RefusedError(f"{name}: must have two numbers, x and y.")
    return numbers


def _whole(name: str, value: int, low: int, high: int) -> int:
    if type(value) is not int or not low <= value <= high:
        raise RefusedError(f"{name}: must be a whole number, {low} .. {high}.")
    return value


def _pairs(corners: list[list[float]]) -> list[tuple[list[float], list[float]]]:
    return [(corners[index - 1], corner) for index, corner in enumerate(corners)]
