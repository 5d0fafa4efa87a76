"""The solver for two fingers against the paper's formula and a general library; its time for N; the descent for many.

Problems are random pairs of positions on the plate with shapes known exactly: errors are the solver's own. In half of
them one finger slips at 1 um and one stays still, in the others both slip, at 1 and at 0.6 um.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from ..compiled import why_interpreted
from ..core.solver import solve, solve_batch
from ..core.solver.points.arithmetic import Row, Rows
from ..core.solver.points.general import solve_exactly, solve_fast
from ..core.solver.points.phase import solve_phased_fast
from ..sim.plate.ground_truth import DRIVEN_MODES, GroundTruth
from ..sim.score import rms
from .baselines.solver import POLICIES, solve_rows
from .hard_problems import HALF_SIZE_MM, W_LIMIT_UM, row_tuples
from .tables import Table, finite_rows
from .timing import REPEATS, compare, optional

FloatArray = npt.NDArray[np.float64]
Phasors = npt.NDArray[np.complex128]
Solver = Callable[[FloatArray, tuple[float, float]], FloatArray | Phasors]  # phi (K, 2, 2), targets -> modal_um (K, 2)

ONE_STILL, BOTH_SLIP = (1.0, 0.0), (1.0, 0.6)
DEFAULT = "solve_fast"
NOTHING_UM = 1e-9  # leaks below are rounding
SIZES = ((1, 2), (2, 2), (3, 2), (2, 3), (3, 3), (5, 3), (8, 8), (15, 8))
MANY_FINGERS = (6, 11)  # from, to
MANY_MODES = (2, 3, 4, 8)
_RIDGE = 1e-9  # a quadratic programme's matrix must be definite


def run(*, problems: int = 1000, repeats: int = REPEATS, timed: int = 200) -> Table:
    """Compare solvers on `problems` of each kind; `timed` of the first kind are timed."""
    points_mm = np.random.default_rng(11).uniform(-HALF_SIZE_MM, HALF_SIZE_MM, (2 * problems, 2, 2))
    phi = GroundTruth().shapes(points_mm)[..., : len(DRIVEN_MODES)]
    still_phi, slip_phi = phi[:problems], phi[problems:]
    ways: dict[str, Solver] = {
        DEFAULT: partial(_each, lambda *problem: solve_fast(*problem)[0]),
        "solve_phased_fast": partial(_each, lambda *problem: solve_phased_fast(*problem)[0]),
        "solve": lambda phi, target_um: np.array([solve(one, target_um, W_LIMIT_UM).modal_um for one in phi]),
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


def _by_policy(policy: str, rows: Rows, targets: Row, limits: Row) -> Row:
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


def _achieved_um(phi: FloatArray, modal_um: FloatArray | Phasors) -> FloatArray:
    return np.asarray(np.abs(np.einsum("knm,km->kn", phi, modal_um)))


# --- N fingers on M modes -------------------------------------------------------------------------------------------


def sizes(*, calls: int = 20, repeats: int = REPEATS) -> Table:
    """Time `calls` of each size: one of three fingers still, half of the others out of reach."""
    random = np.random.default_rng(23)
    ways: dict[str, tuple[Callable[[], object], int]] = {}
    for fingers, modes in SIZES:
        problems = [tuple(map(tuple, random.uniform(-1, 1, (fingers, modes)).tolist())) for _ in range(calls)]
        targets = tuple(0.0 if index % 3 == 2 else 0.5 + index % 2 * 3.0 for index in range(fingers))
        ways[f"{fingers} on {modes}"] = partial(_solve_all, problems, targets, (2.0,) * modes), calls
    times = compare(ways, repeats)
    return Table(
        name="sizes",
        title="solver: time of a call with N fingers on M modes",
        default="2 on 2",
        rows=finite_rows([(name, timing.figures()) for name, timing in times.items()]),
        compared=("time_us",),
    )


def _solve_all(problems: Sequence[Rows], targets: tuple[float, ...], limits: tuple[float, ...]) -> None:
    for rows in problems:
        solve_fast(rows, targets, limits)


# --- many fingers ---------------------------------------------------------------------------------------------------


def many(*, problems: int = 500, repeats: int = REPEATS, timed: int = 50) -> Table:
    """Compare the descent with the best of all sign patterns, for six to ten fingers; `timed` of the problems are."""
    random = np.random.default_rng(31)
    chosen = [_crowded(random) for _ in range(problems)]
    ways: dict[str, Callable[[Rows, Row, Row], tuple[Sequence[complex], bool]]] = {
        "phases by descent": solve_phased_fast,
        "signs by descent": solve_fast,
        "best of all signs": solve_exactly,
    }
    times = compare({name: (partial(_serve_all, way, chosen[:timed]), timed) for name, way in ways.items()}, repeats)
    rows = []
    for name, way in ways.items():
        errors_um2, still_um = [], 0.0
        for shapes, targets, limits in chosen:
            got_um = np.abs(np.array(shapes) @ np.array(way(shapes, targets, limits)[0]))
            slips = np.array(targets) > 0.0
            errors_um2.append(float(np.sum((got_um - targets)[slips] ** 2)))
            still_um = max(still_um, float(np.max(got_um[~slips], initial=0.0)))
        figures = {"missed_um": float(np.sqrt(np.mean(errors_um2))), "leak_um": still_um}
        rows.append((name, times[name].figures() | figures))
    return Table(
        name="many",
        title="solver: six to ten fingers on 2, 3, 4 and 8 modes, from rest",
        default="phases by descent",
        rows=finite_rows(rows),
        compared=("time_us", "missed_um"),
        notes=(
            "missed: root of the mean sum of squares that the slipping fingers miss, in half of the problems with a",
            "limit of 1 um and in half with 4 um; leak: the largest amplitude of a still finger",
        ),
    )


def _crowded(random: np.random.Generator) -> tuple[Rows, Row, Row]:
    """Random shapes and targets; the still fingers leave more than one direction."""
    modes = int(random.choice(MANY_MODES))
    fingers = int(random.integers(*MANY_FINGERS))
    targets = random.uniform(0.3, 1.5, fingers)
    targets[: random.integers(modes - 1)] = 0.0
    limits = (float(random.choice((1.0, 4.0))),) * modes
    return row_tuples(random.uniform(-1, 1, (fingers, modes))), tuple(targets.tolist()), limits


def _serve_all(way: Callable[[Rows, Row, Row], object], problems: Sequence[tuple[Rows, Row, Row]]) -> None:
    for problem in problems:
        way(*problem)
