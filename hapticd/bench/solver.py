"""Modal amplitudes for two fingers: hapticd's solvers, its policies, and what a general library would do.

Problems are random pairs of positions on the plate, shapes known exactly: what is told is the solver's own error. In
half of them one finger is to slip at 1 um and one to stay still, in the others both slip, at 1 and at 0.6 um.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from ..compiled import why_interpreted
from ..core.solver.public import solve, solve_batch, solve_fast, solve_phased_fast
from ..sim.plate.ground_truth import DRIVEN_MODES, GroundTruth
from .modes import HALF_SIZE_MM, W_LIMIT_UM
from .tables import Table, finite_rows
from .timing import REPEATS, compare, optional

FloatArray = npt.NDArray[np.float64]
Phasors = npt.NDArray[np.complex128]
Solver = Callable[[FloatArray, tuple[float, float]], FloatArray | Phasors]  # phi (K, 2, 2), targets -> modal_um (K, 2)

ONE_STILL, BOTH_SLIP = (1.0, 0.0), (1.0, 0.6)
DEFAULT = "solve_fast"
NOTHING_UM = 1e-9  # leaks below are rounding
_RIDGE = 1e-9  # a quadratic programme's matrix must be definite


def run(*, problems: int = 1000, repeats: int = REPEATS, timed: int = 200) -> Table:
    """Compare solvers on `problems` of each kind; `timed` of the first kind are timed. Where the solvers run as machine
    code they are timed as Python too, in a process of its own."""
    still_phi, slip_phi = _shapes(problems)
    solvers, skipped = _alternatives()
    times = compare(_calls(solvers, still_phi[:timed]), repeats)
    interpreted_us = {} if why_interpreted() != "" else _interpreted_us(problems, repeats, timed)
    rows = []
    for name, way in solvers.items():
        still_um, both_um = way(still_phi, ONE_STILL), way(slip_phi, BOTH_SLIP)
        got_um, got_both_um = _achieved_um(still_phi, still_um), _achieved_um(slip_phi, both_um)
        figures = {
            **times[name].figures(),
            **interpreted_us.get(name, {}),
            "leak_um": _rms(got_um[:, 1]),
            "slip_error_um": _rms(got_um[:, 0] - ONE_STILL[0]),
            "both_slip_error_um": _rms(got_both_um - np.array(BOTH_SLIP)),
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
        skipped=skipped,
        notes=(
            "leak, slip error: one finger still, one at 1 um; both slip error: at 1 and 0.6 um, where signs are free",
            "limits broken: modal amplitudes above the limit, be it by the last bit",
            _way(),
        ),
    )


def _way() -> str:
    reason = why_interpreted()
    return f"as Python, for {reason}" if reason else "time: as machine code; interpreted: the same calls as Python"


def _shapes(problems: int) -> tuple[FloatArray, FloatArray]:
    """Mode matrices at random pairs of positions, `problems` for each kind."""
    points_mm = np.random.default_rng(11).uniform(-HALF_SIZE_MM, HALF_SIZE_MM, (2 * problems, 2, 2))
    phi = GroundTruth().shapes(points_mm)[..., : len(DRIVEN_MODES)]
    return phi[:problems], phi[problems:]


def _calls(solvers: Mapping[str, Solver], phi: FloatArray) -> dict[str, tuple[Callable[[], object], int]]:
    return {name: (partial(way, phi, ONE_STILL), len(phi)) for name, way in solvers.items()}


def _interpreted_us(problems: int, repeats: int, timed: int) -> dict[str, dict[str, float]]:
    done = subprocess.run(
        [sys.executable, "-m", __name__, str(problems), str(repeats), str(timed)],
        env={**os.environ, "HAPTICD_PURE": "1"},
        stdout=subprocess.PIPE,
        check=True,
    )
    return dict(json.loads(done.stdout))


def _timed_as_python(problems: int, repeats: int, timed: int) -> dict[str, dict[str, float]]:
    """Figures of our own solvers, for the process that runs machine code."""
    ours = {name: way for name, way in _alternatives()[0].items() if name.startswith("solve")}
    times = compare(_calls(ours, _shapes(problems)[0][:timed]), repeats)
    return {name: {"interpreted_us": timing.best_us} for name, timing in times.items()}


def _alternatives() -> tuple[dict[str, Solver], dict[str, str]]:
    ways: dict[str, Solver] = {
        "solve_fast": _fast,
        "solve_fast, keep_ratio": partial(_fast, policy="keep_ratio"),
        "solve_fast, least_squares": partial(_fast, policy="least_squares"),
        "solve_fast, priority": partial(_fast, policy="priority"),
        "solve_fast, paper": partial(_fast, policy="paper"),
        "solve_fast, effort 0.02": partial(_fast, effort=0.02),
        "solve_phased_fast": _phased,
        "solve": _solve,
        "solve, from lists": lambda phi, target_um: np.array(
            [solve(one, target_um, W_LIMIT_UM).modal_um for one in phi.tolist()]
        ),
        "solve_batch": lambda phi, target_um: solve_batch(phi, target_um, W_LIMIT_UM),
        "numpy solve + clip": _numpy_clip,
    }
    skipped = {}
    optimize, daqp = optional("scipy.optimize"), optional("daqp")
    if optimize is None:
        skipped["lsq_linear (bvls)"] = "scipy is not installed"
    else:
        ways["lsq_linear (bvls)"] = partial(_lsq_linear, optimize)
    if daqp is None:
        skipped["daqp"] = "daqp is not installed"
    else:
        ways["daqp"] = partial(_daqp, daqp)
    return ways, skipped


def _fast(
    phi: FloatArray, target_um: tuple[float, float], *, policy: str = "keep_zero", effort: float = 0.0
) -> FloatArray:
    rows = [(tuple(first), tuple(second)) for first, second in phi.tolist()]
    return np.array([solve_fast(pair, target_um, W_LIMIT_UM, None, policy, effort)[0] for pair in rows])


def _solve(phi: FloatArray, target_um: tuple[float, float]) -> FloatArray:
    targets, limits = np.array(target_um), np.array(W_LIMIT_UM)
    return np.array([solve(one, targets, limits).modal_um for one in phi])


def _phased(phi: FloatArray, target_um: tuple[float, float]) -> Phasors:
    rows = [(tuple(first), tuple(second)) for first, second in phi.tolist()]
    return np.array([solve_phased_fast(pair, target_um, W_LIMIT_UM)[0] for pair in rows])


def _numpy_clip(phi: FloatArray, target_um: tuple[float, float]) -> FloatArray:
    """What one writes first: the inverse, and each mode cut at its limit by itself."""
    limit_um = np.array(W_LIMIT_UM)
    return np.array([np.clip(np.linalg.solve(one, target_um), -limit_um, limit_um) for one in phi])


def _lsq_linear(optimize: Any, phi: FloatArray, target_um: tuple[float, float]) -> FloatArray:
    bounds = tuple(-limit for limit in W_LIMIT_UM), W_LIMIT_UM
    return np.array([optimize.lsq_linear(one, target_um, bounds, method="bvls").x for one in phi])


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


def _achieved_um(phi: FloatArray, modal_um: FloatArray | Phasors) -> FloatArray:
    return np.asarray(np.abs(np.einsum("knm,km->kn", phi, modal_um)))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":  # what a process that runs machine code cannot do itself
    print(json.dumps(_timed_as_python(int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))))
