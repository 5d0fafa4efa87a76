"""The rule by which contacts feel what was asked: its time, its errors, and the bound of a general minimiser.

Problems are fingers at random on the fingertip plate, one at 1 um and one at 0 in turn; the amplitudes before are those
of fingers 1 mm away, as after 10 ms of the touch path, whose knots are closer. Errors are those of friction, in just
noticeable differences, at the rule's own points and with what it expects of errors of the modes. Beyond the plate's six
amplifiers modes have the reach of the last.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from ..core.friction import DEFAULT_FRICTION_CURVE
from ..core.solver.felt import felt_points
from ..core.solver.felt_descent import UNCERTAIN_FRAC
from ..core.solver.instant import AskedPlace, InstantSolver
from ..sim.plate.glasses import FINGERTIP
from ..sim.plate.ground_truth import GroundTruth, PlateSettings
from ..sim.score import CONTACT_RADIUS_MM
from ..values import WEBER_FRAC, ComplexArray, FloatArray
from .tables import Table, finite_rows
from .timing import REPEATS, compare, optional

SIZES = ((2, 4), (2, 6), (2, 8), (3, 8), (5, 8))  # fingers and modes
DRIVEN = 6
REACH_MM, LEAST_GAP_MM = 85.0, 20.0
STARTS = 12  # of the general minimiser
SETTLING = 20  # calls until the amplitudes before are settled
AGO_NS = 10_000_000


class _Problem:
    """One moment: where the fingers are and were, and what they should feel."""

    def __init__(self, fingers: int, modes: int, random: np.random.Generator) -> None:
        plate = GroundTruth(PlateSettings.of(FINGERTIP, min(modes, DRIVEN)))
        self.limits_um = (*plate.w_limit_um, *plate.w_limit_um[-1:] * (modes - len(plate.w_limit_um)))
        self.targets_um = [float(index % 2 == 0) for index in range(fingers)]
        points_mm = _apart(fingers, random)
        self.before = self._places(points_mm + random.normal(scale=1.0, size=points_mm.shape))
        self.now = self._places(points_mm)
        self.map = plate.true_mode_map(modes)
        points = np.array(felt_points()) * (CONTACT_RADIUS_MM, CONTACT_RADIUS_MM, 1.0)
        self._weights = points[:, 2]
        self._phi = self.map.evaluate((points_mm[:, None] + points[:, :2]).reshape(-1, 2)).reshape(fingers, -1, modes)
        self._asked = np.array([DEFAULT_FRICTION_CURVE.friction(target_um) for target_um in self.targets_um])

    def rule(self) -> tuple[InstantSolver, tuple[complex, ...]]:
        """Return a solver, and what it gave the fingers where they were."""
        solver = InstantSolver(
            self.map,
            self.limits_um,
            contact_radius_mm=CONTACT_RADIUS_MM,
        )
        modal_um: tuple[complex, ...] = (0j,) * len(self.limits_um)
        for _ in range(SETTLING):
            modal_um = tuple(map(complex, solver.solve(self.before, modal_um, 10 * AGO_NS).modal_um))
        return solver, modal_um

    def errors_jnd(self, modal_um: ComplexArray) -> FloatArray:
        square = np.abs(self._phi @ modal_um) ** 2 + UNCERTAIN_FRAC**2 * (self._phi**2 @ np.abs(modal_um) ** 2)
        frictions = DEFAULT_FRICTION_CURVE.frictions(np.sqrt(square), np.zeros(1)) @ self._weights
        return np.asarray((frictions / self._asked - 1.0) / WEBER_FRAC)

    def _places(self, points_mm: FloatArray) -> list[AskedPlace]:
        return [
            (float(x_mm), float(y_mm), target_um)
            for (x_mm, y_mm), target_um in zip(points_mm, self.targets_um, strict=True)
        ]


def _apart(fingers: int, random: np.random.Generator) -> FloatArray:
    """Return points (N, 2) at random, LEAST_GAP_MM apart."""
    points: list[FloatArray] = []
    while len(points) < fingers:
        point = random.uniform(-REACH_MM, REACH_MM, 2)
        if all(np.hypot(*(point - other)) > LEAST_GAP_MM for other in points):
            points.append(point)
    return np.array(points)


def run(*, problems: int = 20, repeats: int = REPEATS, starts: int = STARTS) -> Table:
    """Compare one warm call with the best of a general minimiser's starts."""
    random = np.random.default_rng(11)
    rows: list[tuple[str, dict[str, float]]] = []
    optimize = optional("scipy.optimize")
    for fingers, modes in SIZES:
        chosen = [_Problem(fingers, modes, random) for _ in range(problems)]
        name = f"{fingers} contacts, {modes} modes"
        rules = [one.rule() for one in chosen]
        timing = compare({name: (partial(_solve_all, chosen, rules), problems)}, repeats)[name]
        rows.append((name, timing.figures() | _judged(chosen, _solve_all(chosen, rules))))
        if optimize is not None:
            best = [_bound(optimize, one, random, starts) for one in chosen]
            rows.append((f"{name}, bound", _judged(chosen, best)))
    return Table(
        name="felt",
        title=f"solver: friction as asked over contacts of {CONTACT_RADIUS_MM:g} mm on the fingertip plate, a knot "
        "from 1 mm away",
        default=rows[0][0],
        rows=finite_rows(rows),
        compared=("time_us", "felt_frac"),
        skipped={} if optimize is not None else {"bound": "scipy is not installed"},
        notes=(
            "felt: share of problems in which all fingers are within one just noticeable difference of what was asked",
            "error: the largest of all fingers, median over the problems",
            f"bound: SciPy's SLSQP, the best of {starts} starts",
        ),
    )


