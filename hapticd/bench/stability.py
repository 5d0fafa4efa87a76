"""The solver at the ends of its range: `hapticd bench stability`.

Every situation is solved with signs and with free phases, warnings raised as errors. Counted are exceptions, numbers
that are not finite, broken limits; what the still finger gets, before and after the wire's float32; and the digits that
agree with the same solution at 60 digits (mpmath). The long walk shows whether errors add up over consecutive steps,
each of which begins at the last one's amplitudes.
"""

from __future__ import annotations

import math
import struct
import time
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ..core.solver import solve
from ..core.solver.points.arithmetic import Rows
from ..core.solver.points.general import solve_fast
from ..core.solver.points.phase import solve_phased_fast
from ..core.trajectory.gate import gate
from ..sim.plate.ground_truth import GroundTruth
from ..values import Drive, Knot
from ..wire.board_messages import FRAME_MAX
from ..wire.device import encode_reference
from ..wire.framing import FrameSplitter
from ..wire.protocol import REFERENCE
from .hard_problems import SITUATIONS, W_LIMIT_UM, Problem, row_tuples
from .tables import Table, finite_rows
from .timing import no_garbage_collection, optional

FloatArray = npt.NDArray[np.float64]
Phasors = Sequence[complex]
Solve = Callable[..., tuple[Phasors, bool]]  # rows, targets, limits, the last step's amplitudes

STEPS = 10_000_000
PHASED_SHARE = 40  # steps with free phases cost some ten times as much: so many times fewer
DEFAULT = "condition 1"
DIGITS = 60
FULL_DIGITS = 17  # what a float64 can agree in
LAP = 2000
NOTHING_UM = 1e-12  # drifts below are rounding


def run(*, problems: int = 200, steps: int = STEPS) -> tuple[Table, ...]:
    """The situations, `problems` of each, and the long walk."""
    return situations(problems), walk(steps)


# --- situations -----------------------------------------------------------------------------------------------------


def situations(problems: int = 200) -> Table:
    """One row for each kind of awkward input."""
    mpmath = optional("mpmath")
    random = np.random.default_rng(29)
    rows = [(name, _figures([make(random) for _ in range(problems)], mpmath)) for name, make in SITUATIONS.items()]
    return Table(
        name="stability",
        title="stability: the solver at the ends of its range; worst of all problems",
        default=DEFAULT,
        rows=finite_rows(rows),
        compared=(),
        skipped={} if mpmath else {"digits": "mpmath is not installed"},
        notes=(
            "failures: exceptions, warnings, numbers that are not finite; limits broken: by the last bit",
            "leak: what a still finger gets, its row's largest entry 1; wire leak: after the float32",
            f"digits: of W, two fingers on two modes, that agree with {DIGITS}-digit arithmetic (both slip: where no",
            "limit is met); W carries the rows' condition, the still finger's zero does not",
        ),
    )


def _figures(problems: Sequence[Problem], mpmath: Any | None) -> dict[str, float]:
    failures, broken, leak_um, wire_leak_um = 0, 0, 0.0, 0.0
    digits: dict[bool, list[float]] = {True: [], False: []}  # by whether the second finger is still
    for problem in problems:
        solved = _solved(problem)
        failures += len(_WAYS) - len(solved)
        for modal in solved.values():
            broken += any(math.hypot(w.real, w.imag) > b for w, b in zip(modal, problem.limits, strict=True))
            leak_um = max(leak_um, leak(problem, modal))
            wire_leak_um = max(wire_leak_um, leak(problem, wired(modal, problem.limits)))
        if mpmath is not None and "signs" in solved:
            agree = agreeing_digits(mpmath, problem, solved["signs"])
            digits[problem.targets[1:2] == (0.0,)] += [] if math.isnan(agree) else [agree]
    return {
        "problems_count": len(problems),
        "failures_count": failures,
        "limits_broken_count": broken,
        "leak_um": leak_um,
        "wire_leak_um": wire_leak_um,
        **{
            name: math.floor(min(digits[is_still])) if digits[is_still] else math.nan
            for name, is_still in (("digits_one_still_count", True), ("digits_both_slip_count", False))
        },
    }


_WAYS: dict[str, Callable[[Problem], Phasors]] = {
    "signs": lambda problem: solve_fast(*problem)[0],
    "phases": lambda problem: solve_phased_fast(*problem)[0],
    "solve": lambda problem: solve(*problem).modal_um.tolist(),
}


def _solved(problem: Problem) -> dict[str, Phasors]:
    """Solutions by signs, by free phases and by the public function; a failed one is missing."""
    solved: dict[str, Phasors] = {}
    for name, way in _WAYS.items():
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                modal = way(problem)
            except (ArithmeticError, ValueError, Warning, np.linalg.LinAlgError):
                continue
        if all(math.isfinite(w.real) and math.isfinite(w.imag) for w in modal):
            solved[name] = modal
    return solved


def leak(problem: Problem, modal: Phasors) -> float:
    """What the still fingers get, um, were their rows' largest entries 1: a tiny row must not hide a leak."""
    worst = 0.0
    for row, target in zip(problem.rows, problem.targets, strict=True):
        size = max([abs(shape) for shape in row])
        if target == 0.0 < size:
            worst = max(worst, abs(sum([shape / size * w for shape, w in zip(row, modal, strict=True)])))
    return worst


