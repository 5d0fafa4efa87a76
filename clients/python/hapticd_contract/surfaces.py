"""Surfaces: content that lies on the plate, in a shape, with a pose and a motion."""

from __future__ import annotations

import math
from typing import Annotated, Any, Final, Literal

from msgspec import Meta

from .base import MAX_POSITION_MM, AngleRad, Contract, Name, Place, Whole, problem_of_name
from .contents import Content, Contents, content_fields

MIN_SIZE_MM: Final = 0.1  # of a radius, and of a rectangle's sides
MIN_AREA_MM2: Final = MIN_SIZE_MM**2
MAX_POLYGON_POINTS: Final = 16
MAX_PATH_POINTS: Final = 64
MAX_SPEED_MM_S: Final = 2000.0
MAX_TURNING_RAD_S: Final = 20.0 * math.pi

SizeMm = Annotated[float, Meta(ge=MIN_SIZE_MM, le=MAX_POSITION_MM)]
Corners = Annotated[tuple[Place, ...], Meta(min_length=3, max_length=MAX_POLYGON_POINTS)]
PathPoints = Annotated[tuple[Place, ...], Meta(min_length=1, max_length=MAX_PATH_POINTS)]
SpeedMmS = Annotated[float, Meta(ge=0.0, le=MAX_SPEED_MM_S)]
SignedMmS = Annotated[float, Meta(ge=-MAX_SPEED_MM_S, le=MAX_SPEED_MM_S)]
Blend = Literal["replace", "add", "max"]


class Circle(Contract, frozen=True):
    """A disc around the surface's position."""

    radius_mm: SizeMm


class Rectangle(Contract, frozen=True):
    """A rectangle centred on the surface's position."""

    width_mm: SizeMm
    height_mm: SizeMm


class Polygon(Contract, frozen=True):
    """3 .. 16 corners (x, y) around the surface's position, which enclose 0.01 mm² or more. Inside is where a ray
    outwards crosses the sides an odd number of times, so that sides may cross each other."""

    corners_mm: Corners


Shape = Circle | Rectangle | Polygon


class VirtualPath(Contract, frozen=True):
    """A polyline walked at constant speed, back and forth with `loop`, else to its last point; one point is a place of
    rest."""

    path_mm: PathPoints
    """points on the plate; with one it rests there"""
    speed_mm_s: SpeedMmS = 50.0
    """constant along the path"""
    loop: bool = True
    """back and forth; else it stops at the last point"""


class VirtualFinger(VirtualPath, frozen=True, kw_only=True):
    """A finger that is on no pad: it walks along a path, and may have a target under its name."""

    name: Name
    """unique across all clients"""

    @property
    def path(self) -> VirtualPath:
        """Its way."""
        return VirtualPath(self.path_mm, self.speed_mm_s, self.loop)

    def problem(self) -> str:
        return problem_of_name(self.name, ".name")


