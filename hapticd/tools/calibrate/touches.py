"""When a mark is touched: one finger comes down, rests for a while away from others, and counts once.

Pure: touch frames in, resting positions out. The position is the mean over the rest, so a pad's noise of 0.05 mm
becomes 0.01 mm; how well a person aims is another matter, and what the fit's residual shows.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from ...core.touch.tracking import Tracker
from ...values import Finger, TouchFrame

REST_NS = 500_000_000
REST_WITHIN_MM = 0.5  # of the mean, for the whole rest
APART_MM = 5.0  # from other fingers and from marks touched before
LEAST_FRAMES = 10  # of a rest: a pad that loses more shows no rest

Point = tuple[float, float]
Sample = tuple[int, float, float]  # t_ns, x_mm, y_mm


class TouchedMarks:
    """The marks touched so far, in their order, in the frame of the touches."""

    def __init__(self) -> None:
        self.rests_mm: list[Point] = []
        self._tracker = Tracker()
        self._paths: dict[int, deque[Sample]] = {}
        self._counted: set[int] = set()

    def update(self, frame: TouchFrame) -> Point | None:
        """Where a finger has just rested, if one has."""
        now = self._tracker.update(frame)
        for lifted in now.lifted:
            self._paths.pop(lifted, None)
        for finger in now.fingers:
            path = self._paths.setdefault(finger.finger_id, deque())
            if not path or now.t_ns > path[-1][0]:
                path.append((now.t_ns, finger.x_mm, finger.y_mm))
            while now.t_ns - path[0][0] > REST_NS:
                path.popleft()
        for finger in now.fingers:
            rest = self._rest(finger, now.fingers, now.t_ns)
            if rest is not None:
                self._counted.add(finger.finger_id)
                self.rests_mm.append(rest)
                return rest
        return None

    def _rest(self, finger: Finger, fingers: tuple[Finger, ...], t_ns: int) -> Point | None:
        path = self._paths[finger.finger_id]
        period_ns = (t_ns - path[0][0]) // max(len(path) - 1, 1)
        is_whole = len(path) >= LEAST_FRAMES and t_ns - path[0][0] + period_ns >= REST_NS
        if not is_whole or finger.finger_id in self._counted:
            return None
        points_mm = np.array([point for _, *point in path])
        mean_mm = points_mm.mean(axis=0)
        others_mm = [(one.x_mm, one.y_mm) for one in fingers if one is not finger] + self.rests_mm
        is_apart = all(np.hypot(*(mean_mm - other)) >= APART_MM for other in others_mm)
        if not is_apart or np.hypot(*(points_mm - mean_mm).T).max() > REST_WITHIN_MM:
            return None
        return float(mean_mm[0]), float(mean_mm[1])
