"""`priority`: the fingers are served one after the other, in the order of their rows, still or slipping alike.

A finger gets what is nearest to its target among the amplitudes that leave every finger before it where it is; then
sum |W_k|^2 is least, and of equals the one nearest `previous` is taken. This is hierarchical least squares within
limits (Escande, Mansard & Wieber, Int. J. Robotics Research 33, 2014) with one row to a level: after a level its
amplitude is one number, so what is left to the next is a slice of the box. A finger whose two signs serve it equally
well leaves two slices; the next fingers choose. Neither effort nor hysteresis has a place in that order.

Cost: on one and two modes a few floats a finger: the first leaves a line, the second a point. With more modes a level
costs one walk of `solver_polytope`'s active set for each slice, O(M) decompositions of O(M^3).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...core.solver.arithmetic import NOISE, Pair, Row, cross_terms, within
from ...core.solver.candidates import leans_away, misses, square
from ...core.solver.polytope import descend

FloatArray = npt.NDArray[np.float64]

_EQUAL = 1e-12  # of the box's size: slices that serve a finger alike
_LEAST_GAIN = 1e-150  # of a row's largest entry: what it could give is nothing, and its square is none
_MOST_SLICES = 8  # each costs a walk a level; ties need symmetry, so several at once are exceptional


def serve_in_order(rows: Sequence[Row], targets: Row, limits: Row, previous: Row | None) -> tuple[Row, bool]:
    """Modal amplitudes, and whether a limit was met and a finger misses its target."""
    modes = len(limits)
    reach = max(limits)
    box = tuple([limit / reach for limit in limits])
    levels = [level for row, target in zip(rows, targets, strict=True) if (level := _level(row, target, reach, modes))]
    if modes == 1:
        levels = [((row[0], 0.0), target) for row, target in levels]
        found: list[Row] = [(w,) for w, _ in _in_plane(levels, (box[0], 1.0))]
    elif modes == 2:
        found = list(_in_plane(levels, (box[0], box[1])))
    else:
        found = _in_space(levels, np.array(box))
    modal = tuple([w * reach for w in _chosen(found, previous)])
    modal = tuple([max(-limit, min(limit, w)) for w, limit in zip(modal, limits, strict=True)])
    at_limit = any(abs(w) >= limit * (1.0 - _EQUAL) for w, limit in zip(modal, limits, strict=True))
    return modal, at_limit and _misses(rows, targets, modal)


def _level(row: Row, target: float, reach: float, modes: int) -> tuple[Row, float] | None:
    """A finger's row at a largest entry of 1, and its target to that scale; None on a node of all modes.

    Targets beyond what the box can give are alike: all the finger can get.
    """
    size = max([abs(value) for value in row])
    if size == 0.0:
        return None
    return tuple([value / size for value in row]), min(target / size / reach, 2.0 * modes)


def _chosen(found: Sequence[Row], previous: Row | None) -> Row:
    least = min([square(modal) for modal in found])
    equal = [modal for modal in found if square(modal) <= least * (1.0 + 1e-9)]
    if previous is None:
        return equal[0]
    equal = [tuple([-w for w in modal]) if leans_away(modal, previous) else modal for modal in equal]
    return min(equal, key=lambda modal: sum([(w - p) * (w - p) for w, p in zip(modal, previous, strict=True)]))


def _misses(rows: Sequence[Row], targets: Row, modal: Row) -> bool:
    given = [abs(sum([shape * w for shape, w in zip(row, modal, strict=True)])) for row in rows]
    return misses(given, targets) if all(map(math.isfinite, given)) else True


# --- one and two modes ----------------------------------------------------------------------------------------------


def _in_plane(levels: Sequence[tuple[Row, float]], box: Pair) -> list[Pair]:
    """The points of the box that serve the fingers in order; with one finger the least of its line."""
    if not levels:
        return [(0.0, 0.0)]
    (first, target), *rest = levels
    x, y = first
    wanted = min(target, abs(x) * box[0] + abs(y) * box[1])
    start, end = _ends(first, wanted, box)
    for index, (row, target) in enumerate(rest):
        forward, backward = cross_terms(first, row)
        if abs(forward - backward) > NOISE * (abs(forward) + abs(backward)):
            points = _nearest_on(start, end, row, target)
            return _served_best(points, rest[index:])
    grip = x * x + y * y
    return [_on(start, end, (wanted * x / grip, wanted * y / grip))]


def _ends(row: Row, wanted: float, box: Pair) -> tuple[Pair, Pair]:
    """Where the line row . W = wanted leaves the box."""
    x, y = row
    if abs(y) < abs(x):
        (b, a), (d, c) = _ends((y, x), wanted, (box[1], box[0]))
        return (a, b), (c, d)
    edge, top = box
    low, high = -edge, edge
    if x != 0.0:
        one, other = (wanted - y * top) / x, (wanted + y * top) / x
        low, high = max(low, min(one, other)), min(high, max(one, other))
    return within((low, (wanted - x * low) / y), box), within((high, (wanted - x * high) / y), box)


def _nearest_on(start: Pair, end: Pair, row: Row, target: float) -> list[Pair]:
    """The points between two at which a finger's |w| is nearest its target: one, or two of opposite sign."""
    x, y = row
    one, other = x * start[0] + y * start[1], x * end[0] + y * end[1]
    low, high = min(one, other), max(one, other)
    plus, minus = max(low, min(high, target)), max(low, min(high, -target))
    values = {plus} if minus == plus else {plus, minus}
    missed = {value: abs(abs(value) - target) for value in values}
    least = min(missed.values())
    points = []
    for value in sorted(values, reverse=True):
        if missed[value] <= least + _EQUAL * (abs(value) + _EQUAL):
            share = (value - one) / (other - one) if other != one else 0.0
            points.append((start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])))
    return points


