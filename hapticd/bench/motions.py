"""The motions that predictors are measured on, and the simulated pad that samples them.

The pad samples regularly, with white noise on each axis, in steps of 0.02 mm, and stamps that are off by up to 1 ms.
A motion and a seed always give the same touch; seeds differ in direction, phase, length and noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..sim.fingers.pad_noise import Firmware, PadNoise
from ..sim.fingers.paths import CirclePath, Path, ReachPath, Rest
from ..sim.fingers.strokes import Strokes
from ..values import FloatArray

NOISE_MM, QUIET_NOISE_MM, STEP_MM, STAMP_ERROR_S = 0.05, 0.02, 0.02, 1e-3
PERIOD_S = 0.010  # 100 Hz, the rate for which the goals are stated; the default predictor expects 88.9 Hz
_WHITE_NOISE = PadNoise(NOISE_MM)
REACHES = ((20.0, 0.3), (50.0, 0.45), (80.0, 0.6))  # mm in s
REST_AFTER_REACH_S = 0.25


@dataclass(frozen=True, slots=True)
class RotatedPath:
    """A path at an angle of `direction_rad`: `along_mm` and `across_mm` give the distances (T,) at times (T,)."""

    along_mm: Callable[[FloatArray], FloatArray]
    direction_rad: float
    across_mm: Callable[[FloatArray], FloatArray] = np.zeros_like

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        cos, sin = math.cos(self.direction_rad), math.sin(self.direction_rad)
        along_mm, across_mm = self.along_mm(t_s), self.across_mm(t_s)
        return np.stack((cos * along_mm - sin * across_mm, sin * along_mm + cos * across_mm), axis=-1)


class Motion(NamedTuple):
    """A path for each seed, its duration, the number of first samples that do not count, and the pad's noise."""

    path: Callable[[int], Path]
    seconds: float = 3.0
    warm_up: int = 40
    noise_mm: float = NOISE_MM


class MotionTouch(NamedTuple):
    """The pad's samples (stamp ns, x mm, y mm), the true time of each (T,), the true path of the finger, and the number
    of first samples that do not count."""

    samples: list[tuple[int, float, float]]
    sampled_s: FloatArray
    path: Path
    warm_up: int = 0


def touch(motion: Motion, seed: int, period_s: float = PERIOD_S, noise: PadNoise | None = None) -> MotionTouch:
    """The touch of a motion and seed; `noise` replaces the motion's."""
    found = sense(motion.path(seed), motion.seconds, seed, noise=noise or PadNoise(motion.noise_mm), period_s=period_s)
    return found._replace(warm_up=motion.warm_up)


def sense(
    path: Path, seconds: float, seed: int, *, noise: PadNoise = _WHITE_NOISE, period_s: float = PERIOD_S
) -> MotionTouch:
    """Sample a path as a pad with this noise does."""
    firmware = Firmware(noise)
    rng = np.random.default_rng([seed, 5])
    sampled_s = np.asarray(period_s * (np.arange(round(seconds / period_s)) + rng.uniform()), np.float64)
    sensed_mm = path.position_mm(firmware.sensed_s(sampled_s, rng))
    noise_mm = noise.noise_mm * firmware.correlated(rng.standard_normal((len(sampled_s), 2)))
    noisy_mm = firmware.held_mm(sensed_mm + noise_mm)
    rounded_mm = STEP_MM * np.round(noisy_mm / STEP_MM)
    stamps_s = sampled_s + rng.uniform(-STAMP_ERROR_S, STAMP_ERROR_S, len(sampled_s))
    stamps_ns: list[int] = np.rint(stamps_s * 1e9).astype(np.int64).tolist()
    return MotionTouch([(t, x, y) for t, (x, y) in zip(stamps_ns, rounded_mm.tolist(), strict=True)], sampled_s, path)


def _straight(speed_mm_s: float) -> Motion:
    return Motion(lambda seed: RotatedPath(lambda t_s: speed_mm_s * t_s, float(seed)))


def _slide(seed: int) -> Path:
    """A hand's slide at 10 cm/s: two sines of a tenth of the speed each, a lateral wobble, and tremor."""
    phase_rad = np.random.default_rng([seed, 6]).uniform(0.0, 2.0 * math.pi, 4)
    slow, fast, wobble, tremor = 2.0 * math.pi * np.array((1.3, 3.1, 2.0, 8.5))

    def along_mm(t_s: FloatArray) -> FloatArray:
        slowly = np.cos(slow * t_s + phase_rad[0]) / slow + np.cos(fast * t_s + phase_rad[1]) / fast
        return np.asarray(100.0 * (t_s - 0.1 * slowly) + 0.04 * np.sin(tremor * t_s + phase_rad[2]))

    def across_mm(t_s: FloatArray) -> FloatArray:
        return np.asarray(0.4 * np.sin(wobble * t_s + phase_rad[2]) + 0.04 * np.sin(tremor * t_s + phase_rad[3]))

    return RotatedPath(along_mm, float(seed), across_mm)


def _sine(speed_mm_s: float) -> Motion:
    """Back and forth over 80 mm; `speed_mm_s` is reached in the middle."""
    return Motion(
        lambda seed: RotatedPath(lambda t_s: 40.0 * np.sin(speed_mm_s / 40.0 * t_s + seed), 1.7 * seed), warm_up=20
    )


def _circle(speed_mm_s: float, radius_mm: float) -> Motion:
    return Motion(
        lambda seed: CirclePath((0.0, 0.0), radius_mm, speed_mm_s if seed % 2 else -speed_mm_s, float(seed)), warm_up=20
    )


def _reach(seed: int) -> Path:
    """Minimum jerk back and forth, one of three lengths."""
    length_mm, duration_s = REACHES[seed % len(REACHES)]
    end_mm = length_mm * math.cos(1.3 * seed), length_mm * math.sin(1.3 * seed)
    return ReachPath((0.0, 0.0), end_mm, duration_s, REST_AFTER_REACH_S)


def _stop(seed: int) -> Path:
    """10 cm/s, then to rest within 40 ms along half a cosine of speed: the end of a slide against a wall."""
    t_stop_s, stop_s = 0.5 + 0.0023 * seed, 0.04

    def along_mm(t_s: FloatArray) -> FloatArray:
        part = np.clip((t_s - t_stop_s) / stop_s, 0.0, 1.0)
        braked_s = stop_s * (part / 2.0 + np.sin(math.pi * part) / (2.0 * math.pi))
        return np.asarray(100.0 * (np.minimum(t_s, t_stop_s) + braked_s))

    return RotatedPath(along_mm, float(seed))


MOTIONS: dict[str, Motion] = {
    "strokes": Motion(lambda seed: Strokes(100 + seed, 100.0), 6.0, 20),
    "quiet_strokes": Motion(lambda seed: Strokes(100 + seed, 100.0), 6.0, 100, QUIET_NOISE_MM),
    "slide": Motion(_slide),
    "straight": _straight(100.0),
    "fast_straight": _straight(300.0),
    "rest": Motion(lambda seed: Rest((21.7 + 0.1 * seed, -8.3))),
    "sine": _sine(200.0),
    "fast_sine": _sine(400.0),
    "circle": _circle(150.0, 15.0),
    "fast_circle": _circle(300.0, 20.0),
    "reach": Motion(_reach, warm_up=20),
    "stop": Motion(_stop, 0.9),
}
