"""Application of a world's errors to the pad, the link and the fingers of a lock-step run.

Those of the plate are in `plate.ground_truth`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..values import AffineMap
from .fingers.centroids import CentroidPath
from .fingers.fingertip import Fingertip
from .fingers.pad_ellipse import PadEllipse
from .fingers.paths import Path, with_strokes
from .fingers.scenarios import Actor
from .fingers.sensor import SensorSettings
from .fingers.strokes import Strokes
from .world_errors import NEUTRAL, EllipseErrors, PadPose, WorldErrors

_LINK_STREAM, _CONTACT_STREAM = 7, 25


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
        ellipse=_ellipse(settings.ellipse, world.ellipses),
    )


def _ellipse(usual: PadEllipse, errors: EllipseErrors) -> PadEllipse:
    return replace(usual, scale=usual.scale * (1.0 + errors.scale_frac), offset_mm=usual.offset_mm + errors.offset_mm)


def sensed_paths(paths: Sequence[Path], world: WorldErrors, session: int = 0) -> list[Path]:
    """Return the paths that the pad senses: those of the contacts' centroids, on the pad as it is."""
    if not (world.centroid_shift_mm or world.pad_warp_mm or world.centroids != NEUTRAL.centroids):
        return list(paths)
    return [CentroidPath(path, world, finger, session) for finger, path in enumerate(paths)]


def played_actors(actors: tuple[Actor, ...], world: WorldErrors) -> tuple[Actor, ...]:
    """Return the actors with the world's contacts, and smooth strokes with its ramps of speed."""
    return tuple(
        actor if actor.path is None else _played(actor, actor.path, finger, world)
        for finger, actor in enumerate(actors)
    )


def _played(actor: Actor, path: Path, finger: int, world: WorldErrors) -> Actor:
    ramp_s, contacts = world.stop_ramp_s, world.contacts
    if ramp_s is not None:
        actor = replace(actor, path=with_strokes(path, lambda strokes, _: _with_ramp(strokes, ramp_s)))
    if contacts is None or actor.fingertip is not None:
        return actor
    random = np.random.default_rng([world.seed, _CONTACT_STREAM, finger])
    radius_mm, ratio = random.uniform((contacts.least_mm, 1.0), (contacts.most_mm, contacts.aspect))
    longer, turn_rad = math.sqrt(ratio), random.uniform(0.0, math.pi)
    return replace(actor, fingertip=Fingertip(radius_mm * longer, radius_mm / longer, turn_rad))


def _with_ramp(strokes: Strokes, ramp_s: float) -> Strokes:
    avoid = None if strokes.avoid is None else replace(strokes.avoid, ramp_s=ramp_s)
    return replace(strokes, ramp_s=ramp_s, avoid=avoid)


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
