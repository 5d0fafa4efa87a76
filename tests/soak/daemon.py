"""Soak of the daemon: an hour of virtual time with a fault every two seconds.

Runs of 30 s, each a new daemon and a new board in this one process: two fingers circle, one slippery and one sticky,
while faults of all kinds follow each other at random instants and for random times. Checked are every frame to the
board, the true plate at every control tick, the detection of and the recovery from each fault, and the memory, files
and threads of this process.

Not covered: simultaneous faults, wear within one daemon beyond 30 s, the event loop, sockets and the kernel
(`tests/integration` and `tests/io` cover those).
"""

from __future__ import annotations

import ctypes
import gc
import logging
import os
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from faulty_simulation import FaultySimulation
from soak.faults import KINDS, Kind, Watch
from soak.harness import ALL, Findings, added, judged

from hapticd.bench.tables import Table
from hapticd.sim.fingers.paths import CirclePath, Path, Touch
from hapticd.sim.fingers.scenarios import SLIPPERY_UM, STICKY_UM, Actor
from hapticd.sim.settings import Settings
from hapticd.values import FloatArray

log = logging.getLogger("hapticd")

Bools = npt.NDArray[np.bool_]

RUN_S = 30.0
LIFTED_S, AT_REST_S = 1.2, 0.8  # before the end of a run
FIRST_FAULT_S, RECOVERY_S = 1.5, 0.9  # a board with a wrapped clock is detected after half a second
WARM_AFTER_RUNS = 24  # the simulation's caches are full by then: they keep 16 plates
MEMORY_GROWTH_FRAC = 0.01
QUIET_UM, DRIVEN_UM = 0.01, 0.3


class Fault(NamedTuple):
    """One fault; instants in seconds of the run."""

    kind: Kind
    t_from_s: float
    t_until_s: float


def run(hours: float = 1.0, *, seed: int = 1) -> Table:
    """Run the soak. Raises HapticdError with all violations if there are any."""
    notes: tuple[str, ...] = ("every fault was detected, and the fingers were driven again after it",)
    log.setLevel(logging.ERROR)  # two thousand faults would fill the log
    try:
        return judged(_many(hours, seed), name="soak", title="daemon amid faults, in virtual time", notes=notes)
    finally:
        log.setLevel(logging.NOTSET)


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
    return _Run(simulation, seed).played()


def _actors(paths: tuple[Path, Path], run_s: float) -> tuple[Actor, ...]:
    return tuple(
        Actor(((0.0, amplitude_um),), path=Touch(path, 0.1, run_s - LIFTED_S))
        for path, amplitude_um in zip(paths, (SLIPPERY_UM, STICKY_UM), strict=True)
    )


class _Run:
    """One run: draws its faults at its beginning and checks it at its end."""

    def __init__(self, simulation: FaultySimulation, seed: int) -> None:
        self._simulation, self._where = simulation, f"run {seed}"
        self._rng = np.random.default_rng(seed)
        self._watch = Watch(simulation)

    def played(self) -> Findings:
        """Play the run and return what references and plate reached, and each fault's effect."""
        faults = list(drawn(self._rng, 0.0, RUN_S - LIFTED_S))
        for fault in faults:
            self._watch.expect(fault.kind, fault.t_from_s, fault.t_until_s, RECOVERY_S, self._rng)
        self._simulation.run(RUN_S)
        t_s, level_um = self._simulation.level_um()
        references = self._watch.references
        peaks_um = {"reference": references.peak_um, "plate": float(level_um.max())}
        limit_um = max(self._simulation.settings.config.limits.w_limit_um)
        figures = {
            "virtual_h": RUN_S / 3600.0,
            "faults_count": float(len(faults)),
            "frames_count": float(references.frames),
            **{f"peak_{name}_um": peak_um for name, peak_um in peaks_um.items()},
        }
        failures = [
            f"{self._where}: a peak of the {name} was {peak_um:g} um, the limit is {limit_um:g}."
            for name, peak_um in peaks_um.items()
            if peak_um > limit_um
        ]
        failures += [f"{self._where}, {sentence}" for sentence in self._watch.undetected]
        if level_um[t_s > RUN_S - AT_REST_S].max() > QUIET_UM or self._simulation.machine.pipeline.fingers:
            failures.append(f"{self._where}: motion or fingers remain after both fingers were lifted.")
        return added(
            [*(self._check_fault(fault, t_s, level_um) for fault in faults), Findings({ALL: figures}, failures)]
        )

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


def drawn(rng: np.random.Generator, t_from_s: float, t_until_s: float) -> Iterator[Fault]:
    """Draw faults one after another; each kind once per round, in random order."""
    t_s = t_from_s + FIRST_FAULT_S
    while True:
        for index in rng.permutation(len(KINDS)):
            kind = KINDS[index]
            start_s = t_s + float(rng.uniform(0.0, 0.05))
            end_s = start_s + float(rng.uniform(*kind.lasts_s))
            t_s = end_s + RECOVERY_S
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
