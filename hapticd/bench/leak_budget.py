"""Contributions to the leak: lock-step strokes with one part at a time made perfect.

    positions        each finger's predictor is replaced by its true path
    map              the measured mode map is replaced by the true shapes
    parasitic modes  the plate's undriven modes stay at rest; otherwise the friction of the fingers drives them
    loop             the driven modes follow the reference at once; always with parasitic modes at rest

The trajectories, noise and links stay the same. The rest, with all parts perfect, is the polyline's: its knots, and the
tolerance within which a reference stands.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from ..core.plate.mode_shapes import ModeShapes
from ..core.touch.fingers import Predictor
from ..sim.fingers.paths import Path, Touch
from ..sim.fingers.scenarios import SCENARIOS
from ..sim.lockstep import T_START_NS, Run, Settings, Simulation
from ..sim.plate.ground_truth import DRIVEN_MODES
from ..sim.score import rms, score, settled
from .leak_runs import DEFAULT, SCENARIO, use_predictor
from .tables import Table, finite_rows

_MAP_POINTS = 138  # a millimetre apart
_STEP_NS = 1_000_000  # of the difference that is the true velocity


class TruePath(Predictor):
    """A perfect predictor: the path nearest to its first sample."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths = paths
        self._path: Path | None = None

    def update(self, t_ns: int, t_stamp_ns: int, x_mm: float, y_mm: float, period_s: float) -> None:
        """Choose the path at the first sample."""
        del t_stamp_ns, period_s
        if self._path is None:
            self._path = min(self._paths, key=lambda path: math.dist(_at(path, t_ns), (x_mm, y_mm)))

    def predict(self, t_ns: int) -> tuple[float, float]:
        """True position at `t_ns`; NaN before the first sample."""
        return (math.nan, math.nan) if self._path is None else _at(self._path, t_ns)

    def velocity(self, t_ns: int) -> tuple[float, float]:
        """True velocity, mm/s."""
        (x0, y0), (x1, y1) = self.predict(t_ns - _STEP_NS), self.predict(t_ns + _STEP_NS)
        return (x1 - x0) / (2e-9 * _STEP_NS), (y1 - y0) / (2e-9 * _STEP_NS)


def run(*, seeds: Sequence[int] = (1, 2, 3, 4, 5), seconds: float = 10.0, settings: Settings | None = None) -> Table:
    """Return the leak of every set of perfect parts; RMS over the seeds."""
    settings = Settings() if settings is None else settings
    leaks_um: dict[str, list[float]] = {}
    errors_mm: dict[str, list[float]] = {}
    for seed, (true_path, true_map, still) in product(seeds, product((False, True), repeat=3)):
        # parasitic modes at rest must not be compensated either
        chosen = replace(settings, parasitic_modes_known=settings.parasitic_modes_known and not still)
        simulation = _simulation(chosen, seed, true_path=true_path, true_map=true_map)
        simulation.run(seconds)
        finished = simulation.result(SCENARIO)
        for true_loop, leak_um in _leaks_um(simulation, finished, still=still).items():
            name = _name({"positions": true_path, "map": true_map, "parasitic modes": still, "loop": true_loop})
            leaks_um.setdefault(name, []).append(leak_um)
            errors_mm.setdefault(name, []).append(_position_error_mm(finished))
    rows = [
        (name, {"leak_um": rms(leaks_um[name]), "position_error_mm": rms(errors_mm[name])})
        for name in sorted(leaks_um, key=lambda name: (name != DEFAULT, name.count("+"), name))
    ]
    return Table(
        name="leak_budget",
        title=f"leak: what limits it: {SCENARIO} at {settings.speed_mm_s / 10:g} cm/s, parts made perfect",
        default=DEFAULT,
        rows=finite_rows(rows),
        compared=("leak_um",),
        error="leak_um",
        notes=("position error: of the positions that the reference in force was solved for, RMS",),
    )


def _simulation(settings: Settings, seed: int, *, true_path: bool, true_map: bool) -> Simulation:
    simulation = Simulation(SCENARIOS[SCENARIO].build(seed, settings.speed_mm_s), settings, seed)
    if true_map:
        simulation.modes = _true_map(simulation)
        simulation.machine = simulation._new_machine()
    if true_path:
        paths = [actor.path.path if isinstance(actor.path, Touch) else actor.path for actor in simulation.actors]
        known = [path for path in paths if path is not None]
        use_predictor(simulation, lambda: TruePath(known))
    return simulation


def _true_map(simulation: Simulation) -> ModeShapes:
    edge_mm = np.linspace(-68.75, 68.75, _MAP_POINTS)
    points_mm = np.stack(np.meshgrid(edge_mm, edge_mm), axis=-1)
    shapes = simulation.world.plate.shapes(points_mm)[..., : len(DRIVEN_MODES)]
    return ModeShapes.from_grid(edge_mm, edge_mm, np.moveaxis(shapes, -1, 0))


def _leaks_um(simulation: Simulation, finished: Run, *, still: bool) -> dict[bool, float]:
    """Leak by whether the loop is perfect; without parasitic modes where they are `still`."""
    if not still:
        return {False: finished.score.leak_um}
    phi = simulation.world.plate.shapes(finished.finger_true_mm)[..., : finished.modal_um.shape[1]]
    leaks_um = {}
    for true_loop, modal_um in ((False, finished.modal_um), (True, finished.reference_um)):
        truth_um = np.einsum("tnm,tm->tn", phi, modal_um)
        judged = score(finished.t_s, finished.target_um, truth_um, finished.reference_um, finished.limited)
        leaks_um[true_loop] = judged.leak_um
    return leaks_um


def _position_error_mm(finished: Run) -> float:
    error_mm = np.linalg.norm(finished.finger_predicted_mm - finished.finger_true_mm, axis=-1)
    counts = settled(finished.t_s, finished.target_um) & np.isfinite(error_mm)
    return rms(error_mm[counts])


def _name(perfect: Mapping[str, bool]) -> str:
    parts = [part for part, is_perfect in perfect.items() if is_perfect]
    return f"true {' + '.join(parts)}" if parts else DEFAULT


def _at(path: Path, t_ns: int) -> tuple[float, float]:
    ((x_mm, y_mm),) = path.position_mm(np.array([(t_ns - T_START_NS) * 1e-9])).tolist()
    return x_mm, y_mm
