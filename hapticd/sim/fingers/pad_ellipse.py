"""The ellipse that a simulated pad reports of a contact: its own scale, noise, and steps of its bytes.

A real pad's is not documented: no measurement of its scale or noise is public. Here a reported axis is the true one by
an affine law, as in captures of an index finger (98 and 85 counts). Noise acts on the matrix that makes the ellipse of
the unit disc, so the angle of a round contact is arbitrary, as it is on pads; the pad's cells, 5 mm wide, make a
contact seem wider or narrower by turns as it moves over them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ...config.sections import Config
from ...values import FloatArray
from ...wire.trackpad import PadGeometry

CELL_MM: Final = 5.1  # 30 x 22 cells on 156 x 110 mm
MOST_COUNTS: Final = 255
ORIENTATIONS: Final = 8
_UNITS_PER_COUNT: Final = 4


@dataclass(frozen=True, slots=True)
class PadEllipse:
    """A true axis is `scale` times the reported one plus `offset_mm`.

    `noise_frac` of the mean semi-axis is the standard deviation of that mean, and of either part of the difference of
    both; `correlation` is that of one report's noise with the next one's; `cell_frac` is what cells add to an axis at
    most.
    """

    scale: float = 1.15
    offset_mm: float = 0.8
    noise_frac: float = 0.02
    correlation: float = 0.65
    cell_frac: float = 0.03


USUAL: Final = PadEllipse()


def calibrated(config: Config) -> Config:
    """Return the configuration of a daemon that is calibrated for the simulated pad's ellipses."""
    pad = replace(config.trackpad, ellipse_scale=USUAL.scale, ellipse_offset_mm=USUAL.offset_mm)
    return replace(config, trackpad=pad)


Reported = tuple[int, int, int]  # major and minor in counts, and the code of the orientation


class EllipseSensor:
    """A pad's readings of one contact's ellipse, over the blocks of its scans."""

    def __init__(self, of: PadEllipse, pad: PadGeometry, random: np.random.Generator) -> None:
        self._of = of
        self._random = random
        self._mm_per_count = _UNITS_PER_COUNT / (sum(pad.units_per_mm) / 2.0)
        self._noise = np.zeros(3)

    def reported(self, ellipses_mm: FloatArray, positions_mm: FloatArray) -> list[Reported]:
        """Return what is reported of contacts that these matrices (T, 2, 2) make of the unit disc, at positions (T, 2),
        both in the pad's millimetres."""
        mean_mm, along_mm, across_mm = _parts(ellipses_mm)
        size_mm = np.sqrt(np.abs(np.linalg.det(ellipses_mm)))
        noise = self._correlated(self._random.normal(0.0, self._of.noise_frac, (len(ellipses_mm), 3)))
        cells = 0.5 * self._of.cell_frac * np.cos(2.0 * np.pi * np.nan_to_num(positions_mm) / CELL_MM)
        mean_mm = mean_mm + size_mm * (noise[:, 0] + cells[:, 0] + cells[:, 1])
        along_mm = along_mm + size_mm * (noise[:, 1] + cells[:, 0] - cells[:, 1])
        across_mm = across_mm + size_mm * noise[:, 2]
        half_mm = np.hypot(along_mm, across_mm)
        codes = np.rint(0.5 * np.arctan2(across_mm, along_mm) * ORIENTATIONS / math.pi).astype(int) % ORIENTATIONS
        counts = [self._counts(mean_mm + half_mm), self._counts(mean_mm - half_mm), codes.tolist()]
        return list(zip(*counts, strict=True))

    def _counts(self, semi_mm: FloatArray) -> list[int]:
        axis_mm = (2.0 * semi_mm - self._of.offset_mm) / self._of.scale
        counts: list[int] = np.clip(np.rint(axis_mm / self._mm_per_count), 0, MOST_COUNTS).astype(int).tolist()
        return counts

    def _correlated(self, white: FloatArray) -> FloatArray:
        correlation = self._of.correlation
        for row in white:
            row[:] = self._noise = correlation * self._noise + math.sqrt(1.0 - correlation**2) * row
        return white


def _parts(ellipses_mm: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the mean of the semi-axes of ellipses, and the parts of half their difference: the symmetric matrix that
    makes the same ellipse of the unit disc is (mean + along, across; across, mean - along)."""
    square = ellipses_mm @ ellipses_mm.transpose(0, 2, 1)
    xx, xy, yy = square[:, 0, 0], square[:, 0, 1], square[:, 1, 1]
    area = np.sqrt(np.maximum(xx * yy - xy * xy, 0.0))
    root = np.sqrt(xx + yy + 2.0 * area)  # a matrix's square root by Cayley and Hamilton
    return 0.5 * root, 0.5 * (xx - yy) / root, xy / root
