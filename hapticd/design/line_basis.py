"""Functions along one edge of a plate: continuous, and polynomials between nodes (B. Szabo and I. Babuska, Finite
Element Analysis, 1991, ch. 2): a hat at each node, and integrated Legendre polynomials that vanish at both ends of an
interval. Their slopes are Legendre polynomials, so that matrices of them are sparse up to high degrees.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..values import FloatArray
from . import legendre

_MERGED_MM = 1e-6  # nodes that are nearer to each other are one


@dataclass(frozen=True, eq=False)
class LineBasis:
    """`functions[0]` (F, C) are coefficients of F functions in the orthonormal Legendre polynomials of every interval,
    one after the other; `functions[1]` those of their derivatives, per mm. `nodes_mm` (I + 1,), `starts` (I + 1,) are
    the first columns of each interval, and C."""

    nodes_mm: FloatArray
    starts: tuple[int, ...]
    functions: tuple[FloatArray, FloatArray]

    def of_parity(self, odd: int) -> LineBasis:
        """Return the even or odd functions of a basis of one interval."""
        sign = 1.0 - 2.0 * odd
        kept = [np.vstack((one[1] + sign * one[0], one[2 + odd :: 2])) for one in self.functions]
        return LineBasis(self.nodes_mm, self.starts, (kept[0], kept[1]))

    def columns(self, from_mm: float, to_mm: float) -> slice:
        """Return the columns of the intervals between two nodes."""
        first, last = (int(np.abs(self.nodes_mm - at_mm).argmin()) for at_mm in (from_mm, to_mm))
        return slice(self.starts[first], self.starts[last])

    def as_series(self, degree: int) -> FloatArray:
        """Return the functions as Legendre series over all of the line (degree + 1, F), the best in least squares."""
        points, weights = np.polynomial.legendre.leggauss(degree + 1)
        half_mm = self.nodes_mm[-1]
        kept = np.zeros((degree + 1, self.starts[-1]))
        for (first, end), (from_mm, to_mm) in zip(pairwise(self.starts), pairwise(self.nodes_mm), strict=True):
            places = ((to_mm - from_mm) * points + from_mm + to_mm) / (2.0 * half_mm)
            weighted = legendre.values(points, end - first - 1) * weights[:, None]
            kept[:, first:end] = legendre.values(places, degree).T @ weighted * np.sqrt((to_mm - from_mm) / 2.0)
        return np.asarray(kept @ self.functions[0].T / half_mm)


def line_basis(ends_mm: Sequence[float], degrees_per_mm: float, more: int) -> LineBasis:
    """Return a basis with nodes at `ends_mm`, in any order, the outermost of which are the line's ends.

    The degree of an interval is `degrees_per_mm` of half its length, and `more`.
    """
    ends = np.unique(ends_mm)
    ends = ends[np.append(np.diff(ends) > _MERGED_MM, True)]
    lengths_mm = np.diff(ends)
    degrees = [math.ceil(degrees_per_mm * length_mm / 2.0) + more for length_mm in lengths_mm.tolist()]
    starts = (0, *np.cumsum([degree + 1 for degree in degrees]).tolist())
    functions = np.zeros((starts[-1] - len(degrees) + 1, starts[-1]))
    slopes = np.zeros_like(functions)
    row = len(ends)
    for at, (degree, length_mm) in enumerate(zip(degrees, lengths_mm.tolist(), strict=True)):
        scale = np.sqrt(length_mm / 2.0)  # of polynomials that are orthonormal in mm
        size = 1.0 / np.sqrt(np.arange(degree + 1) + 0.5)  # P_n is this times the orthonormal one
        start = starts[at]
        functions[at : at + 2, start] = size[0] * scale / 2.0
        functions[at : at + 2, start + 1] = np.array((-1.0, 1.0)) * size[1] * scale / 2.0
        slopes[at : at + 2, start] = np.array((-1.0, 1.0)) * size[0] / (2.0 * scale)
        for n in range(2, degree + 1):
            norm = scale / np.sqrt(4.0 * n - 2.0)
            functions[row, start + n], functions[row, start + n - 2] = size[n] * norm, -size[n - 2] * norm
            slopes[row, start + n - 1] = 1.0 / scale
            row += 1
    return LineBasis(ends, starts, (functions, slopes))
