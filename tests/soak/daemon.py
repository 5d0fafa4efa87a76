"""Soak of the daemon: an hour of virtual time with a fault every two seconds.

Runs of 30 s, each a new daemon and a new board in this one process: two fingers circle, one slippery and one sticky,
while faults of all kinds follow each other at random instants and for random times. Checked are every frame to the
board, the true plate at every control tick, the detection of and the recovery from each fault, and the memory, files
and threads of this process.

With `is_calibrating` it is one run of hours of a daemon that calibrates itself: two fingers stroke all over the plate
of a random laboratory, whose modes drift, with a fault every 10 s. What is found adds up over the whole run; it is
checked in spans of 150 s, after which the history is dropped. In addition it shows how far a reference moves within a
tick while something is adopted and else, and what the still finger gets.

Not covered: simultaneous faults, wear within one daemon beyond 30 s, the event loop, sockets and the kernel
(`tests/integration` and `tests/io` cover those).
"""

from __future__ import annotations

import ctypes
import gc
import logging
import os
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from calibrating import CalibratingSimulation
from faulty_simulation import FaultySimulation
from soak.faults import KINDS, Kind, ReferenceMeter, Watch
from soak.harness import ALL, Findings, added, judged

from hapticd.bench import touching
from hapticd.bench.tables import Table
from hapticd.config.sections import Config, TrackpadConfig
from hapticd.sim.fingers.paths import CirclePath, Path, Touch
from hapticd.sim.fingers.scenarios import SLIPPERY_UM, STICKY_UM, Actor
from hapticd.sim.fingers.strokes import strokes_pair
from hapticd.sim.lockstep import T_START_NS
from hapticd.sim.score import rms
from hapticd.sim.settings import Settings, in_world
from hapticd.sim.world import WorldRecording
from hapticd.sim.world_tolerances import draw
from hapticd.tools.progress import Progress
from hapticd.values import FloatArray

log = logging.getLogger("hapticd")

Bools = npt.NDArray[np.bool_]

RUN_S, SPAN_S, PAUSE_S = 30.0, 150.0, 8.0  # the pause is between two faults of a daemon that calibrates itself
LIFTED_S, AT_REST_S = 1.2, 0.8  # before the end of a run
FIRST_FAULT_S, RECOVERY_S = 1.5, 0.9  # a board with a wrapped clock is detected after half a second
WARM_AFTER_RUNS = 24  # the simulation's caches are full by then: they keep 16 plates
MEMORY_GROWTH_FRAC = 0.01
QUIET_UM, DRIVEN_UM = 0.01, 0.3
ADOPTED_TICKS = 60  # 30 ms: a step counts with the next report, and in the frame after it
CALM_S = 0.1  # before a fault, and after the recovery from it
STEP_FACTOR = 1.1  # of the largest step elsewhere
LEAK_EVERY_TICKS = 20
_STILL = 1  # the finger


class Fault(NamedTuple):
    """One fault; instants in seconds of the run."""

    kind: Kind
    t_from_s: float
    t_until_s: float


def run(hours: float = 1.0, *, seed: int = 1, is_calibrating: bool = False) -> Table:
    """Run the soak. Raises HapticdError with all violations if there are any."""
    notes: tuple[str, ...] = ("every fault was detected, and the fingers were driven again after it",)
    if is_calibrating:
        notes += ("leak: of the still finger far from faults, RMS over 150 s, at first, at last and at most",)
    log.setLevel(logging.ERROR)  # two thousand faults would fill the log
    try:
        found = _calibrating(hours, seed) if is_calibrating else _many(hours, seed)
        return judged(found, name="soak", title="daemon amid faults, in virtual time", notes=notes)
    finally:
        log.setLevel(logging.NOTSET)


def _calibrating(hours: float, seed: int) -> Iterator[Findings]:
    with Progress("soak") as progress:
        yield play_calibrating(seed, SPAN_S * max(1, round(hours * 3600.0 / SPAN_S)), progress)


def _many(hours: float, seed: int) -> Iterator[Findings]:
    """Play the runs; what the process holds after the first ones may not grow."""
    runs = max(1, round(hours * 3600.0 / RUN_S))
    before = _resources()
    for number in range(1, runs + 1):
        yield play(seed * 1_000_000 + number)
        if number == min(WARM_AFTER_RUNS, runs):
            before = _resources()
    after = _resources()
    memory = {"memory_first_mb": before["memory"], "memory_last_mb": after["memory"]}
    yield Findings({ALL: memory}, grown(before, after))


def play(seed: int) -> Findings:
    """Play one run of two circling fingers and check it."""
    circles = CirclePath((-25.0, 5.0), 15.0, 100.0), CirclePath((25.0, -5.0), 15.0, -100.0, start_rad=1.0)
    simulation = FaultySimulation(_actors(circles, RUN_S), Settings(), seed)
    return _Spans(simulation, seed, RUN_S).played()


