"""The plate between the converters at their own rate: two resonators, their amplifiers and sensors, sample by sample.

    w'' + 2 sigma w' + w0^2 w = 2 w_drive g v        per mode, in um and V, v held for a sample

Each is one complex pole, so a chunk is one recursive filter, exact for a held input. The amplifiers clip. Left out: the
amplifiers' and sensors' own bandwidth, the converters' settling and their errors other than rounding and noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

SAMPLE_S = 1e-6
DRIVE_HZ = 29205.0
STEPS = 4096
STEP_V = 3.3 / STEPS


@dataclass(slots=True)
class Plate:
    """The reference plate behind 110 V/V and 4.85 um/V, with two to eight modes of it; `noise_steps` is the standard
    deviation of the ADCs' noise."""

    mode_hz: tuple[float, ...] = (29195.0, 29215.0, 29205.0, 29255.0, 29155.0, 29105.0, 29305.0, 29375.0)
    quality: float = 500.0
    amplifier_v_per_v: float = 110.0
    amplifier_limit_v: float = 180.0
    sensor_um_per_v: float = 4.85
    noise_steps: float = 0.5
    seed: int = 1
    sample_s: float = SAMPLE_S
    _state: list[npt.NDArray[np.complex128]] = field(init=False)
    _held: npt.NDArray[np.uint16] = field(init=False)
    _random: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        self._state = [np.zeros(1, dtype=np.complex128) for _ in self.mode_hz]
        self._held = np.full((1, len(self.mode_hz)), 0x800, dtype=np.uint16)
        self._random = np.random.default_rng(self.seed)

    def gain_um_per_v_s(self, k: int) -> float:
        """g of dW/dt = (-sigma + j delta) W - j g V: 150 V hold 4 um at the drive frequency."""
        return 4.0 / 150.0 * math.hypot(self.decay_1_s(k), 2.0 * math.pi * (self.mode_hz[k] - DRIVE_HZ))

    def decay_1_s(self, k: int) -> float:
        return math.pi * self.mode_hz[k] / self.quality

    def advance(
        self, words: npt.NDArray[np.uint16], *, connected: bool, delay_frac: float | Sequence[float]
    ) -> tuple[npt.NDArray[np.uint16], npt.NDArray[np.complex128]]:
        """Plays `words` (n, modes), right-aligned, and samples: words (n, modes), and the motion (n, modes).

        A trigger puts out the word that was fetched before it, so each is played a sample later; the sample is taken
        `delay_frac` of a sample (each mode's) after the new value appears. The motion is Re: displacement in um,
        Im: its quadrature.
        Without `connected` the amplifiers give nothing.
        """
        played = np.concatenate((self._held, words[:-1]))
        self._held = words[-1:]
        n = len(words)
        sampled = np.zeros_like(words)
        motion_um = np.zeros(words.shape, dtype=np.complex128)
        delays = np.broadcast_to(delay_frac, len(self.mode_hz))
        for k in range(len(self.mode_hz)):
            asked_v = (played[:, k].astype(np.float64) - STEPS / 2) * STEP_V * self.amplifier_v_per_v
            voltage_v = np.clip(asked_v, -self.amplifier_limit_v, self.amplifier_limit_v) if connected else np.zeros(n)
            motion_um[:, k] = self._resonator(k, voltage_v, float(delays[k]))
            steps = motion_um[:, k].real / (self.sensor_um_per_v * STEP_V) + self._random.normal(0, self.noise_steps, n)
            sampled[:, k] = np.clip(np.rint(steps + STEPS / 2), 0, STEPS - 1).astype(np.uint16)
        return sampled, motion_um

    def _resonator(self, k: int, voltage_v: npt.NDArray[np.float64], delay_frac: float) -> npt.NDArray[np.complex128]:
        """z' = lambda z + b v with w = Re z, `delay_frac` of a sample after each hold began."""
        decay_1_s = self.decay_1_s(k)
        free_rad_s = math.sqrt((2 * math.pi * self.mode_hz[k]) ** 2 - decay_1_s**2)
        pole_1_s = complex(-decay_1_s, free_rad_s)
        per_volt = 2 * (2 * math.pi * DRIVE_HZ) * self.gain_um_per_v_s(k) / (1j * free_rad_s)
        step = np.exp(pole_1_s * self.sample_s)
        weight = per_volt * (step - 1) / pole_1_s
        begun, self._state[k] = lfilter([0, weight], [1, -step], voltage_v, zi=self._state[k])
        later = np.exp(pole_1_s * self.sample_s * delay_frac)
        return begun * later + per_volt * (later - 1) / pole_1_s * voltage_v
