"""The solver for two fingers against rules that lost and a general library.

Problems are random pairs of positions on the plate with shapes known exactly: errors are the solver's own. In half of
them one finger slips at 1 um and one stays still, in the others both slip, at 1 and at 0.6 um.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec

import numpy as np

from ..compiled import why_interpreted
from ..core.solver import solve_batch
from ..sim.plate.ground_truth import DRIVEN_MODES, GroundTruth
from ..sim.score import rms
from ..values import ComplexArray, FloatArray
from .baselines import POLICIES, solve
from .modes import HALF_SIZE_MM, W_LIMIT_UM
from .tables import Table
from .timing import REPEATS, least_us

Solver = Callable[[FloatArray, tuple[float, float]], FloatArray | ComplexArray]  # phi (K, 2, 2), targets -> (K, 2)

ONE_STILL, BOTH_SLIP = (1.0, 0.0), (1.0, 0.6)
_RIDGE = 1e-9  # a quadratic programme's matrix must be definite


def run(*, problems: int = 1000, repeats: int = REPEATS, timed: int = 200) -> tuple[Table]:
    """Compare solvers on `problems` of each kind; `timed` of the first kind are timed."""
    points_mm = np.random.default_rng(11).uniform(-HALF_SIZE_MM, HALF_SIZE_MM, (2 * problems, 2, 2))
    phi = GroundTruth().shapes(points_mm)[..., : len(DRIVEN_MODES)]
    still_phi, slip_phi = phi[:problems], phi[problems:]
    ways: dict[str, Solver] = {policy: partial(_each, policy) for policy in POLICIES}
    ways["solve_batch"] = lambda phi, target_um: solve_batch(phi, target_um, W_LIMIT_UM)
    has_daqp = find_spec("daqp") is not None
    if has_daqp:
        ways["daqp"] = _daqp
    times_us = least_us(
        {name: (partial(way, still_phi[:timed], ONE_STILL), timed) for name, way in ways.items()}, repeats
    )
    rows = {}
    for name, way in ways.items():
        still_um, both_um = way(still_phi, ONE_STILL), way(slip_phi, BOTH_SLIP)
        got_um, got_both_um = _achieved_um(still_phi, still_um), _achieved_um(slip_phi, both_um)
        rows[name] = {
            "time_us": times_us[name],
            "leak_um": rms(got_um[:, 1]),
            "slip_error_um": rms(got_um[:, 0] - ONE_STILL[0]),
            "both_slip_error_um": rms(got_both_um - np.array(BOTH_SLIP)),
            "limits_broken_count": float(np.sum(np.abs(np.concatenate((still_um, both_um))) > W_LIMIT_UM)),
        }
    notes = (
        "leak, slip error: one finger still, one at 1 um; both slip error: at 1 and 0.6 um, where signs are free",
        f"as Python: {why_interpreted()}" if why_interpreted() else "compiled",
        *(() if has_daqp else ("daqp: skipped, it is not installed",)),
    )
    title = "solver: 2 fingers, 2 modes, |W| at most 4 um; RMS errors on random pairs of positions"
    return (Table("solver", title, rows, notes),)


def _each(policy: str, phi: FloatArray, target_um: tuple[float, float]) -> FloatArray | ComplexArray:
    return np.array([solve(one, target_um, W_LIMIT_UM, policy=policy).modal_um for one in phi])


def _daqp(phi: FloatArray, target_um: tuple[float, float]) -> FloatArray:
    """A quadratic programme: still fingers are equalities, the others' squared errors are least, signs as given."""
    import daqp  # for development alone

    still = np.array(target_um) == 0.0
    bounds_um = np.concatenate((W_LIMIT_UM, np.zeros(int(still.sum()))))
    sense = np.array([0, 0, *[5] * int(still.sum())], np.int32)
    solved = []
    for one in phi:
        slipping = one[~still]
        quadratic = slipping.T @ slipping + _RIDGE * np.eye(2)
        linear = -slipping.T @ np.array(target_um)[~still]
        equalities = np.ascontiguousarray(one[still])
        solved.append(daqp.solve(quadratic, linear, equalities, bounds_um.copy(), -bounds_um, sense.copy())[0])
    return np.array(solved)


def _achieved_um(phi: FloatArray, modal_um: FloatArray | ComplexArray) -> FloatArray:
    return np.asarray(np.abs(np.einsum("knm,km->kn", phi, modal_um)))