def play_calibrating(seed: int, run_s: float, progress: Callable[[float], None] = lambda _: None) -> Findings:
    """Play one run in a laboratory and check it, span by span."""
    config = Config(trackpad=TrackpadConfig(correct_while_touched=True))
    settings = in_world(Settings(config=config), draw("laboratory", seed))
    actors = _actors(strokes_pair(seed), run_s)
    simulation = CalibratingSimulation(actors, settings, seed, touching.measured(settings, seed))
    found = _CalibratingSpans(simulation, seed, run_s, SPAN_S, PAUSE_S).played(progress)
    step_um, usual_um = (found.rows[ALL][name] for name in ("peak_adopting_step_um", "peak_step_um"))
    if step_um > STEP_FACTOR * usual_um:
        found.failures.append(f"A reference moved by {step_um:g} um a tick while adopting, else by {usual_um:g}.")
    return found


def _actors(paths: tuple[Path, Path], run_s: float) -> tuple[Actor, ...]:
    return tuple(
        Actor(((0.0, amplitude_um),), path=Touch(path, 0.1, run_s - LIFTED_S))
        for path, amplitude_um in zip(paths, (SLIPPERY_UM, STICKY_UM), strict=True)
    )


class _Spans:
    """A run in spans: draws each one's faults at its beginning and checks it at its end."""

    def __init__(
        self, simulation: FaultySimulation, seed: int, run_s: float, span_s: float | None = None, pause_s: float = 0.0
    ) -> None:
        self._simulation, self._where = simulation, f"run {seed}"
        self._run_s, self._span_s, self._pause_s = run_s, run_s if span_s is None else span_s, pause_s
        self._rng = np.random.default_rng(seed)
        self._watch = Watch(simulation)
        self._found: list[Findings] = []

    def played(self, progress: Callable[[float], None] = lambda _: None) -> Findings:
        """Play the run and return what all spans show."""
        self._begin(0.0)

        def advanced(share: float) -> None:  # called at least every 10 ms of the run
            t_s = share * self._run_s
            if self._t_begin_s + self._span_s <= t_s < self._run_s:
                self._end(t_s)
                self._simulation.forget()
                self._begin(t_s)
            progress(share)

        self._simulation.run(self._run_s, advanced)
        self._end(self._run_s)
        t_s, level_um = self._simulation.level_um()
        if level_um[t_s > self._run_s - AT_REST_S].max() > QUIET_UM or self._simulation.machine.pipeline.fingers:
            sentence = f"{self._where}: motion or fingers remain after both fingers were lifted."
            self._found.append(Findings({}, [sentence]))
        return added(self._found)

    def _begin(self, t_s: float) -> None:
        self._t_begin_s = t_s
        t_until_s = min(t_s + self._span_s, self._run_s - LIFTED_S)
        self._faults = list(drawn(self._rng, t_s, t_until_s, self._pause_s))
        self._watch.references, self._watch.undetected = ReferenceMeter(), []
        for fault in self._faults:
            self._watch.expect(fault.kind, fault.t_from_s, fault.t_until_s, RECOVERY_S, self._rng)

    def _end(self, t_s: float) -> None:
        """Note what references and plate reached, and each fault's effect."""
        times_s, level_um = self._simulation.level_um()
        references = self._watch.references
        peaks_um = {"reference": references.peak_um, "plate": float(level_um.max())}
        limit_um = max(self._simulation.settings.config.limits.w_limit_um)
        self._found += [self._check_fault(fault, times_s, level_um) for fault in self._faults]
        figures = {
            "virtual_h": (t_s - self._t_begin_s) / 3600.0,
            "faults_count": float(len(self._faults)),
            "frames_count": float(references.frames),
            **{f"peak_{name}_um": peak_um for name, peak_um in peaks_um.items()},
        }
        failures = [
            f"{self._where}: a peak of the {name} was {peak_um:g} um, the limit is {limit_um:g}."
            for name, peak_um in peaks_um.items()
            if peak_um > limit_um
        ]
        failures += [f"{self._where}, {sentence}" for sentence in self._watch.undetected]
        self._found.append(Findings({ALL: figures}, failures))

    def _check_fault(self, fault: Fault, t_s: FloatArray, level_um: FloatArray) -> Findings:
        """Check one fault; a link that jitters delivers the last frame that much later."""
        name, quiet_within_ms = fault.kind.name, fault.kind.quiet_within_ms
        which = f"{self._where}, {name} from {fault.t_from_s:.3f} to {fault.t_until_s:.3f} s"
        figures, failures = {"faults_count": 1.0}, []
        if quiet_within_ms is not None:
            moving = t_s[(t_s > fault.t_from_s) & (t_s < fault.t_until_s) & (level_um > QUIET_UM)]
            quiet_ms = 1e3 * (float(moving[-1]) - fault.t_from_s) if len(moving) else 0.0
            figures["quiet_after_ms"] = quiet_ms
            if quiet_ms > quiet_within_ms + self._simulation.settings.plate.world.link_jitter_ms:
                failures.append(f"{which}: the plate still moved after {quiet_ms:.0f} ms.")
        end_s = fault.t_until_s + RECOVERY_S
        if level_um[(t_s > end_s - 0.25) & (t_s <= end_s)].max() < DRIVEN_UM:
            failures.append(f"{which}: the fingers are not driven again.")
        return Findings({name: figures}, failures)


