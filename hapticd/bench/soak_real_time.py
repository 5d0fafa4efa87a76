"""Real-time soak, `hapticd bench soak --real-time SECONDS`: the service on the simulated rig of a loaded machine.

Two fingers circle, one slippery and one sticky, for SECONDS under each load: none, busy loops on all processors, and
four clients that flood the service with messages. The service runs in this process like `hapticd run`, with SCHED_FIFO
where the kernel grants it; rig, busy loops and clients (`soak_flood`) are other processes. Times are those of the
service's own histograms.

Not covered: a real serial line and a real trackpad. Without SCHED_FIFO the figures are those of the scheduler.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any

from hapticd_contract.contents import Amplitude, Content
from hapticd_contract.targets import ClientTargets

from ..config.sections import Config
from ..core.board.ledger import Ledger, LoopTiming
from ..daemon.daemon import Daemon, now_ns
from ..daemon.lifecycle import while_served
from ..daemon.machine import Machine
from ..errors import HapticdError
from ..io.host.realtime import go_real_time
from ..sim.rig.process import RigProcess
from ..tools.service import ConfigLoader
from .soak import Findings, check_length, judged
from .soak_faults import ReferenceMeter
from .tables import Table

MOST_S = 3600.0
PRIORITY = 20  # as in systemd/hapticd.service
SLIPPERY_UM, STICKY_UM = 1.0, 0.0
REQUEST_EVERY_S, TTL_NS = 0.1, 2_000_000_000
TIMEOUT_S = 60.0
SETTLE_S = 0.5  # after the start of the load, and for the next status of the board

FLOODERS = 4

Counts = dict[str, float]
Load = Callable[[], AbstractContextManager[list[Counts]]]


class Watch:
    """Observer of the machine: references to the board, and silences between two writes."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self._t_written_ns: int | None = None
        self.restart()

    def restart(self) -> None:
        """Reset all counters and the service's histograms."""
        self.references = ReferenceMeter()
        self.longest_silence_ns = 0
        self.machine.status.loop, self.machine.session.ledger = LoopTiming(), Ledger()

    def observer(self, kind: str, t_ns: int, *values: Any) -> None:
        """Take one event of the machine."""
        if kind != "written":
            return
        self.references.feed(values[0])
        if values[1]:  # the port accepted it
            if self._t_written_ns is not None:
                self.longest_silence_ns = max(self.longest_silence_ns, t_ns - self._t_written_ns)
            self._t_written_ns = t_ns


def run(seconds: float) -> Table:
    """Run the soak. Raises HapticdError for a time out of bounds, a rig that does not answer, or a frame beyond its
    limit."""
    check_length("--real-time", seconds, MOST_S)
    config = Config()
    with (
        tempfile.TemporaryDirectory(prefix="hapticd-") as folder,
        RigProcess("circles", 1) as rig,
        ConfigLoader() as loader,
    ):
        with contextlib.suppress(PermissionError):  # real hardware is never preempted
            os.sched_setscheduler(rig.process.pid, os.SCHED_FIFO, os.sched_param(PRIORITY + 1))
        config = replace(
            config,
            client=replace(config.client, runtime_dir=folder),
            sim=replace(config.sim, rig_dir=str(rig.directory)),
            realtime=replace(config.realtime, fifo_priority=PRIORITY),
        )
        prepared = loader.prepare(config)
        thresholds, interval_s = gc.get_threshold(), sys.getswitchinterval()
        try:
            daemon = prepared.daemon()
            found = asyncio.run(while_served(daemon, prepared.modes, _measured(daemon, seconds)))
        finally:
            go_real_time()
            gc.set_threshold(*thresholds)
            sys.setswitchinterval(interval_s)
    if found is None:
        raise HapticdError("soak: interrupted before its end.")
    findings, notes = found
    return judged(findings, name="soak_real_time", title=f"two moving fingers, {seconds:g} s each", notes=notes)


async def _measured(daemon: Daemon, seconds: float) -> tuple[list[Findings], tuple[str, ...]]:
    await asyncio.sleep(0)  # let the service start
    machine = daemon.machine
    watch = Watch(machine)
    machine.observer = watch.observer
    endpoint = f"ipc://{daemon.runtime_dir / 'targets'}"
    loads: dict[str, Load] = {
        "no load": lambda: contextlib.nullcontext([]),
        "hogs on every processor": _hogs,
        f"{FLOODERS} clients flood": lambda: _flood(endpoint),
    }
    try:
        await _driven(machine)
        found = [await _under_load(watch, name, load, seconds) for name, load in loads.items()]
    finally:
        machine.observer = None
    return found, _notes(machine)


async def _driven(machine: Machine) -> None:
    """Request targets until the board follows the references of two fingers."""
    t_end_s = time.monotonic() + TIMEOUT_S
    while not (len(machine.pipeline.fingers) == 2 and machine.session.follows(now_ns())):
        if time.monotonic() > t_end_s:
            raise HapticdError(f"soak: the rig's board does not follow within {TIMEOUT_S:g} s: the machine is busy.")
        await _request(machine)


