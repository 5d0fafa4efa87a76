"""The contact solver's time and error, and those of a general minimiser of the same sum from many starts.

Problems are fingers at random on the fingertip plate, one still for each slippery one, and the amplitudes before are
those of fingers 1 mm away, as in the touch path. The touch path's knots are closer. The long walk shows whether errors
add up over consecutive calls.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from functools import partial
from operator import sub

import numpy as np
import numpy.typing as npt

from ..core.friction import DEFAULT_FRICTION_CURVE
from ..core.plate.contact import Gram, contact_grams, disc_points
from ..core.solver.contacts import BUILT_IN, STILL_IMPORTANCE, UNCERTAIN_FRAC, solve_contacts
from ..design.contact_pairs import contact_rms_um, grams, settle
from ..sim.fingers.scenarios import SCENARIOS, SPEED_MM_S
from ..sim.plate.glasses import FINGERTIP, LEAST_PARASITIC
from ..sim.plate.ground_truth import GroundTruth, PlateSettings
from ..sim.score import CONTACT_RADIUS_MM, rms, settled
from .stability import LAP, closed_way_mm
from .tables import Table, finite_rows
from .timing import REPEATS, compare, no_garbage_collection, optional

FloatArray = npt.NDArray[np.float64]
SIZES = ((2, 4), (2, 5), (2, 6), (3, 6), (5, 6))  # fingers and modes
REACH_MM, LEAST_GAP_MM = 85.0, 20.0
STARTS = 5  # of the general minimiser
SETTLING = 6  # calls until the amplitudes before are settled
IMPORTANCES = (
    DEFAULT_FRICTION_CURVE.friction(1.0),
    1.0,
    1.5,
    STILL_IMPORTANCE,
    3.0,
)  # of a still contact; the first is Weber's law
WALKING_MODES = range(2, 9)
WALKING_LIMIT_UM = 4.0


class _Problem:
    """One moment: Gram matrices before and now, and the amplitudes before."""

    def __init__(self, plate: GroundTruth, fingers: int, random: np.random.Generator) -> None:
        modes = plate.true_mode_map()
        points_mm = apart(fingers, random)
        self.limits_um = plate.w_limit_um
        self.targets_um = tuple(float(index % 2 == 0) for index in range(fingers))
        before = contact_grams(modes, points_mm + random.normal(scale=1.0, size=points_mm.shape), CONTACT_RADIUS_MM)
        self.grams: list[Gram] = contact_grams(modes, points_mm, CONTACT_RADIUS_MM).tolist()
        self.d_um, self.q_um = [0.0] * modes.M, [0.0] * modes.M
        for _ in range(SETTLING):
            solve_contacts(before.tolist(), self.targets_um, self.limits_um, self.d_um, self.q_um)

    def solved(self) -> npt.NDArray[np.complex128]:
        d_um, q_um = self.d_um.copy(), self.q_um.copy()
        solve_contacts(self.grams, self.targets_um, self.limits_um, d_um, q_um)
        return np.array(d_um) + 1j * np.array(q_um)

    def felt(self, modal_um: npt.NDArray[np.complex128]) -> float:
        """Return the sum that is to be least, without what keeps it near the amplitudes before."""
        total = 0.0
        for gram, target_um in zip(np.array(self.grams), self.targets_um, strict=True):
            expected = gram + UNCERTAIN_FRAC**2 * np.diag(np.diag(gram))
            square = max(float((modal_um.conj() @ expected @ modal_um).real), 0.0)
            total += BUILT_IN.error(math.sqrt(square), target_um)
        return total


def run(*, problems: int = 20, repeats: int = REPEATS) -> Table:
    """Compare one warm call with the best of a general minimiser's starts."""
    sets = {f"{fingers} contacts, {modes} modes": _problems(fingers, modes, problems) for fingers, modes in SIZES}
    times = compare({name: (partial(_solve_all, chosen), problems) for name, chosen in sets.items()}, repeats)
    minimise = optional("scipy.optimize")
    rows = []
    for name, chosen in sets.items():
        figures = times[name].figures() | {"felt_frac": float(np.mean([one.felt(one.solved()) for one in chosen]))}
        if minimise is not None:
            random = np.random.default_rng(5)
            least = [min(_minimised(minimise, one, random) for _ in range(STARTS)) for one in chosen]
            figures["least_frac"] = float(np.mean(least))
        rows.append((name, figures))
    return Table(
        name="contacts",
        title=f"solver: contacts of {CONTACT_RADIUS_MM:g} mm on the fingertip plate, a call from 1 mm away",
        default=f"{SIZES[0][0]} contacts, {SIZES[0][1]} modes",
        rows=finite_rows(rows),
        compared=("time_us", "felt_frac"),
        time="time_us",
        skipped={} if minimise is not None else {"least": "scipy is not installed"},
        notes=(
            "felt: what is to be least, the contacts' errors of friction relative to bare glass",
            f"least: SciPy's SLSQP, the best of {STARTS} starts",
        ),
    )


