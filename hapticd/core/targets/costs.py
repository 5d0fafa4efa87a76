"""What contents, layers and virtual fingers cost a pass: estimates of processor time, before anything is computed.

They are sums over what a thing has, in ns of machine code on the machine of `tests/core/test_dearest`, which compares
them with what passes take. Admission bounds their sums over all clients; what is admitted bounds a pass
(`core.budget`), whatever lies under the fingers: each estimate is of a finger that meets all of a layer.
"""

from __future__ import annotations

import math
from itertools import accumulate, pairwise
from typing import Final, NamedTuple

from hapticd_contract.contents import Content
from hapticd_contract.surfaces import Polygon, Surface, VirtualPath

from .textures.registry import content_ns

KNOTS: Final = 6  # of a frame, for which a layer is judged: what most frames have where textures are
LONGEST_FRAME_S: Final = 0.03  # ahead of which nothing is looked up
MAX_EDGES: Final = 8  # of one layer, and corners of its path, that a finger meets in one frame

_LOOK_UP_NS: Final = 120  # of a layer at a place: is it near, in the layer's frame, inside
_TURNING_NS: Final = 90
_WALK_NS: Final = 260
_SIDE_NS: Final = 9
_EDGES_NS: Final = 700  # of a layer on a finger's way: both ends in its frame, and what it crosses
_LEG_NS: Final = 900  # from corner to corner of a layer's path


class LayerCost(NamedTuple):
    """Cost of a layer: for each finger's way in a pass, and for each of its places that is looked up."""

    way_ns: float
    place_ns: float

    @property
    def pass_us(self) -> float:
        """Cost for one finger of a pass with KNOTS knots."""
        return 1e-3 * (self.way_ns + KNOTS * self.place_ns)


def layer_cost(surface: Surface) -> LayerCost:
    """Return what a surface costs while it is in force."""
    shape, path = surface.shape, surface.path
    sides = len(shape.corners_mm) if isinstance(shape, Polygon) else 0
    walk_ns = 0.0 if path is None else _WALK_NS
    turning_ns = _TURNING_NS if surface.turning_rad_s != 0.0 else 0.0
    frame_ns = _LOOK_UP_NS + _SIDE_NS * sides + walk_ns + turning_ns
    legs = 1.0 if path is None or shape is None else 1.0 + turns(path)
    way_ns = _EDGES_NS + legs * (_LEG_NS + 4.0 * _SIDE_NS * sides + walk_ns + turning_ns)
    return LayerCost(way_ns, frame_ns + content_ns(surface.content))


def virtual_ns(target: Content | None) -> float:
    """Return what a virtual finger's place and target cost at one instant."""
    return _WALK_NS + content_ns(target)


def turns(path: VirtualPath) -> int:
    """Return how many corners of its path a layer may pass in one frame, up to MAX_EDGES."""
    points, reach_mm = path.path_mm, path.speed_mm_s * LONGEST_FRAME_S
    if len(points) < 2 or not reach_mm > 0.0:
        return 0
    arcs_mm = list(accumulate((math.dist(a, b) for a, b in pairwise(points)), initial=0.0))
    most = last = 0
    for first in range(len(arcs_mm)):
        while last + 1 < len(arcs_mm) and arcs_mm[last + 1] - arcs_mm[first] <= reach_mm:
            last += 1
        most = max(most, last - first + 1)
    return min(2 * most if path.loop else most, MAX_EDGES)  # at an end it comes back over the same corners
