"""Damped least squares within |W_k| <= box_k, by the faces of the box; their factors serve all sign patterns.

On a face some modes are at their limits and W = W0 + D y. Least squares on it is by the modified Gram-Schmidt method,
backward stable (Bjorck, BIT 7, 1967), with the damping as rows of its own: squares of gains are never formed, and
directions of which fingers feel nothing keep ten digits.
"""

from __future__ import annotations

import math
from typing import Final

from ...small_matrices import Vector, complement, dot
from .arithmetic import NOISE

DAMPING: Final = 1e-6  # weight of |W|: amplitudes err by a share of its square over the gain's
_TOUCHING: Final = 1.0 + 1e-12  # of a limit: where more than two meet

Least = tuple[Vector, float, bool]  # W, its cost, and whether a limit bent it


class Face:
    """A face of the box: `directions` (r, M), orthonormal, in which W can move while the modes `met` are at their
    limits; `rows` (n, M) are the fingers' shapes."""

    __slots__ = ("_box", "_directions", "_faces", "_met", "_rows", "_towards", "_triangle", "_units")

    def __init__(self, rows: list[Vector], box: Vector, directions: list[Vector], met: list[int]) -> None:
        self._rows: Final = rows
        self._box: Final = box
        self._directions: Final = directions
        self._met: Final = met
        self._units: Final[list[Vector]] = []  # (r, n + M)
        self._triangle: Final[list[Vector]] = []  # by columns
        self._faces: Final[list[Face | None]] = [None] * len(box)
        self._towards: Final[list[Vector]] = [[] for _ in box]
        for direction in directions:
            column = [dot(row, direction) for row in rows] + [DAMPING * part for part in direction]
            entries: Vector = []
            for unit in self._units:
                share = dot(unit, column)
                entries.append(share)
                for index in range(len(column)):
                    column[index] = column[index] - share * unit[index]
            size = math.sqrt(dot(column, column))
            entries.append(size)
            self._triangle.append(entries)
            self._units.append([part / size for part in column])

    def least(self, wanted: Vector, origin: Vector, ceiling: float) -> Least | None:
        """The W of least cost on this face, for `wanted` (n,) of the fingers; None where that is above the ceiling, or
        nothing of the face is within the box. `origin` (M,) is on the face."""
        rest: Vector = []
        for finger in range(len(wanted)):
            rest.append(wanted[finger] - dot(self._rows[finger], origin))
        for w in origin:
            rest.append(-DAMPING * w)
        along = self._projected(rest)
        cost = dot(rest, rest)
        if cost > ceiling:
            return None
        modal = list(origin)
        self._add(modal, along)
        best: Least | None = None
        is_within = True
        for mode in range(len(modal)):
            limit = self._box[mode]
            if abs(modal[mode]) > limit * _TOUCHING and mode not in self._met:
                is_within = False
                found = self._least_at(mode, math.copysign(limit, modal[mode]), wanted, origin, ceiling)
                if found is not None:
                    best, ceiling = found, found[1]
        if is_within and len(self._met) == 0:
            modal = self._undamped(modal, wanted)
        return (modal, cost, len(self._met) > 0) if is_within else best

    def _undamped(self, damped: Vector, wanted: Vector) -> Vector:
        """Give the fingers what the damping took, but for its share of that; not where that takes more than a limit,
        as fingers at all but one place may."""
        modal = list(damped)
        rest = [0.0] * (len(wanted) + len(modal))
        for finger in range(len(wanted)):
            rest[finger] = wanted[finger] - dot(self._rows[finger], modal)
        self._add(modal, self._projected(rest))
        for mode in range(len(modal)):
            if abs(modal[mode]) > self._box[mode]:
                return damped
        return modal

    def _add(self, modal: Vector, y: Vector) -> None:
        for index in range(len(y)):
            share, direction = y[index], self._directions[index]
            for mode in range(len(modal)):
                modal[mode] = modal[mode] + share * direction[mode]

    def _projected(self, rest: Vector) -> Vector:
        """Return y of least |rest - A D y|, and subtract that from `rest`."""
        count = len(self._units)
        y = [0.0] * count
        for index in range(count):
            unit = self._units[index]
            share = dot(unit, rest)
            y[index] = share
            for part in range(len(rest)):
                rest[part] = rest[part] - share * unit[part]
        for index in range(count - 1, -1, -1):
            entries = self._triangle[index]
            y[index] = y[index] / entries[index]
            for before in range(index):
                y[before] = y[before] - entries[before] * y[index]
        return y

    def _least_at(self, mode: int, limit: float, wanted: Vector, origin: Vector, ceiling: float) -> Least | None:
        """The same where one more mode is at its limit."""
        face = self._faces[mode]
        if face is None:
            parts = [direction[mode] for direction in self._directions]
            square = dot(parts, parts)
            if not square > NOISE:
                return None
            size = math.sqrt(square)
            turned = complement([[part / size for part in parts]], len(parts))
            assert turned is not None  # one row depends on no other
            directions = [self._modal(weights) for weights in turned]
            face = self._faces[mode] = Face(self._rows, self._box, directions, [*self._met, mode])
            self._towards[mode] = self._modal([part / square for part in parts])
        away = limit - origin[mode]
        moved = [0.0] * len(origin)
        towards = self._towards[mode]
        for index in range(len(moved)):
            moved[index] = origin[index] + away * towards[index]
        return face.least(wanted, moved, ceiling)

    def _modal(self, weights: Vector) -> Vector:
        modal = [0.0] * len(self._box)
        self._add(modal, weights)
        return modal
