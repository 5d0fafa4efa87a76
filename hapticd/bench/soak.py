"""Stability soak, `hapticd bench soak`: an hour of virtual time with a fault every two seconds.

Runs of 30 s, each a new daemon and a new board in this one process: two fingers circle, one slippery and one sticky,
while faults of all kinds follow each other at random instants and for random times. With `is_calibrating` it is one run
of a daemon that calibrates itself (`soak_calibrating`). Checked are every frame to the board, the true plate at every
control tick, the detection of and the recovery from each fault, and the memory, files and threads of this process.

Not covered: simultaneous faults, wear within one daemon beyond 30 s, the event loop, sockets and the kernel
(`tests/integration` and `tests/io` cover those).
"""

from __future__ import annotations

import ctypes
import gc
import logging
import os

import numpy as np

from ..errors import HapticdError
from ..sim.faulty import FaultySimulation
from ..sim.fingers.paths import Circle, Touch
from ..sim.fingers.scenarios import Actor
from ..sim.lockstep import Settings
from ..tools.progress import Progress
from . import soak_calibrating
from .soak_checks import RECOVERY_S, Findings, check, check_rest, drawn
from .soak_faults import Watch
from .tables import Row, Table

log = logging.getLogger("hapticd")

RUN_S = 30.0
LIFT_S, AT_REST_S = 28.8, 29.2
WARM_AFTER_RUNS = 24  # the simulation's caches are full by then: they keep 16 plates
MOST_HOURS = 24.0


def run(hours: float = 1.0, *, seed: int = 1, is_calibrating: bool = False) -> tuple[Table, ...]:
    """Run the soak. Raises HapticdError with all violations if there are any."""
    if not 0.0 < hours <= MOST_HOURS:  # False for NaN
        raise HapticdError(f"--hours: {hours:g} is out of bounds, it must be above 0 and at most {MOST_HOURS:g}.")
    findings = Findings()
    log.setLevel(logging.ERROR)  # two thousand faults would fill the log
    notes = _calibrating(findings, hours, seed) if is_calibrating else _many(findings, hours, seed)
    log.setLevel(logging.NOTSET)
    if findings.failures:
        raise HapticdError(f"soak: {len(findings.failures)} failures:\n" + "\n".join(findings.failures))
    return (_table(findings, notes),)


def _calibrating(findings: Findings, hours: float, seed: int) -> tuple[str, ...]:
    with Progress("soak") as progress:
        soak_calibrating.play(findings, seed, hours, progress)
    return ("leak: of the still finger far from faults, RMS over 150 s, at first, at last and at most",)


def _many(findings: Findings, hours: float, seed: int) -> tuple[str, ...]:
    """Play the runs; returns the process's memory, files and threads after the first ones and after all."""
    runs = max(1, round(hours * 3600.0 / RUN_S))
    warm = min(WARM_AFTER_RUNS, runs)
    before = _resources()
    for number in range(1, runs + 1):
        play(findings, seed * 1_000_000 + number)
        if number == warm:
            before = _resources()
    after = _resources()
    findings.failures += _grown(before, after)
    return tuple(f"{name}: {before[name]:.4g} after {warm} runs, {after[name]:.4g} after all {runs}" for name in before)


def play(findings: Findings, seed: int) -> None:
    """Play one run and check it."""
    rng = np.random.default_rng(seed)
    circles = [Circle((-25.0, 5.0), 15.0, 100.0), Circle((25.0, -5.0), 15.0, -100.0, start_rad=1.0)]
    actors = tuple(
        Actor(((0.0, amplitude_um),), path=Touch(circle, 0.1, LIFT_S))
        for circle, amplitude_um in zip(circles, (1.0, 0.0), strict=True)
    )
    simulation = FaultySimulation(actors, Settings(), seed)
    watch = Watch(simulation)
    faults = list(drawn(rng, 0.0, LIFT_S))
    for fault in faults:
        watch.expect(fault.kind, fault.t_from_s, fault.t_until_s, RECOVERY_S, rng)
    simulation.run(RUN_S)
    findings.virtual_s += RUN_S
    level = simulation.level_um()
    check(findings, simulation, watch, faults, level, f"run {seed}")
    check_rest(findings, simulation, level, AT_REST_S, f"run {seed}")


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


def _table(findings: Findings, notes: tuple[str, ...]) -> Table:
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
    if findings.leaks_um:
        total |= {
            "peak_step_um": findings.peak_step_um,
            "peak_adopting_step_um": findings.peak_adopting_step_um,
            **{f"{name}_count": float(findings.adopted[name]) for name in ("verdicts", "pads", "maps")},
            "leak_first_um": findings.leaks_um[0],
            "leak_last_um": findings.leaks_um[-1],
            "leak_most_um": max(findings.leaks_um),
        }
    return Table(
        name="soak",
        title=f"soak: faults in {findings.virtual_s / 3600.0:.2f} h of virtual time",
        default="all",
        rows=(Row("all", total), *kinds),
        compared=(),
        notes=(
            "every fault was detected, and the fingers were driven again after it",
            *notes,
        ),
    )
