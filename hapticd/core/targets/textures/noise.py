"""A random texture: a sum of plane waves, the same for the same seed on every machine.

The waves are drawn by SplitMix64 (Steele, Lea and Flood 2014), which is exact integer arithmetic. Directions follow the
golden ratio, so that few waves are enough to look alike from all sides.
"""

from __future__ import annotations

import math
from typing import Final

from hapticd_contract.contents import Noise

from .texture import FAR_MM, PIECES_PER_WAVE, AmplitudeAt, Detail, Texture, TexturePlate

WAVES: Final = 16
MOST_RMS: Final = 3.0  # beyond so many deviations, where 16 waves seldom are, the texture is cut
_MASK: Final = 2**64 - 1
_GOLDEN: Final = 0.5 * (math.sqrt(5.0) - 1.0)

_Wave = tuple[float, float, float, float]  # rad/mm along x and y, rad, um


def _amplitude(target: Noise, _plate: TexturePlate) -> AmplitudeAt:
    waves = _waves(target)
    mean_um = target.mean_um
    low_um, high_um = max(mean_um - MOST_RMS * target.rms_um, 0.0), mean_um + MOST_RMS * target.rms_um

    def amplitude_um(x_mm: float, y_mm: float) -> float:
        if not (-FAR_MM <= x_mm <= FAR_MM and -FAR_MM <= y_mm <= FAR_MM):
            return mean_um
        sum_um = mean_um
        for x_rad_mm, y_rad_mm, phase_rad, height_um in waves:
            # `math.cos` by its name is one call of C; a local name for it costs four times as much in machine code.
            sum_um += height_um * math.cos(x_rad_mm * x_mm + y_rad_mm * y_mm + phase_rad)
        return min(max(sum_um, low_um), high_um)

    return amplitude_um


def _waves(target: Noise) -> list[_Wave]:
    """Return the waves: evenly spread over octaves and directions, with random phases and their sum's RMS as asked."""
    numbers = _uniform(target.seed, 3 * WAVES)
    octaves = math.log2(target.longest_mm / target.shortest_mm)
    waves: list[_Wave] = []
    for index in range(WAVES):
        octave, turn, phase = numbers[3 * index : 3 * index + 3]
        wavelength_mm = target.shortest_mm * 2.0 ** (octaves * (index + octave) / WAVES)
        angle_rad = math.pi * (index * _GOLDEN + turn / WAVES)
        rad_mm = 2.0 * math.pi / wavelength_mm
        height = (wavelength_mm / target.longest_mm) ** target.exponent
        waves.append((rad_mm * math.cos(angle_rad), rad_mm * math.sin(angle_rad), 2.0 * math.pi * phase, height))
    rms = math.sqrt(0.5 * math.fsum([height * height for _, _, _, height in waves]))
    return [(x, y, phase_rad, height / rms * target.rms_um) for x, y, phase_rad, height in waves]


def _uniform(seed: int, count: int) -> list[float]:
    """Return numbers in 0 .. 1, below 1."""
    state, numbers = seed & _MASK, list[float]()
    for _ in range(count):
        state = (state + 0x9E3779B97F4A7C15) & _MASK
        mixed = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
        mixed = ((mixed ^ (mixed >> 27)) * 0x94D049BB133111EB) & _MASK
        numbers.append(((mixed ^ (mixed >> 31)) >> 11) * 2.0**-53)
    return numbers


# Where it is cut it is nearly flat, and its waves are smooth: no corners.
TEXTURE = Texture(
    Noise,
    amplitude=_amplitude,
    detail=lambda noise, _size_mm: Detail(noise.shortest_mm / PIECES_PER_WAVE, True),
    highest_um=lambda noise, _curve: noise.mean_um + MOST_RMS * noise.rms_um,
    asks_for_friction=lambda _noise: False,
    fills_shape=False,
)
