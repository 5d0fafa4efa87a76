"""Application of a world's errors to the pad, the link and the fingers of a lock-step run.

Those of the plate are in `plate.ground_truth`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..values import AffineMap, FloatArray
from .fingers.paths import Path, Strokes, Touch, Touches
from .fingers.scenarios import Actor
from .fingers.sensor import SensorSettings
from .world_errors import PadPose, WorldErrors

_SHEARED_MM_S = 20.0  # at this speed the centroid has shifted by 0.7 of its most
_APART_S = 0.005  # of the two positions that give a speed
_LINK_STREAM = 7


def plate_from_pad(pose: PadPose) -> AffineMap:
    """Return the true placement of a pad."""
    scale = 1.0 + pose.scale_frac
    return AffineMap.from_placement((pose.x_mm, pose.y_mm), pose.angle_deg, (scale, scale))


def sensor_settings(world: WorldErrors, **usual: Any) -> SensorSettings:
    """Return the pad's settings in this world; `usual` are those without errors."""
    settings = SensorSettings(**usual)
    return replace(
        settings,
        latency_s=max(settings.latency_s + 1e-3 * world.latency_ms, 0.0),
        stamp_jitter_ms=settings.stamp_jitter_ms + world.stamp_jitter_ms,
        plate_from_pad=plate_from_pad(world.pad_pose),
        noise=settings.noise if world.noise is None else world.noise,
        period_s=settings.period_s if world.report_period_ms is None else 1e-3 * world.report_period_ms,
        lost_frac=world.lost_frac,
    )


def sensed_paths(paths: Sequence[Path], world: WorldErrors) -> list[Path]:
    """Return the paths that the pad senses: those of the contacts' centroids."""
    if world.centroid_shift_mm == 0.0:
        return list(paths)
    return [CentroidPath(path, world.centroid_shift_mm) for path in paths]


@dataclass(frozen=True)
class CentroidPath:
    """The centroid of a contact that shears as it moves: `shift_mm` ahead of its centre at high speed."""

    path: Path
    shift_mm: float

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        """Return positions (T, 2); NaN where the finger is lifted."""
        speed_mm_s = (self.path.position_mm(t_s + _APART_S) - self.path.position_mm(t_s - _APART_S)) / (2.0 * _APART_S)
        speed_mm_s = np.nan_to_num(speed_mm_s)  # as it lands and lifts
        full_mm_s = np.hypot(np.hypot(*speed_mm_s.T), _SHEARED_MM_S)
        shifted_mm: FloatArray = self.path.position_mm(t_s) + self.shift_mm * speed_mm_s / full_mm_s[:, None]
        return shifted_mm


def played_actors(actors: tuple[Actor, ...], world: WorldErrors) -> tuple[Actor, ...]:
    """Return the actors with the world's ramps of speed."""
    ramp_s = world.stop_ramp_s
    if ramp_s is None:
        return actors
    return tuple(
        actor if actor.path is None else replace(actor, path=_with_ramp(actor.path, ramp_s)) for actor in actors
    )


def _with_ramp(path: Path, ramp_s: float) -> Path:
    """Return the same strokes with ramps of `ramp_s`; other paths have none."""
    if isinstance(path, Strokes):
        return replace(path, ramp_s=ramp_s, avoid=None if path.avoid is None else replace(path.avoid, ramp_s=ramp_s))
    if isinstance(path, Touch):
        return replace(path, path=_with_ramp(path.path, ramp_s))
    if isinstance(path, Touches):
        return Touches(tuple(_with_ramp(touch, ramp_s) for touch in path.touches))
    return path


class JitteryLink:
    """Arrival times over a serial line whose delay varies; order is kept. Instants in ns of the host."""

    def __init__(self, delay_ms: float, jitter_ms: float, seed: int) -> None:
        self._delay_ns, self._jitter_ns = round(delay_ms * 1e6), jitter_ms * 1e6
        self._random = np.random.default_rng([seed, _LINK_STREAM])
        self._last_to_board_ns = self._last_to_host_ns = 0

    def to_board_ns(self, t_ns: int) -> int:
        """Return when bytes written at `t_ns` reach the board."""
        self._last_to_board_ns = max(self._last_to_board_ns, t_ns + self._delay())
        return self._last_to_board_ns

    def to_host_ns(self, t_ns: int) -> int:
        """Return when bytes that the board sent at `t_ns` reach the host."""
        self._last_to_host_ns = max(self._last_to_host_ns, t_ns + self._delay())
        return self._last_to_host_ns

    def _delay(self) -> int:
        return self._delay_ns + round(self._jitter_ns * float(self._random.random()))
