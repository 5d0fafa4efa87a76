"""Where a virtual finger or a moving surface is: a polyline walked at constant speed, exact at any instant.

The position is computed from the whole way since the start, never from the last position, so nothing accumulates.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import accumulate, pairwise
from typing import Final

from ...content_values import VirtualPath

SHORT_MM: Final = 1e-3  # nothing is felt of a path as short as that


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

    def turns_ns(self, t_ns: int, span_ns: int, most: int) -> list[int]:
        """Return when the path has a corner, ends or begins within `span_ns` from `t_ns` on: ns from there, `most` in
        all."""
        arc_mm, speed_mm_s = self._arc_mm, self.path.speed_mm_s
        length_mm = arc_mm[-1]
        if not (speed_mm_s > 0.0 and length_mm >= SHORT_MM):
            return []
        from_mm = (t_ns - self.t_start_ns) * 1e-9 * speed_mm_s
        to_mm = from_mm + span_ns * 1e-9 * speed_mm_s
        corners_mm, lap_mm = list(arc_mm), 0.0
        if self.path.loop:
            corners_mm += [2.0 * length_mm - mm for mm in arc_mm[-2::-1]]
            lap_mm = math.floor(max(from_mm, 0.0) / corners_mm[-1]) * corners_mm[-1]
        turns_ns: list[int] = []
        while lap_mm < to_mm and len(turns_ns) < most:
            ahead_mm = [lap_mm + corner_mm - from_mm for corner_mm in corners_mm]
            turns_ns += [int(mm / speed_mm_s * 1e9) for mm in ahead_mm if 0.0 < mm < to_mm - from_mm]
            if not self.path.loop:
                break
            lap_mm += corners_mm[-1]
        return sorted(set(turns_ns))[:most]

    def _along_mm(self, t_ns: int) -> float:
        """Arc length from the first point."""
        length_mm = self._arc_mm[-1]
        walked_mm = max((t_ns - self.t_start_ns) * 1e-9, 0.0) * self.path.speed_mm_s
        if not self.path.loop or length_mm == 0.0:
            return min(walked_mm, length_mm)
        there_and_back_mm = math.fmod(walked_mm, 2.0 * length_mm)
        return min(there_and_back_mm, 2.0 * length_mm - there_and_back_mm)
