"""A surface in force: where its layer is at an instant, what it asks for there, and where its edge is crossed.

Plain arithmetic in the layer's own frame. A position that is not finite is outside of every shape.
"""

from __future__ import annotations

import math
from typing import Final

from hapticd_contract.contents import Content, Noise
from hapticd_contract.surfaces import Circle, Polygon, Surface

from .textures import AmplitudeAt
from .virtual_paths import Walk

OUTSIDE_UM: Final = -1.0  # no amplitude is negative
_Side = tuple[float, float, float, float]  # of a polygon: from x, y to x, y


class Layer:
    """One surface with its owner and its place in the stack. `born` counts layers in the order in which they came."""

    def __init__(
        self, owner: str, surface: Surface, texture: AmplitudeAt, finest_mm: float, born: int, t_pose_ns: int
    ) -> None:
        self.name: Final = surface.name
        self.owner: Final = owner
        self.surface: Final = surface
        self.content: Final[Content] = surface.content
        self.texture = texture
        self.born: Final = born
        self.z: Final = surface.z
        self.t_pose_ns: Final = t_pose_ns
        self.t_expires_ns = t_pose_ns
        self.replaces: Final = surface.blend == "replace"
        self.adds: Final = surface.blend == "add"
        self.finest_mm: Final = finest_mm
        self._x_mm, self._y_mm = surface.position_mm
        self._vx_mm_s, self._vy_mm_s = surface.velocity_mm_s
        path = surface.path
        self._walk: Final = None if path is None else Walk(path, t_pose_ns)
        self._turning_rad_s: Final = surface.turning_rad_s
        self.is_expensive: Final = isinstance(self.content, Noise) or path is not None or surface.turning_rad_s != 0.0
        self._moves: Final = self._vx_mm_s != 0.0 or self._vy_mm_s != 0.0
        self._angle_rad: Final = surface.angle_rad
        self._cos: Final = math.cos(surface.angle_rad)
        self._sin: Final = math.sin(surface.angle_rad)
        self.scale: Final = surface.scale
        shape = surface.shape
        self.is_whole: Final = shape is None
        self._radius_mm: Final = shape.radius_mm if isinstance(shape, Circle) else 0.0
        self._sides: Final = _sides(shape) if isinstance(shape, Polygon) else []
        self.corners: Final = len(self._sides)
        self._reach_mm: Final = _reach_mm(shape) * surface.scale
        self.speed_mm_s: Final = math.hypot(self._vx_mm_s, self._vy_mm_s) if path is None else path.speed_mm_s

    def local_mm(self, x_mm: float, y_mm: float, t_ns: int) -> tuple[float, float]:
        """Return a place of the plate in the layer's frame."""
        x_mm, y_mm = self._from_origin(x_mm, y_mm, t_ns)
        cos, sin = self._cos, self._sin
        if self._turning_rad_s != 0.0:
            angle_rad = self._angle_rad + (t_ns - self.t_pose_ns) * 1e-9 * self._turning_rad_s
            cos, sin = math.cos(angle_rad), math.sin(angle_rad)
        return (cos * x_mm + sin * y_mm) / self.scale, (cos * y_mm - sin * x_mm) / self.scale

    def amplitude_um(self, x_mm: float, y_mm: float, t_ns: int) -> float:
        """Return what the layer asks for at a place of the plate; OUTSIDE_UM beyond its shape."""
        if self.is_far(x_mm, y_mm, t_ns):
            return OUTSIDE_UM
        u_mm, v_mm = self.local_mm(x_mm, y_mm, t_ns)
        return self.texture(u_mm, v_mm) if self.holds(u_mm, v_mm) else OUTSIDE_UM

    def is_far(self, x_mm: float, y_mm: float, t_ns: int, way_mm: float = 0.0) -> bool:
        """Return whether a place, and a way of `way_mm` from it, is certainly beyond the shape: most are, of most."""
        if self.is_whole:
            return False
        x_mm, y_mm = self._from_origin(x_mm, y_mm, t_ns)
        reach_mm = self._reach_mm + way_mm
        return not x_mm * x_mm + y_mm * y_mm <= reach_mm * reach_mm

    def turns_ns(self, t_ns: int, span_ns: int, most: int) -> list[int]:
        """Return the corners of its path within a span, as `Walk.turns_ns`."""
        return [] if self._walk is None else self._walk.turns_ns(t_ns, span_ns, most)

    def _from_origin(self, x_mm: float, y_mm: float, t_ns: int) -> tuple[float, float]:
        """Return a place of the plate relative to the layer's origin, along the plate's axes."""
        if self._walk is not None:
            origin_x_mm, origin_y_mm = self._walk.position_mm(t_ns)
            return x_mm - origin_x_mm, y_mm - origin_y_mm
        x_mm -= self._x_mm
        y_mm -= self._y_mm
        if self._moves:
            since_s = (t_ns - self.t_pose_ns) * 1e-9
            x_mm -= since_s * self._vx_mm_s
            y_mm -= since_s * self._vy_mm_s
        return x_mm, y_mm

    def covers(self, x_mm: float, y_mm: float, t_ns: int) -> bool:
        """Return whether a place of the plate is within the layer's shape."""
        u_mm, v_mm = self.local_mm(x_mm, y_mm, t_ns)
        return self.holds(u_mm, v_mm)

    def holds(self, u_mm: float, v_mm: float) -> bool:
        """Return whether a place of the layer's frame is within its shape."""
        if self.is_whole:
            return True
        if self._radius_mm > 0.0:
            return u_mm * u_mm + v_mm * v_mm <= self._radius_mm * self._radius_mm
        inside = False
        for from_u, from_v, to_u, to_v in self._sides:
            is_crossed = (from_v > v_mm) != (to_v > v_mm)
            if is_crossed and u_mm < from_u + (v_mm - from_v) * (to_u - from_u) / (to_v - from_v):
                inside = not inside
        return inside

    def crossings(self, from_u: float, from_v: float, to_u: float, to_v: float) -> list[float]:
        """Return at which shares (0 .. 1) of a straight way in the layer's frame it crosses the shape's edge."""
        du, dv = to_u - from_u, to_v - from_v
        length_mm = math.sqrt(du * du + dv * dv)
        if self.is_whole or not length_mm > 0.0:
            return []
        if self._radius_mm > 0.0:
            return _circle_crossings(from_u, from_v, du, dv, self._radius_mm)
        shares: list[float] = []
        for side_u, side_v, end_u, end_v in self._sides:
            eu, ev = end_u - side_u, end_v - side_v
            cross = du * ev - dv * eu
            if cross == 0.0:
                continue
            share = ((side_u - from_u) * ev - (side_v - from_v) * eu) / cross
            along = ((side_u - from_u) * dv - (side_v - from_v) * du) / cross
            if 0.0 <= share <= 1.0 and 0.0 <= along <= 1.0:
                shares.append(share)
        shares.sort()
        return shares


def _circle_crossings(u_mm: float, v_mm: float, du: float, dv: float, radius_mm: float) -> list[float]:
    a = du * du + dv * dv
    half_b = u_mm * du + v_mm * dv
    root2 = half_b * half_b - a * (u_mm * u_mm + v_mm * v_mm - radius_mm * radius_mm)
    if not root2 > 0.0:
        return []
    root = math.sqrt(root2)
    return [share for share in ((-half_b - root) / a, (-half_b + root) / a) if 0.0 <= share <= 1.0]


def _sides(polygon: Polygon) -> list[_Side]:
    points = polygon.corners_mm
    return [(*points[index - 1], *points[index]) for index in range(len(points))]


def _reach_mm(shape: Circle | Polygon | None) -> float:
    """Return the largest distance of a shape from its origin, and some more, so that rounding loses no place of it."""
    if shape is None:
        return math.inf
    if isinstance(shape, Circle):
        return shape.radius_mm * (1.0 + 1e-9)
    return max([math.hypot(x_mm, y_mm) for x_mm, y_mm in shape.corners_mm]) * (1.0 + 1e-9)
