"""Surfaces in force as a client reads them: the fields by which they were laid, with maps small enough for a reply."""

from __future__ import annotations

from operator import itemgetter

from msgspec import Struct
from msgspec.structs import asdict, replace

from hapticd_contract.contents import LevelMap
from hapticd_contract.surfaces import Polygon, Surface

from ..core.targets.assets import Assets
from ..core.targets.layer import Layer

MAP_SIDE = 32  # of a described map: 64 surfaces of it are a reply of 80 KB


def described(layer: Layer, assets: Assets) -> dict[str, object]:
    """Return a layer's owner and fields; its pose is that at `t_pose_ns`, a rectangle is a polygon."""
    surface: Surface = layer.surface
    content, shape = assets.resolved(layer.content), surface.shape
    changed: dict[str, object] = {"t_pose_ns": layer.t_pose_ns}
    if isinstance(content, LevelMap):
        changed["map"] = _small(content)
    if isinstance(shape, Polygon):
        changed |= {"rectangle_mm": None, "polygon_mm": shape.corners_mm}
    left_out = ("position_mm", "velocity_mm_s") if surface.path_mm else ("speed_mm_s", "loop")
    fields = _whole(replace(surface, **changed))
    return {"client": layer.owner, **{name: value for name, value in fields.items() if name not in left_out}}


def _whole(struct: Struct) -> dict[str, object]:
    """Return all fields, those at their default too: only what there is not is left out."""
    present = {name: value for name, value in asdict(struct).items() if value is not None}
    return {name: _whole(value) if isinstance(value, Struct) else value for name, value in present.items()}


def _small(content: LevelMap) -> LevelMap:
    """Return a map with at most MAP_SIDE pixels per side, of those nearest."""
    columns, rows = _spread(content.width), _spread(content.height)
    pick = itemgetter(*columns) if len(columns) > 1 else bytes
    levels = b"".join(bytes(pick(content.levels[row * content.width : (row + 1) * content.width])) for row in rows)
    return replace(content, width=len(columns), height=len(rows), levels=levels, asset=None)


def _spread(pixels: int) -> list[int]:
    count = min(pixels, MAP_SIDE)
    return [round(index * (pixels - 1) / max(count - 1, 1)) for index in range(count)]
