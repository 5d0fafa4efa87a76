"""What fingers feel of each choice: lock-step strokes with one choice swapped at a time, beside what a pass costs.

The same trajectories, noise and plate for all; the firmware's C and the plate's true motion in the loop. A pass's time
is that of the whole way from report to frame, without the board.

    run        a sticky and a slippery finger: every choice on a touch's way, the paper's scheme, perfect knowledge
    both_slip  two slippery fingers: turning the phase between them, beside changing signs
    contact    the sticky finger as a disc that feels the RMS of what the plate does over it, taken for a point or disc
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..sim.lockstep import Settings, paper, perfect
from ..sim.score import settled
from .leak_runs import (
    DEFAULT,
    NOTHING_UM,
    SCENARIO,
    SECONDS,
    SEEDS,
    Figures,
    Played,
    compared,
    over_seeds,
    scored,
    swapped,
)
from .tables import Table, finite_rows

PERFECT = "perfect knowledge"
PAPER = "the paper's scheme"
BOTH_SLIP = "both-slip"
SIGNS_ALONE = "signs alone"
POINT = "a point"
RADIUS_MM = 5.0
_DIP_FRAC = 0.5  # of its target: less than this is felt as a catch
_RINGS_MM = RADIUS_MM * np.sqrt((np.arange(4) + 0.5) / 4)  # equal areas
_EVERY = 8  # ticks: a finger moves 0.4 mm


def alternatives() -> dict[str, Settings]:
    """By name, the settings of a run: hapticd's, with a single choice swapped, and the paper's."""
    ours = Settings()
    swaps: dict[str, dict[str, Mapping[str, Any]]] = {
        DEFAULT: {},
        "predictor hold": {"prediction": {"name": "hold"}},
        "predictor linear": {"prediction": {"name": "linear"}},
        "predictor kalman_ca": {"prediction": {"name": "kalman_ca"}},
        "a single knot": {"solver": {"max_knots": 1}},
        "policy paper": {"solver": {"policy": "paper"}},
        "controller pi": {"device": {"controller": "pi"}},
        "no fade": {"solver": {"fade": 0.0}},
        "effort 0.008, no fade": {"solver": {"effort": 0.008, "fade": 0.0}},
        "effort 0.02, no fade": {"solver": {"effort": 0.02, "fade": 0.0}},
    }
    told = {name: replace(ours, config=swapped(ours.config, swap)) for name, swap in swaps.items()}
    return {**told, "neighbours unknown": replace(ours, parasitic_modes_known=False), PAPER: paper(ours)}


def run(*, seeds: Sequence[int] = SEEDS, seconds: float = SECONDS, names: Sequence[str] | None = None) -> Table:
    """Compare the alternatives (all, or those in `names` and the default) on strokes of each seed."""
    chosen = {name: settings for name, settings in alternatives().items() if names is None or name in (*names, DEFAULT)}
    known: list[Figures] = []

    def judge(played: Played) -> Figures:
        if played.name == DEFAULT:
            known.append(scored(perfect(played.run)))
        return scored(played.run.score)

    rows = [*compared(chosen, judge, seeds=seeds, seconds=seconds), (PERFECT, over_seeds(known))]
    return Table(
        name="leak",
        title=f"leak: {SCENARIO} at 10 cm/s, 0.05 mm of noise, seeds {', '.join(map(str, seeds))}; one choice swapped",
        default=DEFAULT,
        rows=finite_rows(rows),
        compared=("time_us", "leak_um", "slip_error_um"),
        time="time_us",
        error="leak_um",
        floor=NOTHING_UM,
        notes=(
            "leak: RMS at the finger that should be still; slip: mean share that the other gets of its 1 um",
            "time: a pass from report to frame",
        ),
    )


def both_slip(*, seeds: Sequence[int] = SEEDS, seconds: float = SECONDS) -> Table:
    """Two slippery fingers on strokes: turning the phase between them, beside changing signs and the paper's scheme."""
    ours = Settings()
    signs = replace(ours, config=swapped(ours.config, {"solver": {"phase_rotation": False}}))
    chosen = {DEFAULT: ours, SIGNS_ALONE: signs, PAPER: paper(ours)}
    return Table(
        name="both_slip",
        title=f"leak: {BOTH_SLIP} at 10 cm/s, 0.05 mm of noise, seeds {', '.join(map(str, seeds))}",
        default=DEFAULT,
        rows=finite_rows(compared(chosen, _smoothness, seeds=seeds, seconds=seconds, scenario=BOTH_SLIP)),
        compared=("time_us", "slip_error_um", "dip_frac"),
        time="time_us",
        error="slip_error_um",
        floor=NOTHING_UM,
        notes=(
            "dip: share of the time that a finger has less than half of its 1 um",
            "step: of 1000 control ticks the one by which the reference changes most",
        ),
    )


