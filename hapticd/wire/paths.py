"""Decoder of a path: points and the speed along them, of a virtual finger or a surface."""

from __future__ import annotations

from ..content_values import VirtualPath
from ..errors import RequestError
from .contents import MAX_POSITION_MM
from .fields import Fields, points

MAX_PATH_POINTS = 64
MAX_SPEED_MM_S, DEFAULT_SPEED_MM_S = 2000.0, 50.0


def read_path(fields: Fields) -> VirtualPath:
    """Read the fields of a path. Raises RequestError."""
    where = fields.place("path_mm")
    points_mm = points(fields.take("path_mm"), MAX_PATH_POINTS, MAX_POSITION_MM, where)
    if not points_mm:
        raise RequestError(f"{where}: needs at least one point.")
    return VirtualPath(
        points_mm=points_mm,
        speed_mm_s=fields.number("speed_mm_s", 0.0, MAX_SPEED_MM_S, DEFAULT_SPEED_MM_S),
        loop=fields.boolean("loop", default=True),
    )
