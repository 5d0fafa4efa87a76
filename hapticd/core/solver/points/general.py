"""The entries to all ways to solve for points, each by the quickest that applies."""

from __future__ import annotations

from .arithmetic import SAFE, Row, Rows, clamped, unscaled
from .descent import serve_many
from .few_modes import FewModes, pose_few
from .line import solve_line
from .pair import hold_still, serve_both, serve_one
from .sign_patterns import Problem, pose


def solve_fast(rows: Rows, targets: Row, limits: Row, previous: Row | None = None) -> tuple[Row, bool]:
    """The touch path's, on plain floats for callers that have checked their input: modal amplitudes in um, and
    `limited`. More fingers or modes than `few_modes` takes descend from `previous` (`descent`).

    Whatever phi holds, the result is finite and within the limits; a phi that is not finite gives silence.
    """
    direct = _direct(rows, targets, limits, previous)
    if direct is not None:
        return direct
    few = pose_few(rows, targets, limits)
    if few is not None:
        return _solved(few, limits, previous)
    d_um, q_um = [0.0] * len(limits), [0.0] * len(limits)
    if previous is not None:
        for mode in range(len(limits)):
            d_um[mode] = clamped(previous[mode], limits[mode])
    limited = serve_many(rows, targets, limits, d_um, q_um, is_real=True)
    return tuple(d_um), limited


def solve_exactly(rows: Rows, targets: Row, limits: Row, previous: Row | None = None) -> tuple[Row, bool]:
    """As `solve_fast`, but with the best of all sign patterns however long they take: `solve`."""
    direct = _direct(rows, targets, limits, previous)
    if direct is not None:
        return direct
    few = pose_few(rows, targets, limits)
    return solve_general(rows, targets, limits, previous) if few is None else _solved(few, limits, previous)


def solve_general(rows: Rows, targets: Row, limits: Row, previous: Row | None = None) -> tuple[Row, bool]:
    """As `solve_exactly`, by the general path alone."""
    problem = pose(rows, targets, limits)
    return ((0.0,) * len(limits), False) if problem is None else _solved(problem, limits, previous)


def _direct(rows: Rows, targets: Row, limits: Row, previous: Row | None) -> tuple[Row, bool] | None:
    """Closed forms; None where there is none."""
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
    if line is None:
        return None
    modal, limited = line
    return modal if previous is None or _leans_towards(modal, previous) else tuple([-w for w in modal]), limited


def _solved(problem: FewModes | Problem, limits: Row, previous: Row | None) -> tuple[Row, bool]:
    best = problem.best(previous)
    return unscaled(problem.reach, best.modal, limits), best.is_limited


def _leans_towards(modal: Row, previous: Row) -> bool:
    """Of W and -W, which no finger can distinguish, `modal` is as near to `previous` or nearer."""
    lean = 0.0
    for mode in range(len(modal)):
        lean += modal[mode] * clamped(previous[mode], SAFE)
    return lean >= 0.0
