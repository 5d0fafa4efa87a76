"""Soak of a daemon that calibrates itself, `hapticd bench soak --calibrating`: one run of hours amid faults and drift.

Two fingers stroke all over the plate of a random laboratory, whose modes drift, with a fault every 10 s. What is found
adds up over the whole run; it is checked in spans of 150 s, after which the history is dropped. In addition to the
checks of each soak: how far a reference moves within a tick while something is adopted and else, and what the still
finger gets.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..config.sections import Config, TrackpadConfig
from ..sim.fingers.paths import Touch
from ..sim.fingers.scenarios import SLIPPERY_UM, STICKY_UM, Actor
from ..sim.fingers.strokes import strokes_pair
from ..sim.lockstep import T_START_NS, Settings, in_world
from ..sim.score import rms
from ..sim.world import Recording
from ..sim.world_tolerances import draw
from . import touching
from .calibrating import CalibratingSimulation
from .soak_checks import FIRST_FAULT_S, RECOVERY_S, Fault, Findings, FloatArray, check, check_rest, drawn
from .soak_faults import ReferenceMeter, Watch

SPAN_S, PAUSE_S = 150.0, 8.0  # between two faults
LIFTED_S, AT_REST_S = 1.2, 0.8  # before the end
ADOPTED_TICKS = 60  # 30 ms: a step counts with the next report, and in the frame after it
CALM_S = 0.1  # before a fault, and after the recovery from it
STEP_FACTOR = 1.1  # of the largest step elsewhere
LEAK_EVERY_TICKS = 20
_STILL = 1  # the finger


def play(findings: Findings, seed: int, hours: float, progress: Callable[[float], None] = lambda _: None) -> None:
    """Play one run and check it; at least one span."""
    run_s = SPAN_S * max(1, round(hours * 3600.0 / SPAN_S))
    paths = strokes_pair(seed)
    actors = tuple(
        Actor(((0.0, amplitude_um),), path=Touch(path, 0.1, run_s - LIFTED_S))
        for path, amplitude_um in zip(paths, (SLIPPERY_UM, STICKY_UM), strict=True)
    )
    config = Config(trackpad=TrackpadConfig(correct_while_touched=True))
    settings = in_world(Settings(config=config), draw("laboratory", seed))
    simulation = CalibratingSimulation(actors, settings, seed, touching.measured(settings, seed))
    spans = _Spans(findings, simulation, run_s, seed)

    def advanced(share: float) -> None:
        spans.advance(share * run_s)
        progress(share)

    simulation.run(run_s, advanced)
    spans.end(run_s)
    check_rest(findings, simulation, simulation.level_um(), run_s - AT_REST_S, f"run {seed}")
    if findings.peak_adopting_step_um > STEP_FACTOR * findings.peak_step_um:
        step_um, usual_um = findings.peak_adopting_step_um, findings.peak_step_um
        findings.failures.append(f"A reference moved by {step_um:g} um a tick while adopting, else by {usual_um:g}.")


class _Spans:
    """The run in spans: draws each one's faults at its beginning and checks it at its end."""

    def __init__(self, findings: Findings, simulation: CalibratingSimulation, run_s: float, seed: int) -> None:
        self._findings, self._simulation, self._run_s = findings, simulation, run_s
        self._where = f"run {seed}"
        self._rng = np.random.default_rng(seed)
        self._watch = Watch(simulation)
        self._begin(0.0)

    def advance(self, t_s: float) -> None:
        """Take note of the time; called at least every 10 ms of the run."""
        if t_s >= self._t_begin_s + SPAN_S:
            self.end(t_s)
            self._begin(t_s)

    def _begin(self, t_s: float) -> None:
        self._t_begin_s = t_s
        t_until_s = min(t_s + SPAN_S, self._run_s - LIFTED_S)
        self._faults = list(drawn(self._rng, t_s, t_until_s, PAUSE_S))
        self._watch.references, self._watch.undetected = ReferenceMeter(), []
        for fault in self._faults:
            self._watch.expect(fault.kind, fault.t_from_s, fault.t_until_s, RECOVERY_S, self._rng)

    def end(self, t_s: float) -> None:
        """Check the span that ends."""
        findings, simulation = self._findings, self._simulation
        findings.virtual_s = t_s
        check(findings, simulation, self._watch, self._faults, simulation.level_um(), self._where)
        recording = simulation.world.recording()
        is_calm = _is_calm(recording.t_s, self._faults, self._run_s - LIFTED_S)
        self._check_steps(recording, is_calm)
        findings.leaks_um.append(self._leak_um(recording, is_calm))
        simulation.forget()

    def _check_steps(self, recording: Recording, is_calm: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> None:
        """Note how far a reference moves within a tick far from faults, while something is adopted and else."""
        findings, (calibration,) = self._findings, self._simulation.calibrations
        t_s, steps_um = recording.t_s[1:], np.abs(np.diff(recording.reference_um, axis=0)).max(axis=1)
        stepped_s = (np.array(calibration.t_stepped_ns) - T_START_NS) * 1e-9
        calibration.t_stepped_ns.clear()
        is_adopting = np.histogram(stepped_s, np.append(t_s, np.inf))[0] > 0
        report = calibration.task.report()
        findings.adopted["pads"], findings.adopted["maps"] = int(str(report["adopted"])), int(str(report["maps"]))
        findings.adopted["verdicts"] = int(str(report["verdicts"]))
        after = np.convolve(is_adopting, np.ones(ADOPTED_TICKS))[: len(t_s)] > 0
        for chosen, name in ((is_calm[1:] & after, "peak_adopting_step_um"), (is_calm[1:] & ~after, "peak_step_um")):
            setattr(findings, name, max(getattr(findings, name), float(steps_um[chosen].max(initial=0.0))))

    def _leak_um(self, recording: Recording, is_calm: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> float:
        """Return what the still finger gets, RMS."""
        chosen = np.flatnonzero(is_calm)[::LEAK_EVERY_TICKS]
        shapes = self._simulation.world.plate.shapes(recording.finger_mm[chosen, _STILL])
        return rms((shapes * recording.plate_um[chosen]).sum(axis=1))


def _is_calm(t_s: FloatArray, faults: list[Fault], t_until_s: float) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which instants (T,) are far from the start and the end of the run, and from faults."""
    is_calm = (t_s > FIRST_FAULT_S / 2.0) & (t_s < t_until_s)
    for fault in faults:
        is_calm &= (t_s < fault.t_from_s - CALM_S) | (t_s > fault.t_until_s + RECOVERY_S + CALM_S)
    return is_calm