async def _request(machine: Machine) -> None:
    fingers = sorted(machine.pipeline.fingers, key=lambda finger: finger.x_mm)
    targets: dict[int | str, Content] = {
        finger.finger_id: Amplitude(SLIPPERY_UM if finger is fingers[0] else STICKY_UM) for finger in fingers
    }
    machine.want(ClientTargets.of("soak", TTL_NS, targets, {}), now_ns())
    await asyncio.sleep(REQUEST_EVERY_S)


async def _under_load(watch: Watch, name: str, load: Load, seconds: float) -> Findings:
    """Return what `seconds` under a load find. It is entered and exited in a thread: the event loop belongs to the
    service and must not block."""
    machine, manager = watch.machine, load()
    rates = await asyncio.to_thread(manager.__enter__)
    try:
        await asyncio.sleep(SETTLE_S)
        trips, lost = _trips(machine), machine.status.lost_messages()["too_fast"]
        watch.restart()
        t_end_s = time.monotonic() + seconds
        while time.monotonic() < t_end_s:
            await _request(machine)
        counts = _counted(watch) | {"dead_man_trips_count": float(_trips(machine) - trips)}
        lost = machine.status.lost_messages()["too_fast"] - lost
    finally:
        await asyncio.to_thread(manager.__exit__, None, None, None)
    for one in rates:
        counts |= one | {"refused_hz": lost / seconds}
    limit_um, peak_um = max(machine.config.limits.w_limit_um), watch.references.peak_um
    failures = [f"{name}: a frame requested {peak_um:g} um, the limit is {limit_um:g}."] if peak_um > limit_um else []
    return Findings({name: counts}, failures)


def _trips(machine: Machine) -> int:
    return 0 if machine.session.status is None else machine.session.status.deadman_trips


def _counted(watch: Watch) -> Counts:
    loop, ledger = watch.machine.status.loop, watch.machine.session.ledger
    return {
        "compute_p50_us": loop.compute.percentile_ns(50) * 1e-3,
        "compute_p99_us": loop.compute.percentile_ns(99) * 1e-3,
        "wait_p99_us": loop.wait.percentile_ns(99) * 1e-3,
        "timer_late_p99_us": loop.tick_late.percentile_ns(99) * 1e-3,
        "frames_count": float(watch.references.frames),
        "late_frames_count": float(ledger.late_frames),
        "missed_ticks_count": float(loop.missed_ticks),
        "gc_pauses_count": float(loop.pauses),
        "peak_um": watch.references.peak_um,
        "longest_silence_ms": watch.longest_silence_ns * 1e-6,
    }


def _notes(machine: Machine) -> tuple[str, ...]:
    granted, limit_um = machine.status.real_time, max(machine.config.limits.w_limit_um)
    priority = granted.get("priority", 0)
    return (
        f"SCHED_FIFO {priority}" if priority else "without SCHED_FIFO (not granted): the times are the scheduler's",
        "compute: pass and write; wait: from reading a report to its pass; gc pauses: above 1 ms",
        f"no frame requested more than {limit_um:g} um; silence: between two writes to the board",
        "offered, sent: messages of four clients, tried and accepted by their sockets; refused: beyond the rate limit",
    )


# --- load ---


@contextlib.contextmanager
def _processes(commands: Sequence[Sequence[str]]) -> Iterator[list[subprocess.Popen[str]]]:
    """Run Python programs that print a line when they are ready; kill those that still run at the end."""
    running = [
        subprocess.Popen([sys.executable, "-P", *command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        for command in commands
    ]
    try:
        for process in running:
            assert process.stdout is not None
            process.stdout.readline()
        yield running
    finally:
        for process in running:
            if process.poll() is None:
                process.kill()
                process.communicate()


@contextlib.contextmanager
def _hogs() -> Iterator[list[Counts]]:
    """Run a busy loop for each processor."""
    hog = ("-c", "print(flush=True)\nwhile True: pass")
    with _processes([hog] * len(os.sched_getaffinity(0))):
        yield []


@contextlib.contextmanager
def _flood(endpoint: str) -> Iterator[list[Counts]]:
    """Run clients that offer as many messages as they can; the yielded list gets their rates at the end."""
    rates: list[Counts] = []
    commands = [("-m", "hapticd.bench.soak_flood", endpoint, f"flood {number}") for number in range(FLOODERS)]
    with _processes(commands) as running:
        t_from_s = time.monotonic()
        yield rates
        lasted_s = time.monotonic() - t_from_s
        counts = [process.communicate()[0].split() for process in running]
    offered, sent = (sum(float(words[column]) for words in counts) / lasted_s for column in (0, 1))
    rates.append({"offered_hz": offered, "sent_hz": sent})
