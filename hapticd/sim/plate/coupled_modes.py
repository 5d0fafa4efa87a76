"""Modes of a plate that has lost a corner, or that springs hold at its edge, in the span of its own modes.

With shapes of modal mass m_k the equation is (K + sum_s k_s phi_s phi_s^T) a = w^2 (M - dm phi_c phi_c^T) a, K and M
diagonal: close modes mix most. Left out: modes far from the drive, the stiffness of the piece that is lost (it carries
no moment at a free corner), what springs damp, and that patches drive and sense the changed modes a little differently.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hapticd.design import ModeShape

from ...values import FloatArray
from ..world_errors import WorldErrors

_SUPPORTS = 4
_STREAM = 3  # of a seed; those of `shape_tables` are 1 and 2
_MM2_PER_SQUARE = 0.5  # a corner breaks off as a right-angled triangle


def coupled(
    world: WorldErrors, bare: Sequence[ModeShape], mean_square: FloatArray, frequency_hz: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return how the modes mix (P, P), new by old, and by how much their frequencies rise (P,), in Hz.

    The arrays (P,) are the mean squares of the bare shapes over the plate, and their frequencies.
    """
    size_mm = bare[0].size_mm
    corner, springs = (
        np.stack([shape.evaluate(points_mm) for shape in bare], axis=-1) for points_mm in _places_mm(world, size_mm)
    )
    norm = np.sqrt(mean_square)  # shapes / norm have unit mass for a plate of mass 1
    omega = 2.0 * math.pi * frequency_hz
    area_mm2 = _MM2_PER_SQUARE * world.chip_mm**2
    lost = area_mm2 / (size_mm[0] * size_mm[1])
    corner, springs = corner / norm, springs / norm
    # a spring that raises a mode by `supports_hz` where its shape is 1: 2 w dw = k phi^2 / m
    stiffness = 2.0 * omega.mean() * 2.0 * math.pi * world.supports_hz * mean_square.mean()
    mass = np.eye(len(omega)) - lost * corner.T @ corner
    spring = np.diag(omega**2) + stiffness * springs.T @ springs
    root = np.linalg.inv(np.linalg.cholesky(mass))
    squares, vectors = np.linalg.eigh(root @ spring @ root.T)
    own = root.T @ vectors  # columns: new modes in old ones of unit mass, by rising frequency
    rank = np.argsort(np.argsort(omega, kind="stable"), kind="stable")
    own, new_hz = own[:, rank], np.sqrt(squares[rank]) / (2.0 * math.pi)
    own = own * np.where(np.diag(own) < 0.0, -1.0, 1.0)
    return _turned(world, own.T * norm[:, None] / norm), new_hz - frequency_hz


def _places_mm(world: WorldErrors, size_mm: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Return the corner (1, 2) that broke, at the middle of the piece, and the springs (S, 2)."""
    random = np.random.default_rng([world.seed, _STREAM])
    half_mm = np.array(size_mm) / 2.0
    signs = random.choice((-1.0, 1.0), 2)
    corner = signs * (half_mm - world.chip_mm / 3.0)
    along = random.uniform(-1.0, 1.0, _SUPPORTS)
    ends = np.array(((-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)))
    springs = half_mm * (ends + along[:, None] * np.abs(ends[:, ::-1]))
    return corner[None], springs


def _turned(world: WorldErrors, mix: FloatArray) -> FloatArray:
    """Return the mix with the modes of each pair turned into each other, either way."""
    turn = np.eye(len(mix))
    signs = np.random.default_rng([world.seed, _STREAM, 1]).choice((-1.0, 1.0), len(mix))
    for first in range(0, len(mix) - 1, 2):
        angle_rad = signs[first] * math.radians(world.mixing_deg)
        cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
        turn[first : first + 2, first : first + 2] = ((cosine, sine), (-sine, cosine))
    return np.asarray(turn @ mix)