class _CalibratingSpans(_Spans):
    """The same of a daemon that calibrates itself."""

    _simulation: CalibratingSimulation

    def _end(self, t_s: float) -> None:
        super()._end(t_s)
        recording = self._simulation.world.recording()
        is_calm = self._calm(recording.t_s)
        leak_um = self._leak_um(recording, is_calm)
        figures = self._steps(recording, is_calm) | dict.fromkeys(
            ("leak_first_um", "leak_last_um", "leak_most_um"), leak_um
        )
        report = self._simulation.calibrations[0].task.report()
        counts = {"verdicts": "verdicts", "pads": "adopted", "maps": "maps"}
        figures |= {f"{name}_last_count": float(str(report[key])) for name, key in counts.items()}
        self._found.append(Findings({ALL: figures}))

    def _steps(self, recording: WorldRecording, is_calm: Bools) -> dict[str, float]:
        """Return how far a reference moves within a tick far from faults, while something is adopted and else."""
        (calibration,) = self._simulation.calibrations
        t_s, steps_um = recording.t_s[1:], np.abs(np.diff(recording.reference_um, axis=0)).max(axis=1)
        stepped_s = (np.array(calibration.t_stepped_ns) - T_START_NS) * 1e-9
        calibration.t_stepped_ns.clear()
        is_adopting = np.histogram(stepped_s, np.append(t_s, np.inf))[0] > 0
        after = np.convolve(is_adopting, np.ones(ADOPTED_TICKS))[: len(t_s)] > 0
        return {
            "peak_step_um": float(steps_um[is_calm[1:] & ~after].max(initial=0.0)),
            "peak_adopting_step_um": float(steps_um[is_calm[1:] & after].max(initial=0.0)),
        }

    def _leak_um(self, recording: WorldRecording, is_calm: Bools) -> float:
        """Return what the still finger gets, RMS."""
        chosen = np.flatnonzero(is_calm)[::LEAK_EVERY_TICKS]
        shapes = self._simulation.world.plate.shapes(recording.finger_mm[chosen, _STILL])
        return rms((shapes * recording.plate_um[chosen]).sum(axis=1))

    def _calm(self, t_s: FloatArray) -> Bools:
        """Return which instants (T,) are far from the start and the end of the run, and from faults."""
        is_calm = (t_s > FIRST_FAULT_S / 2.0) & (t_s < self._run_s - LIFTED_S)
        for fault in self._faults:
            is_calm &= (t_s < fault.t_from_s - CALM_S) | (t_s > fault.t_until_s + RECOVERY_S + CALM_S)
        return is_calm


def drawn(rng: np.random.Generator, t_from_s: float, t_until_s: float, pause_s: float = 0.0) -> Iterator[Fault]:
    """Draw faults one after another; each kind once per round, in random order."""
    t_s = t_from_s + FIRST_FAULT_S
    while True:
        for index in rng.permutation(len(KINDS)):
            kind = KINDS[index]
            start_s = t_s + float(rng.uniform(0.0, 0.05))
            end_s = start_s + float(rng.uniform(*kind.lasts_s))
            t_s = end_s + RECOVERY_S + pause_s
            if end_s + RECOVERY_S > t_until_s:
                return
            yield Fault(kind, start_s, end_s)


def _resources() -> dict[str, float]:
    """Memory in MB, open files and threads of this process; free memory of the allocator is returned first."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
    with open("/proc/self/status", encoding="ascii") as file:
        status = dict(line.split(":", 1) for line in file)
    return {
        "memory": int(status["VmRSS"].split()[0]) / 1024.0,
        "files": float(len(os.listdir("/proc/self/fd"))),
        "threads": float(status["Threads"]),
    }


def grown(before: dict[str, float], after: dict[str, float]) -> list[str]:
    """Return a sentence per resource that grew: memory may by 1 %, the others not at all."""
    allowed = {"memory": MEMORY_GROWTH_FRAC * before["memory"], "files": 0.0, "threads": 0.0}
    names = [name for name in allowed if after[name] - before[name] > allowed[name]]
    return [f"{name} grew from {before[name]:g} to {after[name]:g}." for name in names]