def contact(*, seeds: Sequence[int] = SEEDS, seconds: float = SECONDS) -> Table:
    """What the solver takes a still finger for: a point, or discs of two radii.

    Neighbouring modes are unknown to all rows, for a disc has no zero to bring them back to.
    """
    ours = Settings(parasitic_modes_known=False)
    chosen = {
        name: replace(ours, config=swapped(ours.config, {"solver": {"contact_radius_mm": radius_mm}}))
        for name, radius_mm in ((POINT, 0.0), ("a disc of 2.5 mm", RADIUS_MM / 2), ("a disc of 5 mm", RADIUS_MM))
    }
    return Table(
        name="leak_contact",
        title=f"leak: what the sticky finger feels over a contact of {RADIUS_MM:g} mm, {SCENARIO} at 10 cm/s",
        default=POINT,
        rows=finite_rows(compared(chosen, _over_contact, seeds=seeds, seconds=seconds, timed=False)),
        compared=("contact_leak_um", "leak_um", "slip_frac"),
        error="contact_leak_um",
        notes=("rows: what the solver takes the still finger for (solver.contact_radius_mm); leak: at its centre",),
    )


def _smoothness(played: Played) -> Figures:
    """How well slippery fingers are served, and how roughly the plate is asked to move."""
    run = played.run
    counts = settled(run.t_s, run.target_um)
    steps_um = np.abs(np.diff(run.reference_um, axis=0)).max(axis=1)
    return {
        "slip_error_um": run.score.slip_error_um,
        "slip_frac": run.score.slip_frac,
        "dip_frac": float(np.mean((np.abs(run.truth_um) < _DIP_FRAC * run.target_um)[counts])),
        "step_um": float(np.quantile(steps_um, 0.999)),
    }


def _over_contact(played: Played) -> Figures:
    """RMS over time and contact, of all plate modes, at the fingers that should be still."""
    run, world = played.run, played.simulation.world
    counts = settled(run.t_s, run.target_um) & (run.target_um == 0.0)
    plate_um = world.recording().plate_um
    squares = []
    for finger in range(counts.shape[1]):
        ticks = np.flatnonzero(counts[:, finger])[::_EVERY]
        points_mm = run.finger_true_mm[ticks, finger, None] + _disc_mm()
        w_um = np.einsum("tdp,tp->td", world.plate.shapes(points_mm), plate_um[ticks])
        squares.append(np.abs(w_um).ravel() ** 2)
    return {
        "contact_leak_um": float(np.sqrt(np.mean(np.concatenate(squares)))),
        "leak_um": run.score.leak_um,
        "slip_frac": run.score.slip_frac,
    }


def _disc_mm() -> npt.NDArray[np.float64]:
    """Points (48, 2) spread evenly over the disc."""
    angle_rad = np.arange(12) * (np.pi / 6)
    x_mm, y_mm = np.outer(_RINGS_MM, np.cos(angle_rad)), np.outer(_RINGS_MM, np.sin(angle_rad))
    return np.stack((x_mm.ravel(), y_mm.ravel()), axis=1)
