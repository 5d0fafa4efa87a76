"""Stability soak, `hapticd bench soak`: an hour of virtual time with a fault every two seconds.

Runs of 30 s, each a new daemon and a new board in this one process: two fingers circle, one slippery and one sticky,
while faults of all kinds follow each other at random instants and for random times. With `is_calibrating` runs of
150 s, each in another laboratory with its drift, whose daemon calibrates itself while it is touched, with a pause after
each fault. Checked are every frame to the board, the true plate at every control tick, the detection of and the
recovery from each fault, how far a reference moves within a tick while something is adopted, and the memory, files and
threads of this process.

Not covered: simultaneous faults, wear within one daemon beyond 30 s, the event loop, sockets and the kernel
(`tests/integration` and `tests/io` cover those).
"""

from __future__ import annotations

import ctypes
import gc
import logging
import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ..config.sections import Config, TrackpadConfig
from ..errors import HapticdError
from ..sim.faulty import FaultySimulation
from ..sim.fingers.paths import Circle, Touch
from ..sim.fingers.scenarios import Actor
from ..sim.lockstep import T_START_NS, Settings, in_world
from ..sim.world_tolerances import draw
from . import touching
from .calibrating import CalibratingSimulation
from .soak_faults import KINDS, Kind, Watch
from .tables import Row, Table

log = logging.getLogger("hapticd")

FloatArray = npt.NDArray[np.float64]

RUN_S = 30.0
CALIBRATING_RUN_S, PAUSE_S = 150.0, 8.0
FIRST_FAULT_S, RECOVERY_S = 1.5, 0.9  # a board with a wrapped clock is detected after half a second
LIFT_S, AT_REST_S = 28.8, 29.2
QUIET_UM, DRIVEN_UM = 0.01, 0.3
WARM_AFTER_RUNS = 24  # the simulation's caches are full by then: they keep 16 plates
MOST_HOURS = 24.0
ADOPTED_TICKS = 60  # 30 ms: a step counts with the next report, and in the frame after it
CALM_S = 0.1  # before a fault, and after the recovery from it
STEP_FACTOR = 1.1  # of the largest step elsewhere


@dataclass
class Findings:
    """Figures of the soak so far, and a sentence in `failures` for each violation."""

    virtual_s: float = 0.0
    frames: int = 0
    peak_reference_um: float = 0.0
    peak_plate_um: float = 0.0
    peak_step_um: float = 0.0  # of a reference from one control tick to the next, far from faults
    peak_adopting_step_um: float = 0.0  # the same while something is adopted
    adopted: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    latest_quiet_ms: dict[str, float] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Fault:
    """One fault; instants in seconds of the run."""

    kind: Kind
    t_from_s: float
    t_until_s: float


def run(hours: float = 1.0, *, seed: int = 1, is_calibrating: bool = False) -> tuple[Table, ...]:
    """Run the soak. Raises HapticdError with all violations if there are any."""
    if not 0.0 < hours <= MOST_HOURS:  # False for NaN
        raise HapticdError(f"--hours: {hours:g} is out of bounds, it must be above 0 and at most {MOST_HOURS:g}.")
    findings = Findings()
    runs = max(1, round(hours * 3600.0 / (CALIBRATING_RUN_S if is_calibrating else RUN_S)))
    log.setLevel(logging.ERROR)  # two thousand faults would fill the log
    before = after = _resources()
    for number in range(1, runs + 1):
        play(findings, seed * 1_000_000 + number, is_calibrating=is_calibrating)
        if number == min(WARM_AFTER_RUNS, runs):
            before = _resources()
    log.setLevel(logging.NOTSET)
    after = _resources()
    findings.failures += _grown(before, after)
    if findings.peak_adopting_step_um > STEP_FACTOR * findings.peak_step_um:
        step_um, usual_um = findings.peak_adopting_step_um, findings.peak_step_um
        findings.failures.append(f"A reference moved by {step_um:g} um a tick while adopting, else by {usual_um:g}.")
    if findings.failures:
        raise HapticdError(f"soak: {len(findings.failures)} failures:\n" + "\n".join(findings.failures))
    return (_table(findings, runs, before, after),)


