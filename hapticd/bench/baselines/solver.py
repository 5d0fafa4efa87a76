"""Solver policies that lost against the core's rules, for the bench.

    keep_zero      the core's own rules (`core.solver`)
    keep_ratio     as keep_zero without limits, then all modes scaled into them: the fingers' ratios survive
    least_squares  a still finger counts like any other: some leak there, less error elsewhere
    priority       the fingers are served in the order of their rows (`solver_priority`)
    paper          the inverse of Phi, signs fixed, scaled into the limits (`paper_scheme`)

`effort` > 0 adds effort * |W|^2 to the error of keep_zero and least_squares: amplitudes shrink towards a singular
position. `hysteresis` > 0 keeps the previous sign pattern while its error and |W|^2 exceed the best by no more than
that share.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ...core.solver import public
from ...core.solver.arithmetic import Row, Rows, all_finite, clamped
from ...core.solver.general import best_solution, is_limited, pose_split, solve_fast, unscaled, with_signs
from ...values import Solution
from .paper_scheme import invert
from .solver_priority import serve_in_order

POLICIES = ("keep_zero", "keep_ratio", "least_squares", "priority", "paper")
_UNLIMITED_UM = 1e30


def solve(
    phi: npt.ArrayLike,
    target_um: npt.ArrayLike,
    limit_um: npt.ArrayLike,
    *,
    policy: str = "keep_zero",
    effort: float = 0.0,
    hysteresis: float = 0.0,
    previous_um: npt.ArrayLike | None = None,
) -> Solution:
    """As `core.solver.solve`, under one of the `POLICIES`. Raises ValueError for an unknown one, too."""
    default = public.solve(phi, target_um, limit_um, previous_um=previous_um)
    rows: Rows = tuple(map(tuple, np.asarray(phi, np.float64).tolist()))
    targets: Row = tuple(np.asarray(target_um, np.float64).tolist())
    limits: Row = tuple(np.broadcast_to(np.asarray(limit_um, np.float64), len(default.modal_um)).tolist())
    previous: Row | None = None if previous_um is None else tuple(np.asarray(previous_um, np.float64).tolist())
    modal, limited = solve_rows(rows, targets, limits, previous, policy=policy, effort=effort, hysteresis=hysteresis)
    achieved_um = np.abs(np.reshape(np.asarray(phi, np.float64), (len(rows), len(modal))) @ np.array(modal))
    return Solution(np.array(modal), achieved_um, limited, default.condition)


def solve_rows(
    rows: Rows,
    targets: Row,
    limits: Row,
    previous: Row | None = None,
    *,
    policy: str = "keep_zero",
    effort: float = 0.0,
    hysteresis: float = 0.0,
) -> tuple[Row, bool]:
    """`solve` on plain floats: modal amplitudes in um, and `limited`."""
    if policy not in POLICIES:
        raise ValueError(f"policy: {policy!r} is unknown; choose one of {', '.join(POLICIES)}.")
    if not all_finite(rows):
        return (0.0,) * len(limits), False
    if policy == "paper":
        return invert(rows, targets, limits)
    if policy == "priority":
        return serve_in_order(rows, targets, limits, previous)
    if policy == "keep_ratio":
        return _keep_ratio(rows, targets, limits, previous)
    if policy == "keep_zero" and effort == hysteresis == 0.0:
        return solve_fast(rows, targets, limits, previous)
    is_still = [target == 0.0 and policy == "keep_zero" for target in targets]
    return _weighed(rows, targets, is_still, limits, previous, effort, hysteresis)


def _keep_ratio(rows: Rows, targets: Row, limits: Row, previous: Row | None) -> tuple[Row, bool]:
    free, _ = solve_fast(rows, targets, (_UNLIMITED_UM,) * len(limits), previous)
    excess = max([abs(w) / limit for w, limit in zip(free, limits, strict=True)])
    if not excess > 1.0:
        return free, False
    return tuple([clamped(w / excess, limit) for w, limit in zip(free, limits, strict=True)]), True


def _weighed(
    rows: Rows,
    targets: Row,
    is_still: Sequence[bool],
    limits: Row,
    previous: Row | None,
    effort: float,
    hysteresis: float,
) -> tuple[Row, bool]:
    """Least squares over the fingers that are not still, with `effort` as one more row per mode."""
    if not any(targets):
        return (0.0,) * len(limits), False
    weighed = [row for row, still in zip(rows, is_still, strict=True) if not still]
    wanted = [target for target, still in zip(targets, is_still, strict=True) if not still]
    if effort > 0.0:
        weighed += map(tuple, (math.sqrt(effort) * np.eye(len(limits))).tolist())
        wanted += [0.0] * len(limits)
    problem = pose_split([row for row, still in zip(rows, is_still, strict=True) if still], weighed, wanted, limits)
    if problem is None:
        return (0.0,) * len(limits), False
    best = best_solution(problem, previous)
    if hysteresis > 0.0 and previous is not None:
        now = np.array(previous)
        held = with_signs(problem, np.copysign(1.0, problem.phi @ now).tolist())
        allowed = hysteresis * float(problem.targets @ best.amplitudes)
        if held.error - best.error <= allowed and held.square <= best.square * (1.0 + hysteresis):
            best = held._replace(modal=np.copysign(1.0, held.modal @ now) * held.modal)
    return unscaled(problem, best.modal, limits), is_limited(problem, best)
