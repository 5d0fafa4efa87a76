"""Decoder of one surface, field by field from a received map. The contract is clients/PROTOCOL.md.

It checks types and bounds, so that every shape has an area and every pose an inverse; amplitude limits and the number
of all surfaces are checked in `core.targets`.
"""

from __future__ import annotations

import math

from ..content_values import Blend, Circle, Polygon, Surface, VirtualPath
from ..errors import RequestError
from .contents import MAX_ANGLE_RAD, MAX_POSITION_MM, read_content
from .fields import Fields, pair, points
from .paths import MAX_SPEED_MM_S, read_path

MAX_SURFACES = 16
MAX_POLYGON_POINTS = 16
MIN_SIZE_MM = 0.1  # of a radius, and of a rectangle's sides
MIN_AREA_MM2 = MIN_SIZE_MM**2
MIN_SCALE, MAX_SCALE = 0.01, 100.0
MAX_TURNING_RAD_S = 20 * math.pi
MAX_Z = 1000
MAX_INSTANT_NS = 2**63 - 1
STRAIGHT = ("position_mm", "velocity_mm_s")  # fields that a path replaces
SHAPES = ("circle_mm", "rectangle_mm", "polygon_mm")


def read_surface(fields: Fields) -> tuple[str, Surface]:
    """Read a surface and its name. Raises RequestError."""
    name = fields.label("name")
    path = _path(fields)
    surface = Surface(
        content=read_content(fields),
        shape=_shape(fields),
        position_mm=_pair(fields, "position_mm", MAX_POSITION_MM),
        angle_rad=fields.number("angle_rad", -MAX_ANGLE_RAD, MAX_ANGLE_RAD, 0.0),
        scale=fields.number("scale", MIN_SCALE, MAX_SCALE, 1.0),
        velocity_mm_s=_pair(fields, "velocity_mm_s", MAX_SPEED_MM_S),
        turning_rad_s=fields.number("turning_rad_s", -MAX_TURNING_RAD_S, MAX_TURNING_RAD_S, 0.0),
        t_pose_ns=fields.whole("t_pose_ns", 0, MAX_INSTANT_NS) if "t_pose_ns" in fields else None,
        z=fields.whole("z", -MAX_Z, MAX_Z) if "z" in fields else 0,
        blend=fields.choice("blend", Blend) if "blend" in fields else Blend.REPLACE,
        path=path,
    )
    fields.end()
    return name, surface


def _pair(fields: Fields, name: str, most: float) -> tuple[float, float]:
    return pair(fields.take(name), most, fields.place(name)) if name in fields else (0.0, 0.0)


def _path(fields: Fields) -> VirtualPath | None:
    if "path_mm" not in fields:
        return None
    for name in STRAIGHT:
        if name in fields:
            raise RequestError(f"{fields.place(name)}: a surface with a path_mm has none.")
    return read_path(fields)


def _shape(fields: Fields) -> Circle | Polygon | None:
    given = [name for name in SHAPES if name in fields]
    if len(given) > 1:
        raise RequestError(f"{fields.where}: has at most one of {', '.join(SHAPES)}.")
    if "circle_mm" in fields:
        return Circle(fields.number("circle_mm", MIN_SIZE_MM, MAX_POSITION_MM))
    if "rectangle_mm" in fields:
        return _rectangle(fields)
    return _polygon(fields) if "polygon_mm" in fields else None


def _rectangle(fields: Fields) -> Polygon:
    where = fields.place("rectangle_mm")
    width_mm, height_mm = pair(fields.take("rectangle_mm"), MAX_POSITION_MM, where)
    if not (width_mm >= MIN_SIZE_MM and height_mm >= MIN_SIZE_MM):
        raise RequestError(f"{where}: width and height must be {MIN_SIZE_MM:g} .. {MAX_POSITION_MM:g}.")
    x_mm, y_mm = 0.5 * width_mm, 0.5 * height_mm
    return Polygon(((-x_mm, -y_mm), (x_mm, -y_mm), (x_mm, y_mm), (-x_mm, y_mm)))


def _polygon(fields: Fields) -> Polygon:
    where = fields.place("polygon_mm")
    corners = points(fields.take("polygon_mm"), MAX_POLYGON_POINTS, MAX_POSITION_MM, where)
    if len(corners) < 3:
        raise RequestError(f"{where}: needs three points or more.")
    doubled_mm2 = 0.0
    for index, (x_mm, y_mm) in enumerate(corners):
        before_x_mm, before_y_mm = corners[index - 1]
        doubled_mm2 += before_x_mm * y_mm - x_mm * before_y_mm
    if not abs(doubled_mm2) >= 2.0 * MIN_AREA_MM2:
        raise RequestError(f"{where}: encloses less than {MIN_AREA_MM2:g} mm^2.")
    return Polygon(corners)
