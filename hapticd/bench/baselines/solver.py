"""Rules for points that lost against the core's, by name.

keep_zero      the core's own (`core.solver`)
keep_ratio     as keep_zero without limits, then all modes scaled into them: the fingers' ratios survive
least_squares  a still finger counts like any other: some leak there, less error elsewhere
paper          the inverse of Phi, signs fixed, scaled into the limits
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from ...core.phasors import ModeRow, ModeRows
from ...core.solver import public
from ...core.solver.two_modes import clamped
from ...sim.paper_scheme import invert
from ...values import Solution

POLICIES: Final = ("keep_zero", "keep_ratio", "least_squares", "paper")
_UNLIMITED_UM, _NEARLY_STILL_UM = 1e30, 1e-9


def solve(
    phi: npt.ArrayLike,
    target_um: npt.ArrayLike,
    limit_um: npt.ArrayLike,
    *,
    policy: str = "keep_zero",
    previous_um: npt.ArrayLike | None = None,
) -> Solution:
    """As `core.solver.solve`, under one of the `POLICIES`. Raises ValueError for an unknown one, too."""
    default = public.solve(phi, target_um, limit_um, previous_um=previous_um)  # which checks the input
    if policy == "keep_zero":
        return default
    shapes = np.asarray(phi, np.float64).reshape(-1, len(default.modal_um))
    targets: ModeRow = tuple(np.asarray(target_um, np.float64).tolist())
    limits: ModeRow = tuple(np.broadcast_to(np.asarray(limit_um, np.float64), len(default.modal_um)).tolist())
    previous: ModeRow | None = None if previous_um is None else tuple(np.asarray(previous_um, np.float64).tolist())
    modal_um, limited = solve_rows(tuple(map(tuple, shapes.tolist())), targets, limits, previous, policy=policy)
    return Solution(np.array(modal_um), np.abs(shapes @ modal_um), limited, default.condition)


def solve_rows(
    rows: ModeRows, targets: ModeRow, limits: ModeRow, previous: ModeRow | None = None, *, policy: str
) -> tuple[ModeRow, bool]:
    """Return modal amplitudes in um, and whether limits bind: `solve` on plain floats."""
    if policy not in POLICIES:
        raise ValueError(f"policy: {policy!r} is unknown; choose one of {', '.join(POLICIES)}.")
    if policy == "paper":
        return invert(rows, targets, limits)
    if policy == "keep_ratio":
        return _keep_ratio(rows, targets, limits, previous)
    if policy == "least_squares":
        targets = tuple([max(target, _NEARLY_STILL_UM) for target in targets]) if any(targets) else targets
    return _solved(rows, targets, limits, previous)


def _keep_ratio(rows: ModeRows, targets: ModeRow, limits: ModeRow, previous: ModeRow | None) -> tuple[ModeRow, bool]:
    free_um, _ = _solved(rows, targets, (_UNLIMITED_UM,) * len(limits), previous)
    excess = max([abs(w_um) / limit_um for w_um, limit_um in zip(free_um, limits, strict=True)])
    if not excess > 1.0:
        return free_um, False
    return tuple([clamped(w_um / excess, limit_um) for w_um, limit_um in zip(free_um, limits, strict=True)]), True


def _solved(rows: ModeRows, targets: ModeRow, limits: ModeRow, previous: ModeRow | None) -> tuple[ModeRow, bool]:
    found = public.solve(np.reshape(rows, (len(rows), len(limits))), targets, limits, previous_um=previous)
    return tuple(found.modal_um.tolist()), found.limited
