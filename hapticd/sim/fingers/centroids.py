"""The centroid of a contact as the pad senses it: ahead of a moving finger, biased by finger, posture and force, and on
a pad whose coordinates are not quite straight."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ...values import FloatArray
from ..world_errors import WorldErrors
from .paths import Path

_SHEARED_MM_S = 20.0  # at this speed the centroid has shifted by 0.7 of its most
_APART_S = 0.005  # of the two positions that give a speed
_FINGER, _POSTURE, _WANDER, _WARP = 21, 22, 23, 24  # streams
_WANDER_S = (2.0, 9.0)  # periods
_WANDERS = 4  # sines on each axis
_WARPS, _WARP_MM = 3, (90.0, 250.0)  # waves on each axis, and their lengths
_WARPED_MM = 60.0  # from the pad's middle: where the largest departure counts
_GRID_POINTS = 41


@dataclass(frozen=True)
class CentroidPath:
    """The centroids of the contacts of one finger, the `finger`-th that touches, in a session of a world."""

    path: Path
    world: WorldErrors
    finger: int = 0
    session: int = 0

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        """Return positions (T, 2); NaN where the finger is lifted."""
        sensed_mm = self.path.position_mm(t_s) + self._bias_mm(t_s)
        if self.world.centroid_shift_mm:
            sensed_mm += self._shear_mm(t_s)
        if self.world.pad_warp_mm:
            sensed_mm += self.world.pad_warp_mm * warp(sensed_mm, self.world.seed)
        return sensed_mm

    def _shear_mm(self, t_s: FloatArray) -> FloatArray:
        speed_mm_s = (self.path.position_mm(t_s + _APART_S) - self.path.position_mm(t_s - _APART_S)) / (2.0 * _APART_S)
        speed_mm_s = np.nan_to_num(speed_mm_s)  # as it lands and lifts
        full_mm_s = np.hypot(np.hypot(*speed_mm_s.T), _SHEARED_MM_S)
        return np.asarray(self.world.centroid_shift_mm * speed_mm_s / full_mm_s[:, None])

    @cached_property
    def _directions(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Unit vectors of the finger and the posture (2,), and the sines of the wandering: rate, phase (2, 2, n)."""
        seed, session = self.world.seed, self.session
        turns = (
            np.random.default_rng(stream).uniform(0.0, 2.0 * math.pi)
            for stream in ([seed, _FINGER, self.finger], [seed, _POSTURE, session])
        )
        own, posture = (np.array((math.cos(turn_rad), math.sin(turn_rad))) for turn_rad in turns)
        random = np.random.default_rng([seed, _WANDER, self.finger, session])
        rate = 2.0 * math.pi / random.uniform(*_WANDER_S, (2, _WANDERS))
        return own, posture, np.stack((rate, random.uniform(0.0, 2.0 * math.pi, (2, _WANDERS))))

    def _bias_mm(self, t_s: FloatArray) -> FloatArray:
        of = self.world.centroids
        own, posture, (rate, phase) = self._directions
        pressed = self.world.finger_load.force(self.world.seed, self.finger, t_s) - 1.0
        along_mm = of.posture_mm + of.pressure_mm * pressed
        wander = np.sin(rate * t_s[:, None, None] + phase).sum(axis=-1) / math.sqrt(_WANDERS)  # RMS 1, both axes
        return np.asarray(of.finger_mm * own + along_mm[:, None] * posture + of.wander_mm * wander)


def warp(points_mm: FloatArray, seed: int) -> FloatArray:
    """Return by how much a pad's coordinates are off at points (N, 2), of a largest length of 1 on its middle part."""
    return np.asarray(_waves(points_mm, seed) / _largest(seed))


@lru_cache(maxsize=8)
def _largest(seed: int) -> float:
    axis_mm = np.linspace(-_WARPED_MM, _WARPED_MM, _GRID_POINTS)
    grid_mm = np.stack(np.meshgrid(axis_mm, axis_mm), axis=-1).reshape(-1, 2)
    return float(np.hypot(*_waves(grid_mm, seed).T).max())


def _waves(points_mm: FloatArray, seed: int) -> FloatArray:
    random = np.random.default_rng([seed, _WARP])
    turn, phase = random.uniform(0.0, 2.0 * math.pi, (2, 2, _WARPS))
    rad_mm = 2.0 * math.pi / random.uniform(*_WARP_MM, (2, _WARPS))
    along = points_mm[:, None, None, 0] * np.cos(turn) + points_mm[:, None, None, 1] * np.sin(turn)
    return np.asarray(np.sin(rad_mm * along + phase).sum(axis=-1))
