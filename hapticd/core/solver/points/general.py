"""`solve_fast`: the entry to all ways to solve for points, the quickest that applies."""

from __future__ import annotations

from .arithmetic import SAFE, Row, Rows, clamped, unscaled
from .few_modes import FewModes, pose_few
from .line import solve_line
from .pair import hold_still, serve_both, serve_one
from .sign_patterns import Problem, pose


def solve_fast(rows: Rows, targets: Row, limits: Row, previous: Row | None = None) -> tuple[Row, bool]:
    """`solve` on plain floats for callers that have checked their input: modal amplitudes in um, and `limited`.

    Whatever phi holds, the result is finite and within the limits; a phi that is not finite gives silence.
    """
    if len(limits) == 2 and 1 <= len(rows) <= 2:
        box = limits[0], limits[1]
        near = (0.0, 0.0) if previous is None else (previous[0], previous[1])
        one, first = rows[0], targets[0]  # by index: compiled code unpacks rows of any length through an iterator
        a, b = one[0], one[1]
        if len(rows) == 1:
            x, y, limited, is_solved = serve_one((a, b), first, box, near) if first > 0.0 else (0.0, 0.0, False, True)
            if is_solved:
                return (x, y), limited
        else:
            other, second = rows[1], targets[1]
            c, d = other[0], other[1]
            if second == 0.0 < first and (c != 0.0 or d != 0.0):
                x, y, limited = hold_still((a, b), first, (c, d), box, near)
                return (x, y), limited
            if first == 0.0 < second and (a != 0.0 or b != 0.0):
                x, y, limited = hold_still((c, d), second, (a, b), box, near)
                return (x, y), limited
            if first > 0.0 < second:
                x, y, limited, is_solved = serve_both((a, b, c, d), (first, second), box, near)
                if is_solved:
                    return (x, y), limited
    line = solve_line(rows, targets, limits)
    if line is not None:
        modal, limited = line
        return modal if previous is None or _leans_towards(modal, previous) else tuple([-w for w in modal]), limited
    return _solved(posed(rows, targets, limits), limits, previous)


def solve_general(rows: Rows, targets: Row, limits: Row, previous: Row | None = None) -> tuple[Row, bool]:
    """As `solve_fast`, by the general path alone."""
    return _solved(pose(rows, targets, limits), limits, previous)


def posed(rows: Rows, targets: Row, limits: Row) -> FewModes | Problem | None:
    """The sign patterns of a problem, on floats where it is small, else on arrays; None where only silence serves."""
    few = pose_few(rows, targets, limits)
    return pose(rows, targets, limits) if few is None else few


def _solved(problem: FewModes | Problem | None, limits: Row, previous: Row | None) -> tuple[Row, bool]:
    if problem is None:
        return (0.0,) * len(limits), False
    best = problem.best(previous)
    return unscaled(problem.reach, best.modal, limits), best.is_limited


def _leans_towards(modal: Row, previous: Row) -> bool:
    """Of W and -W, which no finger can distinguish, `modal` is as near to `previous` or nearer."""
    lean = 0.0
    for mode in range(len(modal)):
        lean += modal[mode] * clamped(previous[mode], SAFE)
    return lean >= 0.0
