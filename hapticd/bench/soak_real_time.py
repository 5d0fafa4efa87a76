"""`hapticd bench soak --real-time SECONDS`: the service itself, on the simulated rig, while the machine is busy.

Two fingers circle, one slippery and one sticky, for SECONDS each: with the machine to itself, beside programs that take
every processor whole, and while four clients offer messages as fast as they can. The service runs in this process as
`hapticd run` does, with SCHED_FIFO as its unit asks for where the kernel grants it; rig, hogs and clients are processes
of their own. The times are those of the service's own histograms. Beside them stands for how long the machine itself
did not go on (`witness`): what is late by no more than that, the service could not help.

What this leaves out: a real serial line and a real trackpad. Without SCHED_FIFO the figures speak of the scheduler.
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
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from ..config.sections import Config
from ..core.board.ledger import Ledger, LoopTiming
from ..core.plate.mode_shapes import ModeShapes
from ..daemon.daemon import Daemon, now_ns
from ..daemon.lifecycle import serve
from ..daemon.machine import Machine
from ..daemon.service import ConfigLoader
from ..errors import HapticdError
from ..io.host.realtime import go_real_time
from ..sim.rig.process import RigProcess
from ..values import AmplitudeTarget, ClientTargets, Target
from ..wire import protocol
from ..wire.framing import FrameSplitter
from .soak_company import FLOODERS, Counts, flood, hogs, stood_ms, witnesses
from .soak_faults import LONGEST_FRAME, reference_peak_um
from .tables import Row, Table, finite_rows

MOST_S = 3600.0
PRIORITY = 20  # as in systemd/hapticd.service
SLIPPERY_UM, STICKY_UM = 1.0, 0.0
ASK_EVERY_S, TTL_NS = 0.1, 2_000_000_000
PATIENCE_S = 60.0
SETTLE_S = 0.5  # what the programs' start brought about is over, and the board has told of it
PAUSE_NS = 1_000_000  # a garbage collection that takes longer is counted

Told = TypeVar("Told")
Played = tuple[list[tuple[str, Counts]], tuple[str, ...]]  # rows by the spell's name, and notes


@dataclass
class Watch:
    """What is seen from inside the service, beside its histograms; the machine's observer."""

    machine: Machine
    frames: int = 0
    peak_um: float = 0.0
    pauses: int = 0
    longest_silence_ns: int = 0
    silences: int = 0  # for longer than the board's dead-man waits: a keep-alive was missed
    _t_written_ns: int | None = None
    _t_collecting_ns: int = 0
    _splitter: FrameSplitter = field(default_factory=lambda: FrameSplitter(LONGEST_FRAME))

    def observer(self, kind: str, t_ns: int, *values: Any) -> None:
        """Every line that is written is read as the board would read it."""
        if kind != "written":
            return
        if values[1]:
            self._heard(t_ns)
        for message in self._splitter.feed(values[0]):
            if message[0] == protocol.MSG_REFERENCE:
                self.frames += 1
                self.peak_um = max(self.peak_um, reference_peak_um(message))

    def _heard(self, t_ns: int) -> None:
        """The board's line took something now."""
        hello = self.machine.session.hello
        if self._t_written_ns is not None and hello is not None:
            silence_ns = t_ns - self._t_written_ns
            self.longest_silence_ns = max(self.longest_silence_ns, silence_ns)
            self.silences += silence_ns > hello.deadman_ms * 1_000_000
        self._t_written_ns = t_ns

    def collected(self, phase: str, _: dict[str, int]) -> None:
        """One of `gc.callbacks`."""
        if phase == "start":
            self._t_collecting_ns = now_ns()
        else:
            self.pauses += now_ns() - self._t_collecting_ns > PAUSE_NS

    def begin(self) -> None:
        """Forget what was counted."""
        self.frames, self.peak_um, self.pauses = 0, 0.0, 0
        self.longest_silence_ns, self.silences = 0, 0
        self.machine.loop, self.machine.session.ledger = LoopTiming(), Ledger()


def run(seconds: float) -> tuple[Table, ...]:
    """Play and count. Raises HapticdError for a time out of bounds, a rig that does not answer, or a frame that asked
    for more than its limit."""
    if not 0.0 < seconds <= MOST_S:  # False for NaN
        raise HapticdError(f"--real-time: {seconds:g} s is out of bounds, it must be above 0 and at most {MOST_S:g}.")
    config = Config()
    with (
        tempfile.TemporaryDirectory(prefix="hapticd-") as folder,
        RigProcess("circles", 1) as rig,
        ConfigLoader() as shop,
    ):
        with contextlib.suppress(PermissionError):  # hardware is never preempted
            os.sched_setscheduler(rig.process.pid, os.SCHED_FIFO, os.sched_param(PRIORITY + 1))
        config = replace(
            config,
            client=replace(config.client, runtime_dir=folder),
            sim=replace(config.sim, rig_dir=str(rig.directory)),
            realtime=replace(config.realtime, fifo_priority=PRIORITY),
        )
        prepared = shop.prepare(config)
        thresholds, interval_s = gc.get_threshold(), sys.getswitchinterval()
        try:
            rows, notes = asyncio.run(_played(prepared.daemon(), prepared.modes, seconds))
        finally:
            go_real_time()
            gc.set_threshold(*thresholds)
            sys.setswitchinterval(interval_s)
    return (_table(rows, notes, seconds),)


async def _played(daemon: Daemon, modes: ModeShapes, seconds: float) -> Played:
    serving = asyncio.create_task(serve(daemon, modes))
    watching = asyncio.create_task(_watched(daemon, seconds))
    await asyncio.wait((serving, watching), return_when=asyncio.FIRST_COMPLETED)
    for task in (watching, serving):
        task.cancel()
    await asyncio.wait((serving, watching))
    for task in (serving, watching):
        if not task.cancelled() and (error := task.exception()) is not None:
            raise error
    if watching.cancelled():
        raise HapticdError("soak: it was ended before its time.")
    return watching.result()


