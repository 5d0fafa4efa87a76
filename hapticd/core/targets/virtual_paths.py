"""Place of a virtual finger or a moving surface: a polyline walked at constant speed, exact at any instant.

The position is computed from the whole way since the start, never from the last position, so nothing accumulates.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import accumulate, pairwise
from typing import Final

from hapticd_contract.surfaces import VirtualPath

SHORT_MM: Final = 1e-3  # nothing is felt of a path as short as that


class Walk:
    """A path with its start instant. With `loop` it reverses at either end, else it ends on the last point."""

    def __init__(self, path: VirtualPath, t_start_ns: int) -> None:
        self.path = path
        self.t_start_ns = t_start_ns
        self._arc_mm = tuple(accumulate((math.dist(a, b) for a, b in pairwise(path.path_mm)), initial=0.0))
        there_mm, length_mm = list(self._arc_mm), self._arc_mm[-1]
        back_mm = [2.0 * length_mm - mm for mm in there_mm[-2::-1]] if path.loop else []
        self._corners_mm = there_mm + back_mm  # of one lap

    def position_mm(self, t_ns: int) -> tuple[float, float]:
        """The position at an instant; before the start, the first point."""
        points, arc_mm = self.path.path_mm, self._arc_mm
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
        speed_mm_s, corners_mm = self.path.speed_mm_s, self._corners_mm
        if not (speed_mm_s > 0.0 and self._arc_mm[-1] >= SHORT_MM):
            return []
        from_mm, way_mm = (t_ns - self.t_start_ns) * 1e-9 * speed_mm_s, span_ns * 1e-9 * speed_mm_s
        if self.path.loop and from_mm > 0.0:
            from_mm = math.fmod(from_mm, corners_mm[-1])
        lap_mm, turns_ns = 0.0, list[int]()
        index = bisect_right(corners_mm, from_mm)
        while len(turns_ns) < most:
            if index == len(corners_mm):
                if not self.path.loop:
                    break
                lap_mm, index = lap_mm + corners_mm[-1], 0
            ahead_mm = lap_mm + corners_mm[index] - from_mm
            if ahead_mm >= way_mm:
                break
            turn_ns = int(ahead_mm / speed_mm_s * 1e9)
            if not turns_ns or turn_ns > turns_ns[-1]:
                turns_ns.append(turn_ns)
            index += 1
        return turns_ns

    def _along_mm(self, t_ns: int) -> float:
        """Arc length from the first point."""
        length_mm = self._arc_mm[-1]
        walked_mm = max((t_ns - self.t_start_ns) * 1e-9, 0.0) * self.path.speed_mm_s
        if not self.path.loop or length_mm == 0.0:
            return min(walked_mm, length_mm)
        there_and_back_mm = math.fmod(walked_mm, 2.0 * length_mm)
        return min(there_and_back_mm, 2.0 * length_mm - there_and_back_mm)