def play(findings: Findings, seed: int, *, is_calibrating: bool = False) -> None:
    """Play one run and check it."""
    rng = np.random.default_rng(seed)
    run_s = CALIBRATING_RUN_S if is_calibrating else RUN_S
    lift_s = run_s - (RUN_S - LIFT_S)
    circles = [Circle((-25.0, 5.0), 15.0, 100.0), Circle((25.0, -5.0), 15.0, -100.0, start_rad=1.0)]
    actors = tuple(
        Actor(((0.0, amplitude_um),), path=Touch(circle, 0.1, lift_s))
        for circle, amplitude_um in zip(circles, (1.0, 0.0), strict=True)
    )
    simulation = _calibrating(actors, seed) if is_calibrating else FaultySimulation(actors, Settings(), seed)
    watch = Watch(simulation)
    faults = list(_drawn(rng, lift_s, PAUSE_S if is_calibrating else 0.0))
    for fault in faults:
        watch.expect(fault.kind, fault.t_from_s, fault.t_until_s, RECOVERY_S, rng)
    simulation.run(run_s)
    findings.virtual_s += run_s
    findings.frames += watch.references.frames
    findings.peak_reference_um = max(findings.peak_reference_um, watch.references.peak_um)
    _check(findings, simulation, watch, faults, run_s, f"run {seed}")
    if isinstance(simulation, CalibratingSimulation):
        _check_steps(findings, simulation, faults, lift_s)


def _calibrating(actors: tuple[Actor, ...], seed: int) -> CalibratingSimulation:
    """Return the same in a laboratory of its own."""
    config = Config(trackpad=TrackpadConfig(correct_while_touched=True))
    settings = in_world(Settings(config=config), draw("laboratory", seed))
    return CalibratingSimulation(actors, settings, seed, touching.measured(settings, seed))


def _drawn(rng: np.random.Generator, lift_s: float, pause_s: float = 0.0) -> Iterator[Fault]:
    """Draw faults one after another; each kind once per round, in random order."""
    t_s = FIRST_FAULT_S
    while True:
        for index in rng.permutation(len(KINDS)):
            kind = KINDS[index]
            t_from_s = t_s + float(rng.uniform(0.0, 0.05))
            t_until_s = t_from_s + float(rng.uniform(*kind.lasts_s))
            t_s = t_until_s + RECOVERY_S + pause_s
            if t_until_s + RECOVERY_S > lift_s:
                return
            yield Fault(kind, t_from_s, t_until_s)


def _check_steps(findings: Findings, simulation: CalibratingSimulation, faults: list[Fault], lift_s: float) -> None:
    """Note how far a reference moves within a tick far from faults, while something is adopted and else."""
    recording = simulation.world.recording()
    t_s, steps_um = recording.t_s[1:], np.abs(np.diff(recording.reference_um, axis=0)).max(axis=1)
    is_calm = (t_s > FIRST_FAULT_S / 2.0) & (t_s < lift_s)
    for fault in faults:
        is_calm &= (t_s < fault.t_from_s - CALM_S) | (t_s > fault.t_until_s + RECOVERY_S + CALM_S)
    is_adopting = np.zeros(len(t_s), dtype=bool)
    for calibration in simulation.calibrations:
        stepped_s = (np.array(calibration.t_stepped_ns) - T_START_NS) * 1e-9
        is_adopting |= np.histogram(stepped_s, np.append(t_s, np.inf))[0] > 0
        findings.adopted["pads"] += int(str(calibration.task.report()["adopted"]))
        findings.adopted["maps"] += int(str(calibration.task.report()["maps"]))
    after = np.convolve(is_adopting, np.ones(ADOPTED_TICKS))[: len(t_s)] > 0
    for chosen, name in ((is_calm & after, "peak_adopting_step_um"), (is_calm & ~after, "peak_step_um")):
        setattr(findings, name, max(getattr(findings, name), float(steps_um[chosen].max(initial=0.0))))


