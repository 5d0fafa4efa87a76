"""Contacts at random places on a plate, and the points by which means over them are taken."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from hapticd.core.plate.bicubic import BicubicSurfaces
from hapticd.values import FloatArray

from .mode_shape import ModeShape

APART_MM = 20.0  # of two fingertips side by side
EDGE_MM = 10.0  # from a finger's centre to the plate's edge

_DISC_RADII, _DISC_ANGLES = 3, 8  # exact to degree 5; the solver's seven points are too few for seven modes
_KNOTS_PER_WAVE = 12  # of the spline through a shape
_DRAWN_PER_PAIR = 8  # more than enough of them are 20 mm apart, on plates of 60 mm and more
_MOST_DRAWS = 1000
_WORDS = {2: "two", 3: "three", 4: "four", 5: "five"}


class ShapeMaps(Protocol):
    """Mode shapes that can be evaluated at many points: splines or a mode map."""

    def evaluate(self, points_mm: FloatArray, /) -> FloatArray:
        """Return the shapes (N, M) at points (N, 2)."""
        ...


def random_fingers(size_mm: tuple[float, float], count: int, seed: int, fingers: int = 2) -> FloatArray:
    """Return positions (count, fingers, 2) in mm: of two, the slipping finger, then the still one. Raises ValueError
    for a plate without room for them."""
    half_mm = np.array(size_mm) / 2.0 - EDGE_MM
    no_room = ValueError(
        f"a plate of {size_mm[0]:g} x {size_mm[1]:g} mm has no room for {_WORDS.get(fingers, fingers)} fingers."
    )
    if not (half_mm > 0.0).all() or 2.0 * math.hypot(*half_mm) <= 2.0 * APART_MM:
        raise no_room
    random = np.random.default_rng(seed)
    found = np.empty((0, fingers, 2))
    for _ in range(_MOST_DRAWS):
        drawn = random.uniform(-half_mm, half_mm, (_DRAWN_PER_PAIR * count, fingers, 2))
        one, other = np.triu_indices(fingers, 1)
        is_apart = (np.hypot(*(drawn[:, one] - drawn[:, other]).T) >= APART_MM).all(axis=0)
        found = np.concatenate((found, drawn[is_apart]))
        if len(found) >= count:
            return found[:count]
    raise no_room


def surfaces(shapes: Sequence[ModeShape]) -> BicubicSurfaces:
    """Return the shapes as splines, which are faster than the theory's polynomials at many points."""
    size_mm = shapes[0].size_mm
    axes = []
    for edge, edge_mm in enumerate(size_mm):
        lines = max(shape.nodal_lines[edge] for shape in shapes)
        axes.append(np.linspace(-edge_mm / 2.0, edge_mm / 2.0, _KNOTS_PER_WAVE * (lines // 2 + 2) + 1))
    return BicubicSurfaces(axes[0], axes[1], np.stack([shape.on_grid(*axes) for shape in shapes]))


def disc(radius_mm: float, radii: int = _DISC_RADII, angles: int = _DISC_ANGLES) -> tuple[FloatArray, FloatArray]:
    """Return points (Q, 2) and weights (Q,) of the mean over a disc: Gauss in r^2, equal angles."""
    nodes, weights = np.polynomial.legendre.leggauss(radii)
    reach_mm = radius_mm * np.sqrt((nodes + 1.0) / 2.0)
    turns = 2.0 * np.pi * np.arange(angles) / angles
    points = reach_mm[:, None, None] * np.stack((np.cos(turns), np.sin(turns)), axis=-1)
    return points.reshape(-1, 2), np.repeat(weights / (2.0 * angles), angles)