def _served_best(points: list[Pair], levels: Sequence[tuple[Row, float]]) -> list[Pair]:
    """Of several points those that serve the fingers best, in order."""
    for (x, y), target in levels:
        if len(points) == 1:
            break
        missed = [abs(abs(x * u + y * v) - target) for u, v in points]
        points = [point for point, miss in zip(points, missed, strict=True) if miss <= min(missed) + _EQUAL]
    return points


def _on(start: Pair, end: Pair, point: Pair) -> Pair:
    """A point of the line through two, brought between them."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = dx * dx + dy * dy
    if length == 0.0:
        return start
    share = ((point[0] - start[0]) * dx + (point[1] - start[1]) * dy) / length
    if 0.0 <= share <= 1.0:
        return point
    return start if share < 0.0 else end


# --- three modes and more -------------------------------------------------------------------------------------------


class Slice(NamedTuple):
    """What the fingers served so far leave: modal + free z, within the box."""

    modal: FloatArray  # (M,)
    free: FloatArray  # (M, r), orthonormal


def _in_space(levels: Sequence[tuple[Row, float]], box: FloatArray) -> list[Row]:
    slices = [Slice(np.zeros(len(box)), np.eye(len(box)))]
    for row, target in levels:
        phi = np.array(row)
        slices = [left for one in slices for left in _served(one, phi, target, box)]
        missed = [abs(abs(float(phi @ one.modal)) - target) for one in slices]
        slices = [one for one, miss in zip(slices, missed, strict=True) if miss <= min(missed) + _EQUAL]
        del slices[_MOST_SLICES:]
    return [tuple(_walked(one, np.eye(one.free.shape[1]), -(one.free.T @ one.modal), box).tolist()) for one in slices]


def _served(one: Slice, phi: FloatArray, target: float, box: FloatArray) -> list[Slice]:
    """The slice at its best for one finger, for each sign of it."""
    gains = phi @ one.free
    gains[np.abs(gains) <= np.maximum(4 * NOISE * (np.abs(phi) @ np.abs(one.free)), _LEAST_GAIN)] = 0.0
    if not np.any(gains):
        return [one]
    given = float(phi @ one.modal)
    signs = (1.0, -1.0) if np.any(one.modal) and target > 0.0 else (1.0,)
    left = np.linalg.svd(gains[None])[2][1:].T
    return [Slice(_walked(one, gains[None], np.array([sign * target - given]), box), one.free @ left) for sign in signs]


def _walked(one: Slice, a: FloatArray, b: FloatArray, box: FloatArray) -> FloatArray:
    """To the least |A z - b| of a slice within the box."""
    if one.free.shape[1] == 0:
        return one.modal
    bounds = np.maximum(np.concatenate([box - one.modal, box + one.modal]), 0.0)
    return one.modal + one.free @ descend(a, b, np.vstack([one.free, -one.free]), bounds)