def _check(
    findings: Findings, simulation: FaultySimulation, watch: Watch, faults: list[Fault], run_s: float, where: str
) -> None:
    w_limit_um = max(simulation.settings.config.limits.w_limit_um)
    t_s, level_um = simulation.level_um()
    plate_um = float(level_um.max())
    findings.peak_plate_um = max(findings.peak_plate_um, plate_um)
    for what, peak_um in (("a frame requested", watch.references.peak_um), ("the plate moved by", plate_um)):
        if peak_um > w_limit_um:
            findings.failures.append(f"{where}: {what} {peak_um:g} um, the limit is {w_limit_um:g}.")
    for fault in faults:
        _check_fault(findings, fault, t_s, level_um, simulation.settings.plate.world.link_jitter_ms, where)
    findings.failures += [f"{where}, {sentence}" for sentence in watch.undetected]
    if level_um[t_s > run_s - (RUN_S - AT_REST_S)].max() > QUIET_UM or simulation.machine.pipeline.fingers:
        findings.failures.append(f"{where}: motion or fingers remain after both fingers were lifted.")


def _check_fault(
    findings: Findings, fault: Fault, t_s: FloatArray, level_um: FloatArray, jitter_ms: float, where: str
) -> None:
    """Check one fault; a link that jitters delivers the last frame that much later."""
    name, quiet_within_ms = fault.kind.name, fault.kind.quiet_within_ms
    findings.faults[name] += 1
    which = f"{where}, {name} from {fault.t_from_s:.3f} to {fault.t_until_s:.3f} s"
    if quiet_within_ms is not None:
        moving = t_s[(t_s > fault.t_from_s) & (t_s < fault.t_until_s) & (level_um > QUIET_UM)]
        quiet_ms = 1e3 * (float(moving[-1]) - fault.t_from_s) if len(moving) else 0.0
        findings.latest_quiet_ms[name] = max(findings.latest_quiet_ms.get(name, 0.0), quiet_ms)
        if quiet_ms > quiet_within_ms + jitter_ms:
            findings.failures.append(f"{which}: the plate still moved after {quiet_ms:.0f} ms.")
    end_s = fault.t_until_s + RECOVERY_S
    if level_um[(t_s > end_s - 0.25) & (t_s <= end_s)].max() < DRIVEN_UM:
        findings.failures.append(f"{which}: the fingers are not driven again.")


def _resources() -> dict[str, float]:
    """Memory in use, open files and threads of this process; free memory of the allocator is returned first."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
    with open("/proc/self/status", encoding="ascii") as file:
        status = dict(line.split(":", 1) for line in file)
    return {
        "memory_mb": int(status["VmRSS"].split()[0]) / 1024.0,
        "files": float(len(os.listdir("/proc/self/fd"))),
        "threads": float(status["Threads"]),
    }


def _grown(before: dict[str, float], after: dict[str, float]) -> list[str]:
    """A sentence per resource that grew: memory may by 1 %, the others not at all."""
    allowed = {"memory_mb": 0.01 * before["memory_mb"], "files": 0.0, "threads": 0.0}
    grown = [name for name in allowed if after[name] - before[name] > allowed[name]]
    return [f"{name} grew from {before[name]:g} to {after[name]:g}." for name in grown]


def _table(findings: Findings, runs: int, before: dict[str, float], after: dict[str, float]) -> Table:
    kinds = []
    for name, count in sorted(findings.faults.items()):
        quiet_ms = findings.latest_quiet_ms.get(name)
        quiet = {} if quiet_ms is None else {"quiet_after_ms": quiet_ms}
        kinds.append(Row(name, {"faults_count": float(count), **quiet}))
    total = {
        "faults_count": float(findings.faults.total()),
        "frames_count": float(findings.frames),
        "peak_reference_um": findings.peak_reference_um,
        "peak_plate_um": findings.peak_plate_um,
    }
    if findings.adopted:
        total |= {
            "peak_step_um": findings.peak_step_um,
            "peak_adopting_step_um": findings.peak_adopting_step_um,
            "adopted_count": float(findings.adopted["pads"]),
            "maps_count": float(findings.adopted["maps"]),
        }
    warm = min(WARM_AFTER_RUNS, runs)
    return Table(
        name="soak",
        title=f"soak: faults in {findings.virtual_s / 3600.0:.2f} h of virtual time",
        default="all",
        rows=(Row("all", total), *kinds),
        compared=(),
        notes=(
            "every fault was detected, and the fingers were driven again after it",
            *(f"{name}: {before[name]:.4g} after {warm} runs, {after[name]:.4g} after all {runs}" for name in before),
        ),
    )
