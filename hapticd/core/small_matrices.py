"""Linear algebra of a few rows and columns on lists of floats, where an array's call costs more than its work."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

Vector = list[float]

INDEPENDENT: Final = 1e-10  # of a row: what the others must leave of it


def dot(one: Vector, other: Vector) -> float:
    """Inner product of vectors of one length."""
    total = 0.0
    for index in range(len(one)):
        total += one[index] * other[index]
    return total


def dot_of_two(weights: Vector, one: Vector, other: Vector) -> tuple[float, float]:
    """Inner products with both of a pair, which take less time together."""
    first = second = 0.0
    for index in range(len(weights)):
        weight = weights[index]
        first += weight * one[index]
        second += weight * other[index]
    return first, second


def length(vector: Vector) -> float:
    """Euclidean norm; squares must be within the range of floats."""
    return math.sqrt(dot(vector, vector))


def normalize(vector: Vector) -> None:
    """Scale a vector to length 1."""
    size = length(vector)
    for index in range(len(vector)):
        vector[index] = vector[index] / size


def remove(vector: Vector, basis: Sequence[Vector]) -> None:
    """Subtract the projection on an orthonormal basis; twice leaves rounding alone (Giraud et al., Numer. Math. 101,
    2005)."""
    for unit in basis:
        share = dot(unit, vector)
        for index in range(len(vector)):
            vector[index] = vector[index] - share * unit[index]


def complement(rows: Sequence[Vector], count: int) -> list[Vector] | None:
    """An orthonormal basis of what `rows`, vectors of `count` entries about 1, do not see; None where rows are nearly
    dependent. Its vectors are orthogonal to each row by rounding: Gram-Schmidt, first of the rows, then of the axes of
    which they see the least."""
    if not rows:
        return [[float(place == axis) for place in range(count)] for axis in range(count)]
    basis: list[Vector] = []
    seen = [0.0] * count
    for row in rows:
        before = length(row)
        unit = list(row)
        remove(unit, basis)
        if not length(unit) > INDEPENDENT * before:
            return None
        _add_to_basis(unit, basis, seen)
    for _ in range(count - len(rows)):
        axis = [0.0] * count
        axis[seen.index(min(seen))] = 1.0
        remove(axis, basis)
        _add_to_basis(axis, basis, seen)
    return basis[len(rows) :]


def complement_of_any(rows: Sequence[Vector], count: int) -> list[Vector]:
    """As `complement`, of rows any of which may depend on those before them, nearly or altogether: these are left out.
    Empty where nothing is left."""
    basis = complement(rows, count) if len(rows) < count else None
    if basis is not None:
        return basis
    units: list[Vector] = []
    kept: list[Vector] = []
    for row in rows:
        unit = list(row)
        remove(unit, units)
        remove(unit, units)
        size = length(unit)
        if size > 2.0 * INDEPENDENT * length(row):  # clearly what `complement` takes
            units.append([part / size for part in unit])
            kept.append(row)
            if len(kept) == count:
                return []
    return complement(kept, count) or []


def _add_to_basis(vector: Vector, basis: list[Vector], seen: Vector) -> None:
    remove(vector, basis)
    normalize(vector)
    basis.append(vector)
    for index in range(len(vector)):
        seen[index] = seen[index] + vector[index] * vector[index]


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


def inverse(matrix: Sequence[Vector]) -> list[Vector]:
    """Return A^-1, A symmetric and positive definite: by Gauss-Jordan elimination, which needs no pivots then."""
    count = len(matrix)
    inverted = [list(row) for row in matrix]
    for pivot in range(count):
        own = inverted[pivot]
        factor = 1.0 / own[pivot]
        own[pivot] = 1.0
        for column in range(count):
            own[column] = own[column] * factor
        for index in range(count):
            if index != pivot:
                row = inverted[index]
                share = row[pivot]
                row[pivot] = 0.0
                for column in range(count):
                    row[column] = row[column] - share * own[column]
    return inverted
