"""The entries to all ways to solve for points, each by the quickest that applies."""

from __future__ import annotations

from ...phasors import SAFE, ModeRow, ModeRows, clamped, unscaled
from .descent import serve_many
from .line import solve_line
from .pair import hold_still, serve_both, serve_one
from .sign_patterns import pose


def solve_fast(
    rows: ModeRows, targets: ModeRow, limits: ModeRow, previous: ModeRow | None = None
) -> tuple[ModeRow, bool]:
    """The touch path's, on plain floats for callers that have checked their input: modal amplitudes in um, and
    `limited`. More fingers or modes than closed forms take descend (`descent`), several slipping ones from `previous`.

    Whatever phi holds, the result is finite and within the limits; a phi that is not finite gives silence.
    """
    direct = _direct(rows, targets, limits, previous)
    if direct is not None:
        return direct
    d_um, q_um = [0.0] * len(limits), [0.0] * len(limits)
    slipping = sum([target > 0.0 for target in targets])
    if previous is not None and slipping > 1:  # one has no sign to keep: from rest it ends at the least amplitudes
        for mode in range(len(limits)):
            d_um[mode] = clamped(previous[mode], limits[mode])
    limited = serve_many(rows, targets, limits, d_um, q_um, is_real=True)
    return _signed(tuple(d_um), previous), limited


def solve_exactly(
    rows: ModeRows, targets: ModeRow, limits: ModeRow, previous: ModeRow | None = None
) -> tuple[ModeRow, bool]:
    """As `solve_fast`, but with the best of all sign patterns however long they take: `solve`."""
    direct = _direct(rows, targets, limits, previous)
    return solve_general(rows, targets, limits, previous) if direct is None else direct


def solve_general(
    rows: ModeRows, targets: ModeRow, limits: ModeRow, previous: ModeRow | None = None
) -> tuple[ModeRow, bool]:
    """As `solve_exactly`, by the general path alone."""
    problem = pose(rows, targets, limits)
    if problem is None:
        return (0.0,) * len(limits), False
    modal, is_limited = problem.best(previous)
    return unscaled(problem.reach, modal, limits), is_limited


def _direct(rows: ModeRows, targets: ModeRow, limits: ModeRow, previous: ModeRow | None) -> tuple[ModeRow, bool] | None:
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
            if second == 0.0 < first:
                if c == 0.0 and d == 0.0:  # on a node of both modes: still, whatever they do
                    return _direct(rows[:1], targets[:1], limits, previous)
                x, y, limited = hold_still((a, b), first, (c, d), box, near)
                return (x, y), limited
            if first == 0.0 < second:
                if a == 0.0 and b == 0.0:
                    return _direct(rows[1:], targets[1:], limits, previous)
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
    return _signed(modal, previous), limited


def _signed(modal: ModeRow, previous: ModeRow | None) -> ModeRow:
    """Return the nearer one to `previous` of W and -W, which no finger can distinguish."""
    lean = 0.0
    if previous is not None:
        for mode in range(len(modal)):
            lean += modal[mode] * clamped(previous[mode], SAFE)
    return modal if lean >= 0.0 else tuple([-w for w in modal])
