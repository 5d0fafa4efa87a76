"""The basis, against exact rational arithmetic."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from hapticd.design import legendre


def exact_polynomials(degree: int) -> list[list[mpmath.mpf]]:
    """Orthonormal Legendre polynomials as power series, lowest power first, at 80 digits."""
    rows = [[mpmath.mpf(1)], [mpmath.mpf(0), mpmath.mpf(1)]]
    for n in range(1, degree):
        raised = [mpmath.mpf(0), *((2 * n + 1) * c for c in rows[n])]
        lower = [n * c for c in rows[n - 1]] + [mpmath.mpf(0)] * 2
        rows.append([(a - b) / (n + 1) for a, b in zip(raised, lower, strict=True)])
    return [[c * mpmath.sqrt(n + mpmath.mpf(1) / 2) for c in row] for n, row in enumerate(rows)]


def derivative(row: list[mpmath.mpf], order: int) -> list[mpmath.mpf]:
    for _ in range(order):
        row = [power * c for power, c in enumerate(row)][1:]
    return row


def power_series(row: list[mpmath.mpf], s: float) -> mpmath.mpf:
    return mpmath.fsum(c * mpmath.mpf(s) ** power for power, c in enumerate(row))


@pytest.mark.parametrize("order", [0, 1, 2, 4])
def test_values_and_derivatives_are_exact_to_rounding(order: int) -> None:
    with mpmath.workdps(80):
        rows = exact_polynomials(34)
        for s in (-1.0, -0.93, 0.1, 1.0):
            exact = [float(power_series(derivative(row, order), s)) for row in rows]
            scale = max(abs(value) for value in exact)
            np.testing.assert_allclose(
                legendre.values(np.array([s]), 34, order)[0], exact, rtol=1e-11, atol=1e-13 * scale
            )
