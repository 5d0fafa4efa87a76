"""Surfaces in force as a client reads them: the fields by which they were laid, with maps small enough for a reply."""

from __future__ import annotations

from dataclasses import replace
from operator import itemgetter

from ..content_values import MapTarget, Target
from ..core.targets.assets import Assets
from ..core.targets.layer import Layer
from ..files.recording.client_message import surface_fields

MAP_SIDE = 32  # of a described map: 64 surfaces of it are a reply of 80 KB


def described(layer: Layer, assets: Assets) -> dict[str, object]:
    """Return a layer's owner and fields; its pose is that at `t_pose_ns`."""
    content = _small(assets.resolved(layer.surface.content))
    surface = replace(layer.surface, content=content, t_pose_ns=layer.t_pose_ns)
    return {"client": layer.owner, **surface_fields(layer.name, surface)}


def _small(content: Target) -> Target:
    """Return a map with at most MAP_SIDE pixels per side, of those nearest; other content as it is."""
    if not isinstance(content, MapTarget):
        return content
    columns, rows = _spread(content.width), _spread(content.height)
    pick = itemgetter(*columns) if len(columns) > 1 else bytes
    levels = b"".join(bytes(pick(content.levels[row * content.width : (row + 1) * content.width])) for row in rows)
    return replace(content, width=len(columns), height=len(rows), levels=levels, asset=b"")


def _spread(pixels: int) -> list[int]:
    count = min(pixels, MAP_SIDE)
    return [round(index * (pixels - 1) / max(count - 1, 1)) for index in range(count)]
