"""What still fingers feel over their whole contact: lock-step strokes with the finger taken as a point and as a disc.

The truth is a disc of 5 mm that feels the RMS of what the plate does over it; `leak_um` is what its centre feels. The
plate, its fingers' friction included, is the same for all rows: only what the solver makes least differs. Neighbouring
modes are unknown to all rows, for a disc has no zero to bring them back to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ..sim.lockstep import Run, Settings, Simulation
from ..sim.scenarios import SCENARIOS
from ..sim.score import settled
from .leak import SCENARIO, swapped
from .tables import Table, finite_rows

DEFAULT = "a point"
RADIUS_MM = 5.0
_RINGS_MM = RADIUS_MM * np.sqrt((np.arange(4) + 0.5) / 4)  # equal areas
_EVERY = 8  # ticks: a finger moves 0.4 mm


def run(*, seeds: Sequence[int] = (1, 2, 3), seconds: float = 10.0) -> Table:
    """Points beside discs of two radii, RMS over the seeds."""
    rows = []
    for name, radius_mm in ((DEFAULT, 0.0), ("a disc of 2.5 mm", RADIUS_MM / 2), ("a disc of 5 mm", RADIUS_MM)):
        settings = Settings(neighbours_known=False)
        config = swapped(settings.config, {"solver": {"contact_radius_mm": radius_mm}})
        settings = replace(settings, config=config)
        judged = [_figures(settings, seed, seconds) for seed in seeds]
        disc_um, point_um, share = np.array(judged).T
        figures = {
            "contact_leak_um": float(np.sqrt(np.mean(disc_um**2))),
            "leak_um": float(np.sqrt(np.mean(point_um**2))),
            "slip_frac": float(np.mean(share)),
        }
        rows.append((name, figures))
    return Table(
        name="leak_contact",
        title=f"leak: what the sticky finger feels over a contact of {RADIUS_MM:g} mm, {SCENARIO} at 10 cm/s",
        default=DEFAULT,
        rows=finite_rows(rows),
        compared=("contact_leak_um", "leak_um", "slip_frac"),
        error="contact_leak_um",
        notes=("rows: what the solver takes the still finger for (solver.contact_radius_mm)",),
    )


def _figures(settings: Settings, seed: int, seconds: float) -> tuple[float, float, float]:
    simulation = Simulation(SCENARIOS[SCENARIO].build(seed, settings.speed_mm_s), settings, seed)
    simulation.run(seconds)
    played = simulation.result(SCENARIO)
    return _contact_leak_um(simulation, played), played.score.leak_um, played.score.slip_frac


def _contact_leak_um(simulation: Simulation, played: Run) -> float:
    """RMS over time and contact, of all plate modes, at the fingers that should be still."""
    counts = settled(played.t_s, played.target_um) & (played.target_um == 0.0)
    plate_um = simulation.world.recording().plate_um
    squares = []
    for finger in range(counts.shape[1]):
        ticks = np.flatnonzero(counts[:, finger])[::_EVERY]
        points_mm = played.finger_true_mm[ticks, finger, None] + _disc_mm()
        w_um = np.einsum("tdp,tp->td", simulation.world.plate.shapes(points_mm), plate_um[ticks])
        squares.append(np.abs(w_um).ravel() ** 2)
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def _disc_mm() -> npt.NDArray[np.float64]:
    """Points (48, 2) spread evenly over the disc."""
    angle_rad = np.arange(12) * (np.pi / 6)
    x_mm, y_mm = np.outer(_RINGS_MM, np.cos(angle_rad)), np.outer(_RINGS_MM, np.sin(angle_rad))
    return np.stack((x_mm.ravel(), y_mm.ravel()), axis=1)
