"""`priority`: the fingers are served one after the other, in the order of their rows, still or slipping alike.

A finger gets what is nearest to its target among the amplitudes that leave every finger before it unchanged; then
sum |W_k|^2 is least, and of equals the one nearest `previous` is taken. This is hierarchical least squares within
limits (Escande, Mansard & Wieber, Int. J. Robotics Research 33, 2014) with one row to a level. A finger whose two signs
serve it equally well leaves two slices of the box; the next fingers choose.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...core.solver.arithmetic import EQUAL_NORM, NOISE, Row, Rows, clamped
from ...core.solver.polytope import RANK, descend, shortest

FloatArray = npt.NDArray[np.float64]

_EQUAL = 1e-12  # of the box's size: slices that serve a finger alike
_MOST_SLICES = 8  # each costs a descent per level; ties need symmetry, so several at once are exceptional


class Slice(NamedTuple):
    """What the fingers served so far leave: modal + free z, within the box."""

    modal: FloatArray  # (M,)
    free: FloatArray  # (M, r), orthonormal


def serve_in_order(rows: Rows, targets: Row, limits: Row, previous: Row | None) -> tuple[Row, bool]:
    """Modal amplitudes, and whether a limit was met and a finger misses its target."""
    reach = max(limits)
    box = np.array(limits) / reach
    slices, is_missed = [Slice(np.zeros(len(box)), np.eye(len(box)))], False
    for row, target_um in zip(rows, targets, strict=True):
        size = max(map(abs, row))
        if size == 0.0:
            continue
        # A target beyond all that the box can give is like any other: all that the finger can get.
        phi, target = np.array(row) / size, min(target_um / size / reach, 2.0 * len(box))
        slices = [left for one in slices for left in _served(one, phi, target, box)]
        missed = [abs(abs(float(phi @ one.modal)) - target) for one in slices]
        slices = [one for one, miss in zip(slices, missed, strict=True) if miss <= min(missed) + _EQUAL][:_MOST_SLICES]
        is_missed = is_missed or min(missed) > 1e-9 * target
    found = [_descended(one, np.eye(one.free.shape[1]), -(one.free.T @ one.modal), box) for one in slices]
    chosen = _nearest(found, np.zeros(len(box)) if previous is None else np.array(previous) / reach)
    at_limit = bool(np.any(np.abs(chosen) >= box * (1.0 - _EQUAL)))
    modal = tuple([clamped(w * reach, limit) for w, limit in zip(chosen.tolist(), limits, strict=True)])
    return modal, at_limit and is_missed


def _nearest(found: list[FloatArray], near: FloatArray) -> FloatArray:
    """Of the least W the one nearest the present amplitudes; W or -W alike."""
    least = min([float(modal @ modal) for modal in found]) * (1.0 + EQUAL_NORM)
    equal = [-modal if modal @ near < 0.0 else modal for modal in found if modal @ modal <= least]
    return min(equal, key=lambda modal: float(np.sum((modal - near) ** 2)))


def _served(one: Slice, phi: FloatArray, target: float, box: FloatArray) -> list[Slice]:
    """The slice at its best for one finger, for each sign of it."""
    gains = phi @ one.free
    gains[np.abs(gains) <= 4 * NOISE * (np.abs(phi) @ np.abs(one.free))] = 0.0
    if not np.any(gains):
        return [one]
    given = float(phi @ one.modal)
    signs = (1.0, -1.0) if np.any(one.modal) and target > 0.0 else (1.0,)
    left = np.linalg.svd(gains[None])[2][1:].T
    wanted = [np.array([sign * target - given]) for sign in signs]
    return [Slice(_descended(one, gains[None], b, box), one.free @ left) for b in wanted]


def _descended(one: Slice, a: FloatArray, b: FloatArray, box: FloatArray) -> FloatArray:
    """The modal amplitudes of a slice with the least |A z - b| within the box."""
    if one.free.shape[1] == 0:
        return one.modal
    bounds = np.maximum(np.concatenate([box - one.modal, box + one.modal]), 0.0)
    free = shortest(a, b, RANK * float(np.linalg.norm(a)))
    return one.modal + one.free @ descend(a, b, np.vstack([one.free, -one.free]), bounds, free)