def _solve_all(
    problems: Sequence[_Problem], rules: Sequence[tuple[InstantSolver, tuple[complex, ...]]]
) -> list[ComplexArray]:
    return [
        np.array(solver.solve(one.now, before_um, AGO_NS).modal_um)
        for one, (solver, before_um) in zip(problems, rules, strict=True)
    ]


def _judged(problems: Sequence[_Problem], found_um: Sequence[ComplexArray]) -> dict[str, float]:
    largest = [np.abs(one.errors_jnd(modal_um)).max() for one, modal_um in zip(problems, found_um, strict=True)]
    return {"felt_frac": float(np.mean(np.array(largest) <= 1.0)), "error_jnd": float(np.median(largest))}


def _bound(optimize: Any, problem: _Problem, random: np.random.Generator, starts: int) -> ComplexArray:
    """Return the amplitudes with the least largest error that SLSQP finds; unknowns are W in parts, in units of the
    limits, and that error."""
    limits_um = np.array(problem.limits_um)
    count = len(limits_um)

    def modal_um(unknowns: FloatArray) -> ComplexArray:
        phasors: ComplexArray = (unknowns[:count] + 1j * unknowns[count : 2 * count]) * limits_um
        return phasors

    def rest(unknowns: FloatArray) -> FloatArray:
        errors = problem.errors_jnd(modal_um(unknowns))
        inside = 1.0 - unknowns[:count] ** 2 - unknowns[count : 2 * count] ** 2
        return np.concatenate((unknowns[-1] - errors, unknowns[-1] + errors, inside))

    best, least = np.zeros(count, np.complex128), np.inf
    for _ in range(starts):
        found = optimize.minimize(
            lambda unknowns: unknowns[-1],
            np.append(random.uniform(-0.5, 0.5, 2 * count), 5.0),
            jac=lambda unknowns: np.append(np.zeros(len(unknowns) - 1), 1.0),
            method="SLSQP",
            constraints=[{"type": "ineq", "fun": rest}],
            options={"maxiter": 150},
        )
        phasors = modal_um(found.x)
        phasors /= np.maximum(1.0, np.abs(phasors) / limits_um)
        largest = float(np.abs(problem.errors_jnd(phasors)).max())
        if largest < least:
            best, least = phasors, largest
    return best
