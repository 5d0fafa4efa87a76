"""The reference active at each instant of a run, with the finger positions that it assumed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from ..values import FloatArray, SafeDrive, Tick


class Passes:
    """The passes that sent a reference polyline, in the order in which they took effect."""

    def __init__(self, t_start_ns: int) -> None:
        """`t_start_ns` is the run's start on the clock of the passes."""
        self._t_start_ns = t_start_ns
        self._sent: list[tuple[Tick, SafeDrive, dict[int | str, int]]] = []

    def add(self, tick: Tick, actor_of: Mapping[int | str, int]) -> None:
        """Add a pass with the actor of each finger; a pass that sent no reference is ignored."""
        if tick.drive is not None:
            self._sent.append((tick, tick.drive, dict(actor_of)))

    def limited(self, t_s: FloatArray) -> npt.NDArray[np.bool_]:
        """Return whether a limit reduced a target in the active pass (T,)."""
        limited = np.zeros(len(t_s), dtype=bool)
        for (tick, _, _), part in self._active(t_s, 0.0):
            limited[part] = tick.limited
        return limited

    def predicted_mm(self, t_s: FloatArray, actors: int, delay_s: float) -> FloatArray:
        """Return the position of each actor assumed by the active polyline (T, N, 2), NaN where it had none.

        `delay_s` is the lag of the plate behind its reference.
        """
        predicted_mm = np.full((len(t_s), actors, 2), np.nan)
        for (tick, drive, actor_of), part in self._active(t_s, delay_s):
            span_s = max(drive.knots[-1].dt_ns * 1e-9, 1e-9)
            since_s = t_s[part] - delay_s - self._starts_s(drive)
            share = np.clip(since_s / span_s, 0.0, 1.0)[:, None]
            for point in tick.points:
                start, end = np.array([point.x_mm, point.y_mm]), np.array([point.end_x_mm, point.end_y_mm])
                predicted_mm[part, actor_of[point.key]] = start + share * (end - start)
        return predicted_mm

    def _active(
        self, t_s: FloatArray, delay_s: float
    ) -> list[tuple[tuple[Tick, SafeDrive, dict[int | str, int]], slice]]:
        """Return each pass with the slice of instants during which it was active."""
        starts_s = [self._starts_s(drive) + delay_s for _, drive, _ in self._sent]
        bounds = [*np.searchsorted(t_s, starts_s).tolist(), len(t_s)]
        return [(sent, slice(bounds[i], bounds[i + 1])) for i, sent in enumerate(self._sent)]

    def _starts_s(self, drive: SafeDrive) -> float:
        return (drive.t_apply_ns - self._t_start_ns) * 1e-9