class Surface(Contents, frozen=True, kw_only=True):
    """A layer on the plate: content within a shape, felt by any finger that has no target of its own.

    Content and shape (without one: everywhere) are in the layer's frame, which is scaled, turned anticlockwise and
    moved to `position_mm` at `t_pose_ns` (by default when it arrives), and moves on from there with its velocity, or
    instead along a path, from its first point on. Of two layers the one with the larger `z` is on top.
    """

    name: Name
    """unique in its message"""
    circle_mm: SizeMm | None = None
    """a radius around the origin"""
    rectangle_mm: tuple[SizeMm, SizeMm] | None = None
    """width and height, centred on the origin"""
    polygon_mm: Corners | None = None
    """corners that enclose 0.01 mm² or more. At most one of the three; without, the whole plate"""
    position_mm: Place = (0.0, 0.0)
    """where the origin of the layer lies on the plate"""
    angle_rad: AngleRad = 0.0
    """of shape and content, anticlockwise around the origin"""
    scale: Annotated[float, Meta(ge=0.01, le=100.0)] = 1.0
    """of shape and content, not of amplitudes"""
    velocity_mm_s: tuple[SignedMmS, SignedMmS] = (0.0, 0.0)
    """of the origin"""
    path_mm: PathPoints | None = None
    """path of the origin from `t_pose_ns` on, instead of position and velocity. `hello` lists `surface_path` as
    `optional`"""
    speed_mm_s: SpeedMmS = 50.0
    """along the path"""
    loop: bool = True
    """back and forth along the path"""
    turning_rad_s: Annotated[float, Meta(ge=-MAX_TURNING_RAD_S, le=MAX_TURNING_RAD_S)] = 0.0
    """angular velocity"""
    t_pose_ns: Whole | None = None
    """instant of position and angle, on the axis of telemetry's `t_ns`; default: when the message arrives"""
    z: Annotated[int, Meta(ge=-1000, le=1000)] = 0
    """the larger is on top; of equals the last"""
    blend: Blend = "replace"
    """with the amplitude of the layers below; a sum is at most the plate's limit"""

    @classmethod
    def of(
        cls,
        content: Content,
        shape: Shape | None = None,
        position_mm: tuple[float, float] = (0.0, 0.0),
        *,
        name: str = "",
        path: VirtualPath | None = None,
        **more: Any,
    ) -> Surface:
        """Return a surface of parts; `more` are its other fields."""
        way = {} if path is None else {one: getattr(path, one) for one in VirtualPath.__struct_fields__}
        return cls(name=name, position_mm=position_mm, **content_fields(content), **shape_field(shape), **way, **more)

    @property
    def shape(self) -> Circle | Polygon | None:
        """The shape, a rectangle as a polygon; None for the whole plate."""
        if self.circle_mm is not None:
            return Circle(self.circle_mm)
        if self.rectangle_mm is not None:
            x_mm, y_mm = 0.5 * self.rectangle_mm[0], 0.5 * self.rectangle_mm[1]
            return Polygon(((-x_mm, -y_mm), (x_mm, -y_mm), (x_mm, y_mm), (-x_mm, y_mm)))
        return None if self.polygon_mm is None else Polygon(self.polygon_mm)

    @property
    def path(self) -> VirtualPath | None:
        """The way of its origin; None for one with a velocity."""
        return None if self.path_mm is None else VirtualPath(self.path_mm, self.speed_mm_s, self.loop)

    def problem(self) -> str:
        shapes = (self.circle_mm, self.rectangle_mm, self.polygon_mm)
        if sum([shape is not None for shape in shapes]) > 1:
            return f": has at most one of {', '.join(SHAPES)}."
        if self.polygon_mm is not None and not area_mm2(self.polygon_mm) >= MIN_AREA_MM2:
            return f".polygon_mm: encloses less than {MIN_AREA_MM2:g} mm^2."
        if self.path_mm is not None:
            for name in ("position_mm", "velocity_mm_s"):
                if getattr(self, name) != (0.0, 0.0):
                    return f".{name}: a surface with a path_mm has none."
        return problem_of_name(self.name, ".name") or super().problem()


SHAPES: Final = ("circle_mm", "rectangle_mm", "polygon_mm")


def shape_field(shape: Shape | None) -> dict[str, Any]:
    """Return the field of a surface with this shape; none for the whole plate."""
    match shape:
        case None:
            return {}
        case Circle(radius_mm):
            return {"circle_mm": radius_mm}
        case Rectangle(width_mm, height_mm):
            return {"rectangle_mm": (width_mm, height_mm)}
        case Polygon(corners_mm):
            return {"polygon_mm": corners_mm}


def area_mm2(corners_mm: tuple[tuple[float, float], ...]) -> float:
    """Return the area within a polygon; what its sides go around twice in the same sense counts twice."""
    doubled_mm2 = 0.0
    before_x_mm, before_y_mm = corners_mm[-1]
    for x_mm, y_mm in corners_mm:
        doubled_mm2 += before_x_mm * y_mm - x_mm * before_y_mm
        before_x_mm, before_y_mm = x_mm, y_mm
    return 0.5 * abs(doubled_mm2)
