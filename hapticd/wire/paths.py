"""Decoder of a path: points and the speed along them, of a virtual finger or a surface."""

from __future__ import annotations

from ..content_values import VirtualPath
from ..errors import RequestError
from .contents import MAX_POSITION_MM
from .fields import Fields, items, pair

MAX_PATH_POINTS = 64
MAX_SPEED_MM_S, DEFAULT_SPEED_MM_S = 2000.0, 50.0


def read_path(fields: Fields) -> VirtualPath:
    """Read the fields of a path. Raises RequestError."""
    where = fields.place("path_mm")
    points = items(fields.take("path_mm"), MAX_PATH_POINTS, where)
    if not points:
        raise RequestError(f"{where}: needs at least one point.")
    return VirtualPath(
        points_mm=tuple(pair(point, MAX_POSITION_MM, f"{where}[{index}]") for index, point in enumerate(points)),
        speed_mm_s=fields.number("speed_mm_s", 0.0, MAX_SPEED_MM_S, DEFAULT_SPEED_MM_S),
        loop=fields.boolean("loop", default=True),
    )
