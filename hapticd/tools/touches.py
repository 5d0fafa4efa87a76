"""Touches as a pad reported them: one trace of samples a finger, from live reports or out of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.touch.fingers import Tracker
from ..errors import UsageError
from ..files.recording.mcap_reader import open_recording, touch_frames
from ..values import AffineMap, FloatArray, TouchFrame

_OWN = AffineMap(1.0, 0.0, 0.0, 1.0)  # the pad's own coordinates


class Trace(NamedTuple):
    """One touch: stamps (n,) and positions (n, 2)."""

    t_s: FloatArray
    xy_mm: FloatArray

    @property
    def samples(self) -> list[tuple[int, float, float]]:
        """Stamp in ns, x and y in mm."""
        stamps_ns: list[int] = np.rint(self.t_s * 1e9).astype(np.int64).tolist()
        return [(t_ns, x, y) for t_ns, (x, y) in zip(stamps_ns, self.xy_mm.tolist(), strict=True)]


class RecordedTouches:
    """Samples of fingers, by their ids."""

    def __init__(self) -> None:
        self._tracker = Tracker()
        self._samples: dict[int, list[tuple[int, float, float]]] = {}

    def lift_all(self) -> None:
        """Lift every finger: the pad was disconnected."""
        self._tracker.reset()

    def add(self, touched: TouchFrame) -> None:
        """Take a frame of the pad."""
        frame = self._tracker.update(touched)
        for finger in frame.fingers:
            samples = self._samples.setdefault(finger.finger_id, [])
            if not samples or frame.t_ns > samples[-1][0]:
                samples.append((frame.t_ns, finger.x_mm, finger.y_mm))

    def traces(self) -> list[Trace]:
        """Return what each finger left."""
        return [
            Trace(1e-9 * np.array([t_ns - samples[0][0] for t_ns, _, _ in samples]), np.array(samples)[:, 1:])
            for samples in self._samples.values()
            if len(samples) > 1
        ]


def recorded(path: Path) -> list[Trace]:
    """Read the touches of a recording: one trace a finger, in the pad's own coordinates. Raises HapticdError."""
    touches = RecordedTouches()
    for frame in touch_frames(open_recording(path), _OWN):
        if frame is None:
            touches.lift_all()
        else:
            touches.add(frame)
    if not (found := touches.traces()):
        raise UsageError(f"--recording {path}: no finger touched the pad: record some strokes.")
    return found
