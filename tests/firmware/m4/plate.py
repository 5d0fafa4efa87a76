"""The plate between the converters at their own rate: two resonators, their amplifiers and sensors, sample by sample.

    w'' + 2 sigma w' + w0^2 w = 2 w_drive g v        per mode, in um and V, v held for a sample

Each is one complex pole, so a chunk is one matrix for each mode, exact for a held input. The amplifiers clip. Left
out: the amplifiers' and sensors' own bandwidth, the converters' settling, their errors but for rounding and noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

SAMPLE_S = 1e-6
DRIVE_HZ = 29205.0
STEPS = 4096
STEP_V = 3.3 / STEPS


class _Response(NamedTuple):
    """Of a chunk of n samples, what each mode's state before it (M, n + 1), and each voltage (M, n + 1, n), make at the
    beginning of each sample and at the end; and (M,) how both go on until the sensor looks."""

    key: tuple[int, float, tuple[float, ...]]
    powers: npt.NDArray[np.complex128]
    to_volts: npt.NDArray[np.complex128]
    later: npt.NDArray[np.complex128]
    per_volt: npt.NDArray[np.complex128]


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
    _state: npt.NDArray[np.complex128] = field(init=False)
    _response: _Response | None = field(init=False, default=None)
    _held: npt.NDArray[np.uint16] = field(init=False)
    _random: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        self._state = np.zeros(len(self.mode_hz), dtype=np.complex128)
        self._held = np.full((1, len(self.mode_hz)), 0x800, dtype=np.uint16)
        self._random = np.random.default_rng(self.seed)

    def gain_um_per_v_s(self, k: int) -> float:
        """g of dW/dt = (-sigma + j delta) W - j g V: 150 V hold 4 um at the drive frequency."""
        return 4.0 / 150.0 * math.hypot(self.decay_1_s(k), 2.0 * math.pi * (self.mode_hz[k] - DRIVE_HZ))

    def decay_1_s(self, k: int) -> float:
        return math.pi * self.mode_hz[k] / self.quality

    def advance(
        self, words: npt.NDArray[np.uint16], *, connected: bool, delay_frac: tuple[float, ...]
    ) -> tuple[npt.NDArray[np.uint16], npt.NDArray[np.complex128]]:
        """Plays `words` (n, modes), right-aligned, and samples: words (n, modes), and the motion (n, modes).

        A trigger puts out the word that was fetched before it, so each is played a sample later; the sample is taken
        `delay_frac` of a sample (each mode's) after the new value appears. The motion is Re: displacement in um,
        Im: its quadrature.
        Without `connected` the amplifiers give nothing.
        """
        played = np.concatenate((self._held, words[:-1])).T
        self._held = words[-1:]
        asked_v = (played - STEPS / 2) * STEP_V * self.amplifier_v_per_v
        voltage_v = asked_v.clip(-self.amplifier_limit_v, self.amplifier_limit_v) if connected else 0.0 * asked_v
        key = len(words), self.sample_s, delay_frac
        if self._response is None or self._response.key != key:
            self._response = self._responding(key)
        of = self._response
        begun = of.powers * self._state[:, None] + (of.to_volts @ voltage_v[..., None])[..., 0]
        self._state = begun[:, -1]
        motion_um = (begun[:, :-1] * of.later[:, None] + of.per_volt[:, None] * voltage_v).T
        noise = self._random.normal(0, self.noise_steps, voltage_v.shape).T
        steps = motion_um.real / (self.sensor_um_per_v * STEP_V) + noise
        return np.rint(steps + STEPS / 2).clip(0, STEPS - 1).astype(np.uint16), motion_um

    def _responding(self, key: tuple[int, float, tuple[float, ...]]) -> _Response:
        """z' = lambda z + b v with w = Re z."""
        modes, (n, sample_s, delay_frac) = range(len(self.mode_hz)), key
        decay_1_s = np.array([self.decay_1_s(k) for k in modes])
        free_rad_s = np.sqrt((2 * math.pi * np.array(self.mode_hz)) ** 2 - decay_1_s**2)
        pole_1_s = -decay_1_s + 1j * free_rad_s
        gains = np.array([self.gain_um_per_v_s(k) for k in modes])
        per_volt = 2 * (2 * math.pi * DRIVE_HZ) * gains / (1j * free_rad_s)
        powers = np.exp(pole_1_s[:, None] * sample_s * np.arange(n + 1))
        weight = per_volt * (powers[:, 1] - 1) / pole_1_s
        age = np.arange(n + 1)[:, None] - 1 - np.arange(n)  # of each held voltage at each sample
        to_volts = np.where(age < 0, 0.0, weight[:, None, None] * powers[:, age])
        later = np.exp(pole_1_s * sample_s * np.array(delay_frac))
        return _Response(key, powers, to_volts, later, per_volt * (later - 1) / pole_1_s)