def _problems(fingers: int, modes: int, count: int) -> list[_Problem]:
    plate, random = GroundTruth(PlateSettings.of(FINGERTIP, modes)), np.random.default_rng(11)
    return [_Problem(plate, fingers, random) for _ in range(count)]


def apart(fingers: int, random: np.random.Generator) -> FloatArray:
    """Return points (N, 2) at random, LEAST_GAP_MM apart."""
    points: list[FloatArray] = []
    while len(points) < fingers:
        point = random.uniform(-REACH_MM, REACH_MM, 2)
        if all(np.hypot(*(point - other)) > LEAST_GAP_MM for other in points):
            points.append(point)
    return np.array(points)


def _solve_all(problems: Sequence[_Problem]) -> None:
    for problem in problems:
        problem.solved()


def _minimised(optimize: object, problem: _Problem, random: np.random.Generator) -> float:
    """Return the least sum that SLSQP finds from a random start; unknowns are W in parts, in units of the limits."""
    limits_um = np.array(problem.limits_um)
    count = len(limits_um)

    def modal_um(parts: FloatArray) -> npt.NDArray[np.complex128]:
        phasors: npt.NDArray[np.complex128] = (parts[:count] + 1j * parts[count:]) * limits_um
        return phasors

    inside = {"type": "ineq", "fun": lambda parts: 1.0 - parts[:count] ** 2 - parts[count:] ** 2}
    found = optimize.minimize(  # type: ignore[attr-defined]
        lambda parts: problem.felt(modal_um(parts)),
        random.uniform(-0.5, 0.5, 2 * count),
        method="SLSQP",
        constraints=[inside],
        options={"maxiter": 200},
    )
    return float(found.fun)


def frontier(modes: int = 4, *, seeds: Sequence[int] = (1, 2, 3, 4, 5), every_s: float = 0.02) -> Table:
    """Compare what perfect knowledge reaches on strokes with other importances of the still contact, without any delay:
    the contact rule's own descent from rest at each instant, on the true shapes of the fingertip plate."""
    plate = GroundTruth(PlateSettings.of(FINGERTIP, modes))
    touched = [_stroked(plate, seed, every_s) for seed in seeds]
    rows = []
    for importance in IMPORTANCES:
        figures = []
        for slipping, still in touched:
            w_um = settle(slipping, [still], 1.0, np.array(plate.w_limit_um), still_importance=importance)
            slip_um, still_um = contact_rms_um(slipping, w_um), contact_rms_um(still, w_um)
            slip_rms_um, still_rms_um = rms(slip_um), rms(still_um)
            figures.append((slip_rms_um, slip_rms_um / still_rms_um, float(np.median(slip_um / still_um))))
        mean = np.mean(figures, axis=0).tolist()
        names = ("contact_slip_um", "contrast", "contrast_median")
        rows.append((f"importance {importance:.2g}", dict(zip(names, mean, strict=True))))
    return Table(
        name="contacts_frontier",
        title=f"contacts: perfect knowledge on strokes at 10 cm/s, {modes} modes of the fingertip plate",
        default=rows[IMPORTANCES.index(STILL_IMPORTANCE)][0],
        rows=finite_rows(rows),
        compared=("contact_slip_um", "contrast"),
    )


