"""Linear algebra of a few rows and columns on lists of floats, where an array's call costs more than its work."""

from __future__ import annotations

import math
from collections.abc import Sequence

Vector = list[float]


def dot(one: Vector, other: Vector) -> float:
    """Inner product of vectors of one length."""
    total = 0.0
    for index in range(len(one)):
        total += one[index] * other[index]
    return total


def length(vector: Vector) -> float:
    """Euclidean norm; squares must be within the range of floats."""
    return math.sqrt(dot(vector, vector))


def normalize(vector: Vector) -> None:
    """Scale a vector to length 1."""
    size = length(vector)
    for index in range(len(vector)):
        vector[index] /= size


def remove(vector: Vector, basis: Sequence[Vector]) -> None:
    """Subtract the projection on an orthonormal basis; twice leaves rounding alone (Giraud et al., Numer. Math. 101,
    2005)."""
    for unit in basis:
        share = dot(unit, vector)
        for index in range(len(vector)):
            vector[index] -= share * unit[index]


def solved(matrix: Sequence[Vector], right: Vector) -> Vector:
    """Return x of A x = b, A symmetric and positive definite: its lower triangle, row by row. By Cholesky."""
    count = len(right)
    x: Vector = []
    lower: list[Vector] = []
    for row in range(count):
        factors: Vector = []
        value, diagonal = right[row], matrix[row][row]
        for column in range(row):
            other = lower[column]
            factor = matrix[row][column]
            for index in range(column):
                factor -= factors[index] * other[index]
            factor /= other[column]
            factors.append(factor)
            value -= factor * x[column]
            diagonal -= factor * factor
        factors.append(math.sqrt(diagonal))
        lower.append(factors)
        x.append(value / factors[row])
    for row in range(count - 1, -1, -1):
        value = x[row]
        for below in range(row + 1, count):
            value -= lower[below][row] * x[below]
        x[row] = value / lower[row][row]
    return x