def wired(modal: Phasors, limits: tuple[float, ...]) -> Phasors:
    """Modal amplitudes as the board reads them: through the gate, the encoder and a frame's bytes."""
    drive = gate(Drive(0, (Knot(0, tuple(map(complex, modal))),)), limits)
    (message,) = FrameSplitter(FRAME_MAX).feed(encode_reference(0, drive, 0))
    parts = struct.unpack_from(f"<{2 * len(limits)}f", message, 1 + REFERENCE.size + 2)
    return [complex(d, q) for d, q in zip(parts[::2], parts[1::2], strict=True)]


def agreeing_digits(mpmath: Any, problem: Problem, modal: Phasors) -> float:
    """Digits of W, real, that agree with two fingers' exact solution on two modes of the same signs; NaN where that is
    not one in closed form."""
    if len(problem.rows) != 2 or len(problem.limits) != 2 or problem.targets[0] == 0.0:
        return math.nan
    with mpmath.workdps(DIGITS):
        (a, b), (c, d) = rows = [[mpmath.mpf(shape) for shape in row] for row in problem.rows]
        given = [sum(shape * w.real for shape, w in zip(row, modal, strict=True)) for row in rows]
        first, second = (mpmath.mpf(t) * (-1 if w < 0 else 1) for t, w in zip(problem.targets, given, strict=True))
        determinant = a * d - b * c
        if problem.targets[1] == 0.0 == determinant:
            return math.nan if c == d == 0 else 0.0 if any(modal) else FULL_DIGITS
        if determinant == 0:
            return math.nan
        exact = [(d * first - b * second) / determinant, (a * second - c * first) / determinant]
        excess = max(abs(w) / limit for w, limit in zip(exact, problem.limits, strict=True))
        if excess > 1 and second != 0:
            return math.nan
        exact = [w / max(excess, 1) for w in exact]
        size = max(map(abs, exact))
        error = max(abs(mpmath.mpf(w.real) - x) for w, x in zip(modal, exact, strict=True)) / size
        return float(max(0, min(-mpmath.log10(error), FULL_DIGITS))) if error > 0 else FULL_DIGITS


# --- the long walk --------------------------------------------------------------------------------------------------


def walk(steps: int = STEPS) -> Table:
    """Two fingers walk the same closed way lap after lap; the last lap against the first, and against 60 digits."""
    mpmath = optional("mpmath")
    track = [row_tuples(rows) for rows in GroundTruth().shapes(closed_way_mm())[..., :2]]
    few = steps // PHASED_SHARE
    ways: dict[str, tuple[int, tuple[float, float], Solve]] = {
        "solve_fast, one still": (steps, (1.0, 0.0), solve_fast),
        "solve_phased_fast, one still": (few, (1.0, 0.0), solve_phased_fast),
        "solve_phased_fast, both slip": (few, (1.0, 0.6), solve_phased_fast),
    }
    rows = [
        (name, _walked(track, wanted, way, max(count // LAP, 3), mpmath)) for name, (count, wanted, way) in ways.items()
    ]
    return Table(
        name="stability_walk",
        title="stability: consecutive steps along a closed way, each from the last one's amplitudes",
        default="solve_fast, one still",
        rows=finite_rows(rows),
        compared=(),
        time="time_us",
        error="drift_um",
        floor=NOTHING_UM,
        skipped={} if mpmath else {"error": "mpmath is not installed"},
        notes=(
            "drift: greatest difference of |w_i| between the second lap and the last",
            "error: of W in the last lap, against the same line at 60 digits",
        ),
    )


def closed_way_mm() -> FloatArray:
    """Return places (LAP, 2, 2) of two fingers along a closed way, 0.2 mm apart in the mean."""
    angle = 2 * np.pi * np.arange(LAP) / LAP
    return np.stack(
        [
            np.column_stack([40 * np.cos(angle), 30 * np.sin(2 * angle)]),
            np.column_stack([35 * np.sin(3 * angle) + 5, 45 * np.cos(angle)]),
        ],
        axis=1,
    )


def _walked(
    track: list[Rows], wanted: tuple[float, float], way: Solve, laps: int, mpmath: Any | None
) -> dict[str, float]:
    previous: Any = None
    second: list[Phasors] = []
    with no_garbage_collection():
        t_start_ns = time.perf_counter_ns()
        for lap in range(laps):
            last = []
            for rows in track:
                previous, _ = way(rows, wanted, W_LIMIT_UM, previous)
                last.append(previous)
            if lap == 1:
                second = last
        took_us = (time.perf_counter_ns() - t_start_ns) * 1e-3
    got, was = (np.abs(np.einsum("snm,sm->sn", np.array(track), np.array(lap))) for lap in (last, second))
    errors: list[float] = []
    if mpmath is not None and wanted[1] == 0.0:
        problems = [Problem(rows, wanted, W_LIMIT_UM) for rows in track]
        errors = [10 ** -agreeing_digits(mpmath, *solved) for solved in zip(problems, map(_real, last), strict=True)]
    return {
        "steps_count": laps * len(track),
        "time_us": took_us / (laps * len(track)),
        "drift_um": float(np.max(np.abs(got - was))),
        "leak_um": float(np.max(got[:, 1])) if wanted[1] == 0.0 else math.nan,
        "error_frac": max(errors, default=math.nan),
    }


def _real(modal: Phasors) -> Phasors:
    """Without its common phase."""
    largest = max(modal, key=abs)
    return [w * largest.conjugate() / abs(largest) for w in modal] if abs(largest) > 0.0 else modal
