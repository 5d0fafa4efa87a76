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


def integral(left: list[mpmath.mpf], right: list[mpmath.mpf]) -> mpmath.mpf:
    pairs = ((i + j, a * b) for i, a in enumerate(left) for j, b in enumerate(right) if (i + j) % 2 == 0)
    return mpmath.fsum(2 * product / (power + 1) for power, product in pairs)


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


@pytest.mark.parametrize(("left", "right"), [(0, 0), (1, 1), (2, 2), (0, 2), (4, 4), (3, 1)])
def test_overlaps_are_exact_to_rounding(left: int, right: int) -> None:
    overlap = legendre.overlap(34, left, right)
    norm_left, norm_right = (np.sqrt(np.diag(legendre.overlap(34, order, order))) for order in (left, right))
    with mpmath.workdps(80):
        rows = exact_polynomials(34)
        for i, j in ((34, 34), (33, 7), (20, 20), (5, 30), (2, 2)):
            exact = float(integral(derivative(rows[i], left), derivative(rows[j], right)))
            assert overlap[i, j] == pytest.approx(exact, rel=0.0, abs=1e-12 * norm_left[i] * norm_right[j])
