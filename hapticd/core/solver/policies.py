"""What gives way at the limits: the policies of `core.solver`, and their hot path on plain floats."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from ...bench.baselines.solver_priority import serve_in_order
from .arithmetic import Row, within
from .general import solve_space
from .pair import hold_still
from .plane import solve_plane

Rows = tuple[Row, ...]


def solve_fast(
    rows: Rows,
    targets: Row,
    limits: Row,
    previous: Row | None = None,
    policy: str = "keep_zero",
    effort: float = 0.0,
    hysteresis: float = 0.0,
) -> tuple[Row, bool]:
    """`solve` on plain floats for callers that have checked their input: modal amplitudes in um, and `limited`.

    Whatever phi holds, the result is finite and within the limits; a phi that is not finite gives silence.
    """
    if policy == "keep_zero" and len(rows) == 2 and len(limits) == 2:
        one, other = rows[0], rows[1]  # by index: machine code unpacks rows of any length through an iterator
        a, b, c, d = one[0], one[1], other[0], other[1]
        first, second = targets[0], targets[1]
        box = limits[0], limits[1]
        now_x, now_y = 0.0, 0.0
        if previous is not None:
            now_x, now_y = previous[0], previous[1]
        if second == 0.0 < first and (c != 0.0 or d != 0.0):
            x, y, limited = hold_still((a, b), first, (c, d), box, (now_x, now_y), effort)
            return (x, y), limited
        if first == 0.0 < second and (a != 0.0 or b != 0.0):
            x, y, limited = hold_still((c, d), second, (a, b), box, (now_x, now_y), effort)
            return (x, y), limited
    apply = named(policy)
    if not all_finite(rows):
        return (0.0,) * len(limits), False
    return apply(rows, targets, limits, previous, effort, hysteresis)


def all_finite(rows: Rows) -> bool:
    """No shape is NaN or infinite."""
    return all(-math.inf < value < math.inf for row in rows for value in row)


def _keep_zero(
    rows: Rows, targets: Row, limits: Row, previous: Row | None, effort: float, hysteresis: float
) -> tuple[Row, bool]:
    still = [row for row, target in zip(rows, targets, strict=True) if target == 0.0]
    slipping = [row for row, target in zip(rows, targets, strict=True) if target != 0.0]
    wanted = [target for target in targets if target != 0.0]
    return _solve_split(still, slipping, wanted, limits, previous, effort, hysteresis)


def _least_squares(
    rows: Rows, targets: Row, limits: Row, previous: Row | None, effort: float, hysteresis: float
) -> tuple[Row, bool]:
    if not any(target > 0.0 for target in targets):
        return (0.0,) * len(limits), False
    return _solve_split([], rows, targets, limits, previous, effort, hysteresis)


def _keep_ratio(
    rows: Rows, targets: Row, limits: Row, previous: Row | None, effort: float, hysteresis: float
) -> tuple[Row, bool]:
    free, _ = _keep_zero(rows, targets, (math.inf,) * len(limits), previous, effort, hysteresis)
    excess = max([abs(w) / limit for w, limit in zip(free, limits, strict=True)])
    if not excess > 1.0:
        return free, False
    if not excess < math.inf:  # singular beyond the range of floats: no ratio is left to keep
        return _keep_zero(rows, targets, limits, previous, effort, hysteresis)
    scaled = [w / excess for w in free]
    return tuple([max(-limit, min(limit, w)) for w, limit in zip(scaled, limits, strict=True)]), True


def _priority(
    rows: Rows, targets: Row, limits: Row, previous: Row | None, _effort: float, _hysteresis: float
) -> tuple[Row, bool]:
    return serve_in_order(rows, targets, limits, previous)


def _paper(
    rows: Rows, targets: Row, limits: Row, _previous: Row | None, _effort: float, _hysteresis: float
) -> tuple[Row, bool]:
    if len(rows) != 2 or len(limits) != 2:
        return _keep_zero(rows, targets, limits, None, 0.0, 0.0)
    (a, b), (c, d) = rows
    determinant = a * d - b * c
    x, y = d * targets[0] - b * targets[1], a * targets[1] - c * targets[0]
    if not (0.0 < abs(determinant) < math.inf and abs(x) < math.inf and abs(y) < math.inf):
        return (0.0, 0.0), False
    excess = max(abs(x) / limits[0], abs(y) / limits[1])
    limited = excess > abs(determinant)
    divisor = math.copysign(excess, determinant) if limited else determinant
    return within((x / divisor, y / divisor), (limits[0], limits[1])), limited


def _solve_split(
    still: Sequence[Row],
    slipping: Sequence[Row],
    wanted: Sequence[float],
    limits: Row,
    previous: Row | None,
    effort: float,
    hysteresis: float,
) -> tuple[Row, bool]:
    modes = len(limits)
    if not slipping:
        return (0.0,) * modes, False
    if modes == 2:
        return solve_plane(still, slipping, wanted, (limits[0], limits[1]), previous, effort, hysteresis)
    if modes > 2:
        return solve_space(still, slipping, wanted, limits, previous, effort, hysteresis)
    (w, _), limited = solve_plane(
        [(row[0], 0.0) for row in still],
        [(row[0], 0.0) for row in slipping],
        wanted,
        (limits[0], limits[0]),
        None if previous is None else (previous[0], 0.0),
        effort,
        hysteresis,
    )
    return (w,), limited


Policy = Callable[[Rows, Row, Row, Row | None, float, float], tuple[Row, bool]]
POLICIES: dict[str, Policy] = {
    "keep_zero": _keep_zero,
    "keep_ratio": _keep_ratio,
    "least_squares": _least_squares,
    "priority": _priority,
    "paper": _paper,
}


def named(name: str) -> Policy:
    if name not in POLICIES:
        raise ValueError(f"policy: {name!r} is unknown; choose one of {', '.join(POLICIES)}.")
    return POLICIES[name]
