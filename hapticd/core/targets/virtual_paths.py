"""Where a virtual finger is: a polyline walked at constant speed from a start instant, exact at any instant.

The position is computed from the whole way since the start, never from the last position, so nothing accumulates.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import accumulate, pairwise

from ...values import VirtualPath


class Walk:
    """A path with its start instant. With `loop` it reverses at either end, else it ends on the last point."""

    __slots__ = ("_arc_mm", "path", "t_start_ns")

    def __init__(self, path: VirtualPath, t_start_ns: int) -> None:
        self.path = path
        self.t_start_ns = t_start_ns
        self._arc_mm = tuple(accumulate((math.dist(a, b) for a, b in pairwise(path.points_mm)), initial=0.0))

    def position_mm(self, t_ns: int) -> tuple[float, float]:
        """The position at an instant; before the start, the first point."""
        points, arc_mm = self.path.points_mm, self._arc_mm
        along_mm = self._along_mm(t_ns)
        index = bisect_right(arc_mm, along_mm) - 1
        if index >= len(points) - 1:
            return points[-1]
        share = (along_mm - arc_mm[index]) / (arc_mm[index + 1] - arc_mm[index])
        (x_mm, y_mm), (next_x_mm, next_y_mm) = points[index : index + 2]
        return x_mm * (1.0 - share) + next_x_mm * share, y_mm * (1.0 - share) + next_y_mm * share

    def _along_mm(self, t_ns: int) -> float:
        """Arc length from the first point."""
        length_mm = self._arc_mm[-1]
        walked_mm = max((t_ns - self.t_start_ns) * 1e-9, 0.0) * self.path.speed_mm_s
        if not self.path.loop or length_mm == 0.0:
            return min(walked_mm, length_mm)
        there_and_back_mm = math.fmod(walked_mm, 2.0 * length_mm)
        return min(there_and_back_mm, 2.0 * length_mm - there_and_back_mm)
