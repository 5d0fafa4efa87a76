"""Surfaces on the page: each layer's shape, pose, motion and content, as the daemon describes them.

Content that varies over its layer becomes a small picture of amplitudes, which the page draws in the layer's frame.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from hapticd_contract.contents import NAMES, Amplitude, Content, Friction, Grating
from hapticd_contract.surfaces import Circle, Surface

from ...core.friction import FrictionCurve
from ...core.targets.textures import Textures
from ...errors import RequestError
from ...wire.client import read

SIDE = 32  # of a content's picture
Picture = tuple[str, float]  # levels 0 .. 255 in base64, by rows from the top (+y) down, and the amplitude of 255


class SurfacePainter:
    """Turns the daemon's descriptions into what the page draws; the pictures of unchanged content are kept."""

    def __init__(self, curve: FrictionCurve, size_mm: tuple[float, float], most_um: float) -> None:
        self._textures = Textures(curve, size_mm, most_um)
        self._pictures: dict[tuple[Content, tuple[float, float]], Picture] = {}

    def painted(self, described: Iterable[Mapping[str, Any]]) -> list[dict[str, object]]:
        """Return the layers that can be drawn, topmost first; content that a newer daemon added is left out."""
        layers: list[dict[str, object]] = []
        used: dict[tuple[Content, tuple[float, float]], Picture] = {}
        for fields in described:
            try:
                surface: Surface = read({key: fields[key] for key in fields if key != "client"}, Surface)
            except RequestError:
                continue
            box_mm = _box_mm(surface, self._textures.plate_size_mm)
            layers.append({"client": fields.get("client"), "name": surface.name, **_pose(surface), "box_mm": box_mm})
            layers[-1] |= self._content(surface.content, box_mm, used)
        self._pictures = used
        return layers

    def _content(self, content: Content, box_mm: tuple[float, float], used: dict[Any, Picture]) -> dict[str, object]:
        if isinstance(content, Amplitude):
            return {"about": f"{content.amplitude_um:.2f} µm", "amplitude_um": content.amplitude_um}
        if isinstance(content, Friction):
            amplitude_um = self._textures.amplitude(content)(0.0, 0.0)
            return {"about": f"friction {content.friction:.2f}", "amplitude_um": amplitude_um}
        key = content, box_mm
        used[key] = self._pictures.get(key) or self._picture(content, box_mm)
        levels, most_um = used[key]
        period = f" {content.period_mm:g} mm" if isinstance(content, Grating) else ""
        about = f"{NAMES[type(content)]}{period}, up to {most_um:.2f} µm"
        return {"about": about, "levels": levels, "most_um": most_um}

    def _picture(self, content: Content, box_mm: tuple[float, float]) -> Picture:
        amplitude_um = self._textures.amplitude(content, box_mm)
        x_mm, y_mm = ([(index + 0.5) / SIDE - 0.5 for index in range(SIDE)] for _ in range(2))
        values = [amplitude_um(x * box_mm[0], -y * box_mm[1]) for y in y_mm for x in x_mm]
        most_um = max(*values, 1e-9)
        return b64encode(bytes(round(255 * max(value, 0.0) / most_um) for value in values)).decode(), most_um


def _pose(surface: Surface) -> dict[str, object]:
    path = surface.path
    return {
        "shape": _shape(surface),
        "position_mm": surface.position_mm,
        "angle_rad": surface.angle_rad,
        "scale": surface.scale,
        "velocity_mm_s": surface.velocity_mm_s,
        "turning_rad_s": surface.turning_rad_s,
        "t_pose_s": (surface.t_pose_ns or 0) * 1e-9,
        "path": None if path is None else {"points_mm": path.path_mm, "speed_mm_s": path.speed_mm_s, "loop": path.loop},
        "z": surface.z,
        "blend": surface.blend,
    }


def _shape(surface: Surface) -> dict[str, object] | None:
    shape = surface.shape
    if shape is None:
        return None
    return {"radius_mm": shape.radius_mm} if isinstance(shape, Circle) else {"corners_mm": shape.corners_mm}


def _box_mm(surface: Surface, size_mm: tuple[float, float]) -> tuple[float, float]:
    """Return the smallest box around the origin that holds the shape, over which a map is spread."""
    shape = surface.shape
    if shape is None:
        return size_mm
    if isinstance(shape, Circle):
        return 2.0 * shape.radius_mm, 2.0 * shape.radius_mm
    return 2.0 * _farthest(shape.corners_mm, 0), 2.0 * _farthest(shape.corners_mm, 1)


def _farthest(points_mm: Sequence[tuple[float, float]], axis: int) -> float:
    return max(abs(point[axis]) for point in points_mm)
