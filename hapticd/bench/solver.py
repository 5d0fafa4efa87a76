"""The solver for two fingers against the paper's formula and a general library.

Problems are random pairs of positions on the plate with shapes known exactly: errors are the solver's own. In half of
them one finger slips at 1 um and one stays still, in the others both slip, at 1 and at 0.6 um.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from ..compiled import why_interpreted
from ..core.phasors import ModeRow, ModeRows
from ..core.solver import solve, solve_batch
from ..sim.plate.ground_truth import DRIVEN_MODES, GroundTruth
from ..sim.score import rms
from ..values import ComplexArray, FloatArray
from .baselines.solver import POLICIES, solve_rows
from .modes import HALF_SIZE_MM, W_LIMIT_UM
from .tables import Table, finite_rows
from .timing import REPEATS, compare, optional

Solver = Callable[[FloatArray, tuple[float, float]], FloatArray | ComplexArray]  # phi (K, 2, 2), targets -> (K, 2)

ONE_STILL, BOTH_SLIP = (1.0, 0.0), (1.0, 0.6)
DEFAULT = "solve"
NOTHING_UM = 1e-9  # leaks below are rounding
_RIDGE = 1e-9  # a quadratic programme's matrix must be definite


def run(*, problems: int = 1000, repeats: int = REPEATS, timed: int = 200) -> Table:
    """Compare solvers on `problems` of each kind; `timed` of the first kind are timed."""
    points_mm = np.random.default_rng(11).uniform(-HALF_SIZE_MM, HALF_SIZE_MM, (2 * problems, 2, 2))
    phi = GroundTruth().shapes(points_mm)[..., : len(DRIVEN_MODES)]
    still_phi, slip_phi = phi[:problems], phi[problems:]
    ways: dict[str, Solver] = {
        DEFAULT: lambda phi, target_um: np.array([solve(one, target_um, W_LIMIT_UM).modal_um for one in phi]),
        "solve_batch": lambda phi, target_um: solve_batch(phi, target_um, W_LIMIT_UM),
        **{name: partial(_each, partial(_by_policy, name)) for name in POLICIES if name != "keep_zero"},
        "numpy solve + clip": _numpy_clip,
    }
    daqp = optional("daqp")
    if daqp is not None:
        ways["daqp"] = partial(_daqp, daqp)
    times = compare({name: (partial(way, still_phi[:timed], ONE_STILL), timed) for name, way in ways.items()}, repeats)
    rows = []
    for name, way in ways.items():
        still_um, both_um = way(still_phi, ONE_STILL), way(slip_phi, BOTH_SLIP)
        got_um, got_both_um = _achieved_um(still_phi, still_um), _achieved_um(slip_phi, both_um)
        figures = {
            **times[name].figures(),
            "leak_um": rms(got_um[:, 1]),
            "slip_error_um": rms(got_um[:, 0] - ONE_STILL[0]),
            "both_slip_error_um": rms(got_both_um - np.array(BOTH_SLIP)),
            "limits_broken_count": float(np.sum(np.abs(np.concatenate((still_um, both_um))) > W_LIMIT_UM)),
        }
        rows.append((name, figures))
    return Table(
        name="solver",
        title="solver: 2 fingers, 2 modes, |W| at most 4 um; RMS errors on random pairs of positions",
        default=DEFAULT,
        rows=finite_rows(rows),
        compared=("time_us", "slip_error_um"),
        time="time_us",
        error="leak_um",
        floor=NOTHING_UM,
        skipped={} if daqp is not None else {"daqp": "daqp is not installed"},
        notes=(
            "leak, slip error: one finger still, one at 1 um; both slip error: at 1 and 0.6 um, where signs are free",
            "limits broken: modal amplitudes above the limit, even by the last bit",
            f"as Python: {why_interpreted()}" if why_interpreted() else "compiled",
        ),
    )


def _each(call: Callable[..., Sequence[complex]], phi: FloatArray, target_um: tuple[float, float]) -> Any:
    return np.array([call((tuple(one), tuple(other)), target_um, W_LIMIT_UM) for one, other in phi.tolist()])


def _by_policy(policy: str, rows: ModeRows, targets: ModeRow, limits: ModeRow) -> ModeRow:
    return solve_rows(rows, targets, limits, policy=policy)[0]


def _numpy_clip(phi: FloatArray, target_um: tuple[float, float]) -> FloatArray:
    """The obvious way: the inverse, and each mode clamped at its limit by itself."""
    limit_um = np.array(W_LIMIT_UM)
    return np.array([np.clip(np.linalg.solve(one, target_um), -limit_um, limit_um) for one in phi])


def _daqp(daqp: Any, phi: FloatArray, target_um: tuple[float, float]) -> FloatArray:
    """A quadratic programme: still fingers are equalities, the others' squared errors are least, signs as given."""
    still = np.array(target_um) == 0.0
    limit_um = np.array(W_LIMIT_UM)
    bounds_um = np.concatenate((limit_um, np.zeros(int(still.sum()))))
    sense = np.array([0, 0, *[5] * int(still.sum())], np.int32)
    wanted_um = np.array(target_um)[~still]
    ridge = _RIDGE * np.eye(2)
    solved = []
    for one in phi:
        slipping = one[~still]
        answer = daqp.solve(
            slipping.T @ slipping + ridge,
            -slipping.T @ wanted_um,
            np.ascontiguousarray(one[still]),
            bounds_um.copy(),
            -bounds_um,
            sense.copy(),
        )
        solved.append(answer[0])
    return np.array(solved)


def _achieved_um(phi: FloatArray, modal_um: FloatArray | ComplexArray) -> FloatArray:
    return np.asarray(np.abs(np.einsum("knm,km->kn", phi, modal_um)))