def _stroked(plate: GroundTruth, seed: int, every_s: float) -> tuple[FloatArray, FloatArray]:
    """Return the Gram matrices (M, M, P) of the slipping and the still contact while both count."""
    actors = SCENARIOS["strokes"].build(seed, SPEED_MM_S)
    t_s = np.arange(0.0, SCENARIOS["strokes"].seconds, every_s)
    target_um = np.stack([actor.target_um(t_s) for actor in actors], axis=1)
    counts = settled(t_s, target_um).all(axis=1)
    modes = plate.true_mode_map()
    order = np.argsort(-target_um[counts][-1])
    paths = [actors[index].path for index in order]
    slipping, still = (grams(modes, path.position_mm(t_s[counts]), CONTACT_RADIUS_MM) for path in paths if path)
    return slipping, still


def walk(steps: int) -> Table:
    """Two contacts walk a closed way lap after lap, on two to eight modes; `steps` calls in all."""
    rows = [(f"{modes} modes", _walked(modes, steps // len(WALKING_MODES))) for modes in WALKING_MODES]
    return Table(
        name="contacts_walk",
        title=f"stability: contacts of {CONTACT_RADIUS_MM:g} mm along a closed way, one slipping, one still",
        default=f"{WALKING_MODES[0]} modes",
        rows=finite_rows(rows),
        compared=(),
        notes=(
            "drift: greatest difference of what a contact gets between the second lap and the last, of two optima that",
            "are equally good; jump: greatest change of a mode in a call, which is 0.2 mm of way",
            f"beyond: by how much a mode exceeds its {WALKING_LIMIT_UM:g} um",
        ),
    )


def _walked(modes: int, steps: int) -> dict[str, float]:
    track = _walk_grams(modes)
    limits_um, laps = (WALKING_LIMIT_UM,) * modes, max(steps // LAP, 3)
    d_um, q_um = [0.0] * modes, [0.0] * modes
    felt_um = np.empty((3, LAP, 2))  # by the contacts, in the first lap, the second, the last
    jump_um = largest_um = 0.0
    with no_garbage_collection():
        t_start_ns = time.perf_counter_ns()
        for lap in range(laps):
            row = felt_um[min(lap, 2)]
            for index, grams in enumerate(track):
                before = d_um.copy(), q_um.copy()
                row[index], _ = solve_contacts(grams, (1.0, 0.0), limits_um, d_um, q_um)
                largest_um = max(largest_um, max(map(math.hypot, d_um, q_um)))
                if lap > 0:
                    jump_um = max(jump_um, *map(abs, map(sub, d_um, before[0])), *map(abs, map(sub, q_um, before[1])))
        took_us = (time.perf_counter_ns() - t_start_ns) * 1e-3
    return {
        "steps_count": laps * LAP,
        "time_us": took_us / (laps * LAP),
        "drift_um": float(np.abs(felt_um[2] - felt_um[1]).max()),
        "jump_um": jump_um,
        "beyond_um": max(largest_um - WALKING_LIMIT_UM, 0.0),
    }


def _walk_grams(modes: int) -> list[list[Gram]]:
    """Return both contacts' Gram matrices along the way, of the plate's true shapes."""
    points = np.array(disc_points(CONTACT_RADIUS_MM))
    plate = GroundTruth(PlateSettings.of(FINGERTIP, WALKING_MODES[-1] - LEAST_PARASITIC))
    shapes = plate.shapes(closed_way_mm()[:, :, None] + points[:, :2])[..., :modes]
    grams: list[list[Gram]] = np.einsum("q,snqk,snql->snkl", points[:, 2], shapes, shapes).tolist()
    return grams
