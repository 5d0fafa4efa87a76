"""Contacts that feel what was asked: the rule against the bound of a general minimiser, and in the closed loop.

Problems of the rule are fingers at random on the fingertip plate, one at 1 um and one at 0 in turn; the amplitudes
before are those of fingers 1 mm away. Errors are those of friction, in just noticeable differences, at the rule's own
points and with what it expects of errors of the modes. Beyond the plate's six amplifiers modes have the reach of the
last.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy import optimize

from ..core.friction import DEFAULT_FRICTION_CURVE
from ..core.plate.contact import SOLVED_DISC
from ..core.solver.felt_descent import UNCERTAIN_FRAC
from ..core.solver.instant import AskedPlace, InstantSolver
from ..sim.fingers.scenarios import REAL
from ..sim.plate.glasses import FINGERTIP, REFERENCE, WIDE
from ..sim.plate.ground_truth import GroundTruth, PlateSettings
from ..sim.score import CONTACT_RADIUS_MM
from ..sim.settings import Settings
from ..values import WEBER_FRAC, ComplexArray, FloatArray
from .loop import HAPTICD, NOTHING_WRONG, PAPER, PERFECT, SCENARIO, Job, felt_figures, figures, play
from .tables import Table
from .timing import REPEATS, least_us

SIZES = ((2, 4), (2, 6), (2, 8), (3, 8), (5, 8))  # fingers and modes
LOOPS = ((REFERENCE, 2), (FINGERTIP, 4), (WIDE, 8))  # plates and modes
REACH_MM, LEAST_GAP_MM = 85.0, 20.0
SETTLING = 20  # calls until the amplitudes before are settled
AGO_NS = 10_000_000


def run(
    *,
    problems: int = 20,
    repeats: int = REPEATS,
    starts: int = 12,
    seeds: Sequence[int] = (1, 2),
    seconds: float = 10.0,
) -> tuple[Table, Table]:
    """Compare one warm call with the best of a minimiser's `starts`; and the loop with the paper's and the perfect."""
    return _rule(problems, repeats, starts), _loop(seeds, seconds)


def _loop(seeds: Sequence[int], seconds: float) -> Table:
    rows = {}
    for plate, modes in LOOPS:
        calibrated = replace(PlateSettings.of(plate, modes), sensor_crosstalk=0.0)
        settings = Settings(motion=REAL, plate=calibrated)
        found = [play(Job(settings, NOTHING_WRONG, seed, seconds)) for seed in seeds]
        for scheme in (HAPTICD, PAPER, PERFECT):
            of_scheme = [scores[scheme] for scores in found]
            rows[f"{plate} plate, {modes} modes: {scheme}"] = felt_figures(of_scheme) | figures(of_scheme)
    title = f"felt: {SCENARIO} of real hands, 1 um and 0, seeds {', '.join(map(str, seeds))}"
    note = "felt, within two: share of time in which both fingers are within one or two JND (0.11) of what was asked"
    return Table("felt_loop", title, rows, (note,))


class _Problem:
    """One moment: where the fingers are and were, and what they should feel."""

    def __init__(self, fingers: int, modes: int, random: np.random.Generator) -> None:
        plate = GroundTruth(PlateSettings.of(WIDE, modes))
        self.limits_um = np.array(plate.w_limit_um)
        targets_um = [float(index % 2 == 0) for index in range(fingers)]
        points_mm = _apart(fingers, random)
        before_mm = points_mm + random.normal(scale=1.0, size=points_mm.shape)
        before, self._now = (_places(places_mm, targets_um) for places_mm in (before_mm, points_mm))
        modes_map = plate.true_mode_map()
        points = np.array(SOLVED_DISC) * (CONTACT_RADIUS_MM, CONTACT_RADIUS_MM, 1.0)
        self._weights = points[:, 2]
        self._phi = modes_map.evaluate((points_mm[:, None] + points[:, :2]).reshape(-1, 2)).reshape(fingers, -1, modes)
        self._asked = np.array([DEFAULT_FRICTION_CURVE.friction(target_um) for target_um in targets_um])
        self._solver = InstantSolver(modes_map, tuple(self.limits_um.tolist()), contact_radius_mm=CONTACT_RADIUS_MM)
        self._before_um: tuple[complex, ...] = (0j,) * modes
        for _ in range(SETTLING):
            found = self._solver.solve(before, self._before_um, 10 * AGO_NS)
            self._before_um = tuple(map(complex, found.modal_um))

    def solved(self) -> ComplexArray:
        return np.array(self._solver.solve(self._now, self._before_um, AGO_NS).modal_um, np.complex128)

    def errors_jnd(self, modal_um: ComplexArray) -> FloatArray:
        square = np.abs(self._phi @ modal_um) ** 2 + UNCERTAIN_FRAC**2 * (self._phi**2 @ np.abs(modal_um) ** 2)
        frictions = DEFAULT_FRICTION_CURVE.frictions(np.sqrt(square), np.zeros(1)) @ self._weights
        return np.asarray((frictions / self._asked - 1.0) / WEBER_FRAC)


def _places(points_mm: FloatArray, targets_um: Sequence[float]) -> list[AskedPlace]:
    return [(x_mm, y_mm, target_um) for (x_mm, y_mm), target_um in zip(points_mm.tolist(), targets_um, strict=True)]


def _apart(fingers: int, random: np.random.Generator) -> FloatArray:
    """Return points (N, 2) at random, LEAST_GAP_MM apart."""
    points: list[FloatArray] = []
    while len(points) < fingers:
        point = random.uniform(-REACH_MM, REACH_MM, 2)
        if all(np.hypot(*(point - other)) > LEAST_GAP_MM for other in points):
            points.append(point)
    return np.array(points)


def _rule(problems: int, repeats: int, starts: int) -> Table:
    random = np.random.default_rng(11)
    rows: dict[str, dict[str, float]] = {}
    for fingers, modes in SIZES:
        chosen = [_Problem(fingers, modes, random) for _ in range(problems)]
        name = f"{fingers} contacts, {modes} modes"
        (time_us,) = least_us({name: (partial(_solve_all, chosen), problems)}, repeats).values()
        rows[name] = {"time_us": time_us} | _judged(chosen, _solve_all(chosen))
        rows[f"{name}, bound"] = _judged(chosen, [_bound(one, random, starts) for one in chosen])
    notes = (
        "felt: share of problems in which all fingers are within one just noticeable difference of what was asked",
        "error: the largest of all fingers, median over the problems",
        f"bound: SciPy's SLSQP, the best of {starts} starts",
    )
    title = f"felt: friction as asked over contacts of {CONTACT_RADIUS_MM:g} mm on the wide plate, a knot"
    return Table("felt", title, rows, notes)


def _solve_all(problems: Sequence[_Problem]) -> list[ComplexArray]:
    return [one.solved() for one in problems]


def _judged(problems: Sequence[_Problem], found_um: Sequence[ComplexArray]) -> dict[str, float]:
    largest = [np.abs(one.errors_jnd(modal_um)).max() for one, modal_um in zip(problems, found_um, strict=True)]
    return {"felt_frac": float(np.mean(np.array(largest) <= 1.0)), "error_jnd": float(np.median(largest))}


def _bound(problem: _Problem, random: np.random.Generator, starts: int) -> ComplexArray:
    """Return the amplitudes with the least largest error that SLSQP finds; unknowns are W in parts, in units of the
    limits, and that error."""
    count = len(problem.limits_um)

    def modal_um(unknowns: FloatArray) -> ComplexArray:
        return np.asarray((unknowns[:count] + 1j * unknowns[count : 2 * count]) * problem.limits_um)

    def rest(unknowns: FloatArray) -> FloatArray:
        errors = problem.errors_jnd(modal_um(unknowns))
        inside = 1.0 - unknowns[:count] ** 2 - unknowns[count : 2 * count] ** 2
        return np.concatenate((unknowns[-1] - errors, unknowns[-1] + errors, inside))

    found = []
    for _ in range(starts):
        end = optimize.minimize(
            lambda unknowns: unknowns[-1],
            np.append(random.uniform(-0.5, 0.5, 2 * count), 5.0),
            jac=lambda unknowns: np.append(np.zeros(len(unknowns) - 1), 1.0),
            method="SLSQP",
            constraints=[{"type": "ineq", "fun": rest}],
            options={"maxiter": 150},
        )
        phasors = modal_um(end.x)
        found.append(phasors / np.maximum(1.0, np.abs(phasors) / problem.limits_um))
    return min(found, key=lambda phasors: float(np.abs(problem.errors_jnd(phasors)).max()))
