"""Orthonormal Legendre polynomials on [-1, 1]: the basis of the plate theory and of the fit of mode maps.

They are complete, well conditioned up to high degrees and assume no edge condition. Free-beam
functions, the usual basis of plate theory, need differences of huge cosh and sinh terms beyond the tenth.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre

from ..values import FloatArray


def values(s: FloatArray, degree: int, order: int = 0) -> FloatArray:
    """Return derivatives of `order` of the polynomials 0..degree at s (N,), as (N, degree + 1)."""
    k, n = np.indices((degree + 1, degree + 1))  # P_n' is the sum of (2k + 1) P_k for k = n-1, n-3, ...
    raised = np.linalg.matrix_power(np.where((k < n) & ((n - k) % 2 == 1), 2.0 * k + 1.0, 0.0), order)
    return np.asarray(legendre.legvander(s, degree) @ raised * np.sqrt(np.arange(degree + 1) + 0.5))


@lru_cache(maxsize=128)
def overlap(degree: int, order_left: int, order_right: int) -> FloatArray:
    """Return integrals over [-1, 1] of products of two derivatives, (degree + 1, degree + 1); exact, read-only."""
    nodes, weights = legendre.leggauss(degree + 1)
    left = values(nodes, degree, order_left)
    result: FloatArray = (left * weights[:, None]).T @ values(nodes, degree, order_right)
    result.setflags(write=False)
    return result