async def _watched(daemon: Daemon, seconds: float) -> Played:
    await asyncio.sleep(0)  # let it start
    machine = daemon.machine
    watch = Watch(machine)
    machine.observer = watch.observer
    gc.callbacks.append(watch.collected)
    endpoint = f"ipc://{daemon.runtime_dir / 'targets'}"
    spells: dict[str, Callable[[], AbstractContextManager[list[Counts]]]] = {
        "alone": lambda: contextlib.nullcontext([]),
        "hogs on every processor": hogs,
        f"{FLOODERS} clients flood": lambda: flood(endpoint),
    }
    try:
        await _driven(machine)
        async with _aside(witnesses(PRIORITY + 2)) as beside:
            rows = [(name, await _spell(watch, spell, seconds, beside)) for name, spell in spells.items()]
    finally:
        gc.callbacks.remove(watch.collected)
        machine.observer = None
    return rows, _notes(machine)


async def _driven(machine: Machine) -> None:
    """Until the board follows what two fingers are given."""
    t_end_s = time.monotonic() + PATIENCE_S
    while not (len(machine.pipeline.fingers) == 2 and machine.session.follows(now_ns())):
        if time.monotonic() > t_end_s:
            raise HapticdError(f"soak: the rig's board does not follow within {PATIENCE_S:g} s: the machine is busy.")
        await _ask(machine)


async def _ask(machine: Machine) -> None:
    fingers = sorted(machine.pipeline.fingers, key=lambda finger: finger.x_mm)
    wishes: dict[int | str, Target] = {
        finger.finger_id: AmplitudeTarget(SLIPPERY_UM if finger is fingers[0] else STICKY_UM) for finger in fingers
    }
    machine.want(ClientTargets("soak", TTL_NS, wishes, {}), now_ns())
    await asyncio.sleep(ASK_EVERY_S)


@contextlib.asynccontextmanager
async def _aside(company: AbstractContextManager[Told]) -> AsyncIterator[Told]:
    """Programs start and end in a thread: the loop, which is the service's, goes on meanwhile."""
    told = await asyncio.to_thread(company.__enter__)
    try:
        yield told
    finally:
        await asyncio.to_thread(company.__exit__, None, None, None)


async def _spell(
    watch: Watch,
    spell: Callable[[], AbstractContextManager[list[Counts]]],
    seconds: float,
    beside: Sequence[subprocess.Popen[str]],
) -> Counts:
    """The counts of `seconds` in which `spell` is in force."""
    machine = watch.machine
    async with _aside(spell()) as told:
        await asyncio.to_thread(stood_ms, beside)
        await asyncio.sleep(SETTLE_S)
        trips, lost = _trips(machine), machine.lost_messages()["too_fast"]
        watch.begin()
        t_end_s = time.monotonic() + seconds
        while time.monotonic() < t_end_s:
            await _ask(machine)
        counts = _counted(watch) | {"dead_man_trips_count": float(_trips(machine) - trips)}
        counts["machine_stood_ms"] = await asyncio.to_thread(stood_ms, beside)
        lost = machine.lost_messages()["too_fast"] - lost
    for one in told:
        counts = counts | one | {"not_read_hz": lost / seconds}
    w_limit_um = max(machine.config.limits.w_limit_um)
    if watch.peak_um > w_limit_um:
        raise HapticdError(f"soak: a frame asked for {watch.peak_um:g} um of {w_limit_um:g}.")
    return counts


def _trips(machine: Machine) -> int:
    return 0 if machine.session.status is None else machine.session.status.deadman_trips


def _counted(watch: Watch) -> Counts:
    loop, ledger = watch.machine.loop, watch.machine.session.ledger
    return {
        "compute_p50_us": loop.compute.percentile_ns(50) * 1e-3,
        "compute_p99_us": loop.compute.percentile_ns(99) * 1e-3,
        "wait_p99_us": loop.wait.percentile_ns(99) * 1e-3,
        "timer_late_p99_us": loop.tick_late.percentile_ns(99) * 1e-3,
        "frames_count": float(watch.frames),
        "late_frames_count": float(ledger.late_frames),
        "missed_ticks_count": float(loop.missed_ticks),
        "gc_pauses_count": float(watch.pauses),
        "peak_um": watch.peak_um,
        "longest_silence_ms": watch.longest_silence_ns * 1e-6,
        "missed_keep_alives_count": float(watch.silences),
    }


def _notes(machine: Machine) -> tuple[str, ...]:
    granted, limit_um = machine.real_time, max(machine.config.limits.w_limit_um)
    priority = granted.get("priority", 0)
    return (
        f"SCHED_FIFO {priority}" if priority else "without SCHED_FIFO, which was not granted: the scheduler's times",
        "compute: pass and writing; wait: from reading a report to its pass; gc pauses: above 1 ms",
        f"no frame asked for more than {limit_um:g} um; missed keep-alives: silences longer than the dead-man waits",
        "stood: the longest that a processor itself did not go on, as a process ahead of all others noted",
        "offered: tries of four clients; sent: what their sockets took; not read: beyond the rate of one sender",
    )


def _table(rows: Sequence[tuple[str, Counts]], notes: tuple[str, ...], seconds: float) -> Table:
    made: tuple[Row, ...] = finite_rows(rows)
    return Table(
        name="soak_real_time",
        title=f"soak: two moving fingers on the simulated rig in real time, {seconds:g} s each",
        default=made[0].name,
        rows=made,
        compared=("compute_p99_us",),
        notes=notes,
    )
