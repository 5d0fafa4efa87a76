"""Friction as asked in the closed loop: faster strokes, contacts of another form than is believed, more fingers.

Nothing in the simulation moves by the size of a contact, so one run is scored for contacts of every form. The static
bound is what could be had at each instant alone: the best of some random starts of the rule's own iteration, carried on
until it is settled, at the true places and shapes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..core.friction import DEFAULT_FRICTION_CURVE
from ..core.solver.felt import STAY_FRAC, counted_jnd, felt_points
from ..core.solver.felt_descent import contact_shapes, descend
from ..sim.fingers.scenarios import SPEED_MM_S
from ..sim.lockstep import Run, Settings
from ..sim.perfect import perfect
from ..sim.plate.glasses import FINGERTIP, WIDE
from ..sim.plate.ground_truth import GroundTruth, PlateSettings
from ..sim.score import CONTACT_RADIUS_MM, disc, ellipse, felt, with_contacts
from ..values import WEBER_FRAC
from .leak_runs import SCENARIO, SECONDS, SEEDS, Alternative, Figures, FinishedRun, compared
from .tables import Table, finite_rows

Floats = npt.NDArray[np.float64]

SPEEDS_MM_S = (SPEED_MM_S, 200.0, 400.0)
RADII_MM = (4.0, 6.0, 7.0)  # of discs where CONTACT_RADIUS_MM is believed
AXES_MM = (11.0, 8.0)  # of ellipses
TURNS_RAD = (0.0, np.pi / 3.0, 2.0 * np.pi / 3.0)
MORE_FINGERS = ("one-of-three", "two-of-three", "two-of-four", "two-of-five")
PLATES = ((FINGERTIP, 4), (FINGERTIP, 5), (FINGERTIP, 6), (WIDE, 8))  # and their modes
STARTS, ITERATIONS = 12, 300  # of the static bound
EVERY_TICKS = 200  # instants of the static bound


def conditions(*, modes: int = 4, seeds: Sequence[int] = SEEDS, seconds: float = SECONDS) -> Table:
    """Compare speeds, and contacts of other forms than is believed."""
    plate = PlateSettings.of(FINGERTIP, modes)
    speeds = {f"{speed / 10.0:g} cm/s": Alternative(Settings(plate=plate, speed_mm_s=speed)) for speed in SPEEDS_MM_S}
    forms: dict[str, list[Figures]] = {}

    def judge(finished: FinishedRun) -> Figures:
        if finished.run.settings.speed_mm_s == SPEED_MM_S:
            for name, felt_frac in _by_form(finished.run).items():
                forms.setdefault(name, []).append({"felt_frac": felt_frac})
        return {"felt_frac": finished.run.score.felt_frac, "perfect_frac": perfect(finished.run).score.felt_frac}

    rows = compared(speeds, judge, seeds=seeds, seconds=seconds, scenario=SCENARIO, timed=False)
    means = [(name, {"felt_frac": float(np.mean([one["felt_frac"] for one in got]))}) for name, got in forms.items()]
    return Table(
        name=f"felt_conditions_{modes}",
        title=f"felt: {SCENARIO} on the {FINGERTIP} plate, {modes} modes, in harder conditions",
        default=rows[0][0],
        rows=finite_rows([*rows, *means]),
        compared=("felt_frac",),
        notes=(
            f"of other forms: the contacts are such, and discs of {CONTACT_RADIUS_MM:g} mm are believed, at 10 cm/s",
            "perfect: with perfect knowledge of places and plate",
        ),
    )


def _by_form(run: Run) -> dict[str, float]:
    contacts = {f"discs of {radius_mm:g} mm": [disc(radius_mm)] for radius_mm in RADII_MM}
    major_mm, minor_mm = (axis_mm / 2.0 for axis_mm in AXES_MM)
    contacts[f"ellipses of {AXES_MM[1]:g} x {AXES_MM[0]:g} mm"] = [
        ellipse(major_mm, minor_mm, turn_rad) for turn_rad in TURNS_RAD
    ]
    shapes = GroundTruth(run.settings.plate).shapes
    scored = (run.score, run.t_s, run.finger_true_mm, run.target_um, run.plate_um, shapes)
    return {
        name: float(np.mean([with_contacts(*scored, contact=contact).felt_frac for contact in turned]))
        for name, turned in contacts.items()
    }


def fingers(
    *,
    names: Sequence[str] = MORE_FINGERS,
    plates: Sequence[tuple[str, int]] = PLATES,
    seeds: Sequence[int] = SEEDS,
    seconds: float = SECONDS,
) -> Table:
    """Compare mixed targets of three to five fingers with what could be had."""
    settings = {
        f"{plate} plate, {modes} modes": Settings(plate=PlateSettings.of(plate, modes)) for plate, modes in plates
    }
    rows: list[tuple[str, Figures]] = []
    for name in names:
        found = compared(
            {plate: Alternative(one) for plate, one in settings.items()},
            lambda finished: {
                "felt_frac": finished.run.score.felt_frac,
                "perfect_frac": perfect(finished.run).score.felt_frac,
                "bound_frac": static_bound(finished.run),
            },
            seeds=seeds,
            seconds=seconds,
            scenario=name,
            timed=False,
        )
        rows += [(f"{name}, {plate}", figures) for plate, figures in found]
    return Table(
        name="felt_fingers",
        title="felt: more fingers on circles at 10 cm/s, 1 um or 0 asked",
        default=rows[0][0],
        rows=finite_rows(rows),
        compared=("felt_frac",),
        notes=(
            "felt: share of time in which all fingers' friction is as asked; perfect: with perfect knowledge, in time",
            f"bound: at each instant alone, the best of {STARTS} random starts",
        ),
    )


def static_bound(run: Run) -> float:
    """Return the share of instants at which all fingers could feel what is asked."""
    plate = GroundTruth(run.settings.plate)
    modes, limits_um = plate.true_mode_map(), plate.w_limit_um
    counts = np.isfinite(run.target_um).all(axis=1) & np.isfinite(run.finger_true_mm).all(axis=(1, 2))
    instants = np.flatnonzero(counts)[::EVERY_TICKS]
    points, curve = felt_points(), DEFAULT_FRICTION_CURVE
    weights, count = [weight for _, _, weight in points], run.target_um.shape[1]
    random = np.random.default_rng(run.seed)
    could = 0
    for index in instants.tolist():
        contacts = [
            (x_mm, y_mm, CONTACT_RADIUS_MM, 0.0, CONTACT_RADIUS_MM) for x_mm, y_mm in run.finger_true_mm[index].tolist()
        ]
        shapes = contact_shapes(modes, points, contacts)
        asked = [curve.friction(target_um) for target_um in run.target_um[index].tolist()]
        found_um = np.zeros((STARTS, len(plate.decay_1_s)), np.complex128)
        for start in range(STARTS):
            d_um, q_um = (random.uniform(-0.5, 0.5, (2, modes.M)) * limits_um).tolist()
            descend(
                shapes,
                weights,
                asked,
                counted_jnd(asked, [0] * count),
                [1.0] * count,
                curve.pieces,
                (curve.full_um, curve.floor_frac),
                limits_um,
                d_um,
                q_um,
                [0.0] * count,
                ITERATIONS,
                STAY_FRAC,
            )
            found_um[start, : modes.M] = np.array(d_um) + 1j * np.array(q_um)
        places_mm = np.repeat(run.finger_true_mm[index : index + 1], STARTS, axis=0)
        _, got = felt(places_mm, found_um, plate.shapes)
        could += bool((np.abs(got / asked - 1.0) <= WEBER_FRAC).all(axis=1).any())
    return could / len(instants)
