"""A mode whose integrals are elementary."""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial import legendre

from hapticd.design import ModeShape

SIZE_MM = (160.0, 120.0)


def sine_mode(waves: tuple[int, int], mass_kg: float = 0.036) -> ModeShape:
    """Return sin(k_x x) sin(k_y y) of a thin plate, whose sections turn with its slopes about the plate's middle."""
    degree = 40
    s = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
    scale = np.sqrt(np.arange(degree + 1) + 0.5)
    sides = [[legendre.legfit(s, wave(np.pi * n * s), degree) / scale for wave in (np.sin, np.cos)] for n in waves]
    kx, ky = (2.0 * math.pi * n / edge_mm for n, edge_mm in zip(waves, SIZE_MM, strict=True))
    turns = -kx * np.outer(sides[0][1], sides[1][0]), -ky * np.outer(sides[0][0], sides[1][1])
    still = np.zeros_like(turns[0])
    return ModeShape(
        SIZE_MM, np.outer(sides[0][0], sides[1][0]), waves, "sine", np.array([*turns, still, still]), mass_kg
    )
