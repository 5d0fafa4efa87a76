"""The fingers' ways within one frame: into how many spans textures and edges divide them, and how far a chord errs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Final

from ..values import FingerKey, Knot
from .phasors import magnitude, re_im
from .solver.instant import AskedPlace
from .targets.scene import Scene
from .targets.surfaces import Crossing
from .touch.fingers import Fingers
from .trajectory.knots import SHORTEST_NS

_NO_EDGES: Final[Sequence[int]] = ()


class Ways:
    """What the knots of a frame depend on, apart from the solutions themselves."""

    def __init__(self, scene: Scene, fingers: Fingers, tolerance_um: float) -> None:
        self._scene: Final = scene
        self._surfaces: Final = scene.surfaces
        self._fingers: Final = fingers
        self.steepness_1_mm = 0.0  # of the plate's shapes
        self._tolerance_um: Final = tolerance_um

    @property
    def has_surfaces(self) -> bool:
        """Whether surfaces lie on the plate."""
        return len(self._surfaces.layers) > 0

    def pieces(
        self, keys: Sequence[FingerKey], moved_mm: Sequence[float], t_plate_ns: int, span_ns: int, most: int
    ) -> tuple[int, bool, Sequence[int]]:
        """Return into how many spans the textures divide the fingers' way at first, whether they are smooth, and the
        instants before and after each edge of a surface; `most` knots in all."""
        pieces, smooth, edges_ns = 1.0, True, _NO_EDGES
        for finger, way_mm in enumerate(moved_mm):
            finest_mm, is_smooth = self._scene.detail(keys[finger])
            if way_mm > pieces * finest_mm:
                pieces = way_mm / finest_mm
            smooth = smooth and is_smooth
        if self._surfaces.layers:
            surface_pieces, are_smooth, edges_ns = self._edges(keys, t_plate_ns, span_ns, most)
            pieces, smooth = max(pieces, surface_pieces), smooth and are_smooth
        room = max(most - 1 - len(edges_ns), 1)
        return math.ceil(min(pieces, room, span_ns / SHORTEST_NS)), smooth, edges_ns

    def _edges(
        self, keys: Sequence[FingerKey], t_plate_ns: int, span_ns: int, most: int
    ) -> tuple[float, bool, Sequence[int]]:
        """Return what the surfaces add to `pieces`; where there are too many edges, the earliest."""
        pieces, smooth, crossed = 1.0, True, list[Crossing]()
        for key in keys:
            if isinstance(key, int) and self._scene.target_of(key) is None:
                predicted_mm = partial(self._fingers.predicted_mm, key)
                way = self._surfaces.along(predicted_mm, t_plate_ns, span_ns)
                pieces, smooth = max(pieces, way.pieces), smooth and way.is_smooth
                crossed += way.crossings
        edges_ns = [edge_ns for edge_ns in self._surfaces.edges_ns(crossed, t_plate_ns, self._tolerance_um) if edge_ns]
        return pieces, smooth, edges_ns[: max(most - 2, 0) // 2 * 2]

    def bend_um(self, ends: Sequence[Knot], moved_mm: Sequence[float]) -> float:
        """Return the largest error of a chord over so short a way: W (steepness * way)^2 / 8."""
        largest_um = 0.0
        for _, modal_um in ends:
            for w_um in modal_um:
                w_d_um, w_q_um = re_im(w_um)
                largest_um = max(largest_um, magnitude(w_d_um, w_q_um))
        change = self.steepness_1_mm * sum(moved_mm)
        return largest_um * (change * change) / 8.0


def moved_mm(before: Sequence[AskedPlace], after: Sequence[AskedPlace]) -> list[float]:
    """Return how far each finger moves."""
    distances_mm = []
    for finger in range(len(before)):
        (x_mm, y_mm, _), (then_x_mm, then_y_mm, _) = before[finger], after[finger]
        distances_mm.append(math.hypot(then_x_mm - x_mm, then_y_mm - y_mm))
    return distances_mm
