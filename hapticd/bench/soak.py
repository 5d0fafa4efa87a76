"""`hapticd bench soak`: an hour in which something goes wrong every two seconds, in virtual time.

Runs of 30 s, each a new daemon and a new board in this one process: two fingers circle, one slippery and one sticky,
and faults of all kinds that the lock-step world knows come one after another, each at an instant, and for a time, that
the seed draws. Looked at are every frame on its way to the board, the true plate at every control tick, what the daemon
and the board make of each fault, and this process: memory, files, threads.

What this leaves out: faults at the same time, wear that takes longer than 30 s within one daemon, the event loop, the
sockets and the kernel (`tests/integration` and `tests/io` have those).
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

from ..errors import HapticdError
from ..sim.faulty import FaultySimulation
from ..sim.fingers.paths import Circle, Touch
from ..sim.fingers.scenarios import Actor
from ..sim.lockstep import Settings
from .soak_faults import KINDS, Kind, Watch
from .tables import Row, Table

log = logging.getLogger("hapticd")

RUN_S = 30.0
FIRST_FAULT_S, RECOVERY_S = 1.5, 0.9  # a board behind a wrapped clock is noticed after half a second
LIFT_S, AT_REST_S = 28.8, 29.2
QUIET_UM, DRIVEN_UM = 0.01, 0.3
WARM_AFTER_RUNS = 24  # by then the simulation's caches are full: they keep 16 plates
MOST_HOURS = 24.0


@dataclass
class Findings:
    """What came of it; a sentence in `wrong` for each thing that should not have been."""

    virtual_s: float = 0.0
    frames: int = 0
    peak_reference_um: float = 0.0
    peak_plate_um: float = 0.0
    faults: Counter[str] = field(default_factory=Counter)
    latest_quiet_ms: dict[str, float] = field(default_factory=dict)
    wrong: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Fault:
    """One that was drawn; instants in seconds of the run."""

    kind: Kind
    t_from_s: float
    t_until_s: float


def run(hours: float = 1.0, *, seed: int = 1) -> tuple[Table, ...]:
    """Play it and judge it. Raises HapticdError where something was wrong, with all that was."""
    if not 0.0 < hours <= MOST_HOURS:  # False for NaN
        raise HapticdError(f"--hours: {hours:g} is out of bounds, it must be above 0 and at most {MOST_HOURS:g}.")
    findings = Findings()
    runs = max(1, round(hours * 3600.0 / RUN_S))
    log.setLevel(logging.ERROR)  # the journal of two thousand faults
    before = after = _resources()
    for number in range(1, runs + 1):
        play(findings, seed * 1_000_000 + number)
        if number == min(WARM_AFTER_RUNS, runs):
            before = _resources()
    log.setLevel(logging.NOTSET)
    after = _resources()
    findings.wrong += _grown(before, after)
    if findings.wrong:
        raise HapticdError(f"soak: {len(findings.wrong)} things went wrong:\n" + "\n".join(findings.wrong))
    return (_table(findings, runs, before, after),)


def play(findings: Findings, seed: int) -> None:
    """One run of RUN_S."""
    rng = np.random.default_rng(seed)
    circles = [Circle((-25.0, 5.0), 15.0, 100.0), Circle((25.0, -5.0), 15.0, -100.0, start_rad=1.0)]
    actors = tuple(
        Actor(((0.0, amplitude_um),), path=Touch(circle, 0.1, LIFT_S))
        for circle, amplitude_um in zip(circles, (1.0, 0.0), strict=True)
    )
    simulation = FaultySimulation(actors, Settings(), seed)
    watch = Watch(simulation)
    faults = list(_drawn(rng))
    for fault in faults:
        watch.expect(fault.kind, fault.t_from_s, fault.t_until_s, RECOVERY_S, rng)
    simulation.run(RUN_S)
    findings.virtual_s += RUN_S
    findings.frames += watch.frames
    findings.peak_reference_um = max(findings.peak_reference_um, watch.peak_um)
    _judge(findings, simulation, watch, faults, f"run {seed}")


def _drawn(rng: np.random.Generator) -> Iterator[Fault]:
    """Faults one after another, each once in turn in an order of its own."""
    t_s = FIRST_FAULT_S
    while True:
        for index in rng.permutation(len(KINDS)):
            kind = KINDS[index]
            t_from_s = t_s + float(rng.uniform(0.0, 0.05))
            t_until_s = t_from_s + float(rng.uniform(*kind.lasts_s))
            t_s = t_until_s + RECOVERY_S
            if t_s > LIFT_S:
                return
            yield Fault(kind, t_from_s, t_until_s)


def _judge(findings: Findings, simulation: FaultySimulation, watch: Watch, faults: list[Fault], where: str) -> None:
    w_limit_um = max(simulation.settings.config.limits.w_limit_um)
    t_s, level_um = simulation.level_um()
    findings.peak_plate_um = max(findings.peak_plate_um, float(level_um.max()))
    if watch.peak_um > w_limit_um:
        findings.wrong.append(f"{where}: a frame asked for {watch.peak_um:g} um of {w_limit_um:g}.")
    if level_um.max() > w_limit_um:
        findings.wrong.append(f"{where}: the plate moved by {level_um.max():g} um of {w_limit_um:g}.")
    for fault in faults:
        name = fault.kind.name
        findings.faults[name] += 1
        told = f"{where}, {name} from {fault.t_from_s:.3f} to {fault.t_until_s:.3f} s"
        moving = t_s[(t_s > fault.t_from_s) & (t_s < fault.t_until_s) & (level_um > QUIET_UM)]
        quiet_ms = 1e3 * (float(moving[-1]) - fault.t_from_s) if len(moving) else 0.0
        if fault.kind.quiet_within_ms is not None:
            findings.latest_quiet_ms[name] = max(findings.latest_quiet_ms.get(name, 0.0), quiet_ms)
            if quiet_ms > fault.kind.quiet_within_ms:
                findings.wrong.append(f"{told}: the plate still moved after {quiet_ms:.0f} ms.")
        end_s = fault.t_until_s + RECOVERY_S
        if level_um[(t_s > end_s - 0.25) & (t_s <= end_s)].max() < DRIVEN_UM:
            findings.wrong.append(f"{told}: the fingers are not driven again.")
    findings.wrong += [f"{where}, {sentence}" for sentence in watch.unaccounted]
    if level_um[t_s > AT_REST_S].max() > QUIET_UM or simulation.machine.pipeline.fingers:
        findings.wrong.append(f"{where}: something stayed when both fingers had been lifted.")


def _resources() -> dict[str, float]:
    """Of this process: memory in use, open files, threads. What the allocator keeps for later is not in use."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
    with open("/proc/self/status", encoding="ascii") as file:
        told = dict(line.split(":", 1) for line in file)
    return {
        "memory_mb": int(told["VmRSS"].split()[0]) / 1024.0,
        "files": float(len(os.listdir("/proc/self/fd"))),
        "threads": float(told["Threads"]),
    }


def _grown(before: dict[str, float], after: dict[str, float]) -> list[str]:
    """Memory may grow by 1 %, the rest not at all."""
    room = {"memory_mb": 0.01 * before["memory_mb"], "files": 0.0, "threads": 0.0}
    grown = [name for name in room if after[name] - before[name] > room[name]]
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
    warm = min(WARM_AFTER_RUNS, runs)
    return Table(
        name="soak",
        title=f"{findings.virtual_s / 3600.0:.2f} h in which things go wrong, in virtual time",
        default="all",
        rows=(Row("all", total), *kinds),
        compared=(),
        notes=(
            "every fault was told of, and the fingers were driven again after it",
            *(f"{name}: {before[name]:.4g} after {warm} runs, {after[name]:.4g} after all {runs}" for name in before),
        ),
    )
