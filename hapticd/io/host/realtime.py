"""Real-time settings of kernel and garbage collector, and a precise periodic timer.

    go_real_time     SCHED_FIFO and CPU affinity for the calling thread, memory locking
    quiet_collector  no garbage collection while a finger is down
    Pauses           duration of each collection that happened all the same
    PeriodicTimer    a timerfd on the loop: asyncio rounds its own timers up to milliseconds, twice

Called in the C library: mlockall, which Python lacks, and `timerfd_create`, which it has only since 3.13.
"""

from __future__ import annotations

import asyncio
import ctypes
import functools
import gc
import os
import struct
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

__all__ = ["Granted", "Pauses", "PeriodicTimer", "collect_when_idle", "go_real_time", "quiet_collector"]

SWITCH_INTERVAL_S = 5e-4  # longest wait of the loop for another Python thread (a trackpad reader)
EMERGENCY_ALLOCATIONS = 50_000  # of the youngest generation: reached only if a finger stays down for long

_LOCK_NOW_AND_LATER_ONCE_TOUCHED = 1 | 2 | 4  # MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT: unused stacks take no memory
_ITIMERSPEC = struct.Struct("4l")  # period and time to the first tick, each in seconds and ns


@dataclass(frozen=True, slots=True)
class Granted:
    """Settings that the kernel granted: `priority` 0 is ordinary scheduling. `refused` has one sentence per refusal."""

    priority: int
    processors: tuple[int, ...]
    memory_locked: bool
    refused: tuple[str, ...]


def go_real_time(*, fifo_priority: int = 0, processor: int = -1) -> Granted:
    """Request the settings that differ from the default, for the calling thread, and with a priority that used memory
    is locked; a refusal is returned, not raised.

    Later threads and processes start with ordinary scheduling (SCHED_RESET_ON_FORK), so that none of them can block
    the machine; RLIMIT_RTTIME of the service's unit bounds this thread. A second call revokes priority and memory lock
    where they are no longer requested; the CPU affinity stays.
    """
    refused = []
    if processor >= 0:
        try:
            os.sched_setaffinity(0, {processor})
        except OSError as error:
            refused.append(f"processor {processor}: {error.strerror}")
    if fifo_priority > 0 or os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK != os.SCHED_OTHER:
        policy = os.SCHED_FIFO if fifo_priority > 0 else os.SCHED_OTHER
        try:
            os.sched_setscheduler(0, policy | os.SCHED_RESET_ON_FORK, os.sched_param(fifo_priority))
        except OSError as error:
            refused.append(f"SCHED_FIFO at {fifo_priority}: {error.strerror}")
    is_locked = _lock_memory(refused) if fifo_priority > 0 else bool(_libc().munlockall())
    processors = tuple(sorted(os.sched_getaffinity(0)))
    return Granted(os.sched_getparam(0).sched_priority, processors, is_locked, tuple(refused))


def _lock_memory(refused: list[str]) -> bool:
    if _libc().mlockall(_LOCK_NOW_AND_LATER_ONCE_TOUCHED) == 0:
        return True
    refused.append(f"mlockall: {os.strerror(ctypes.get_errno())}")
    return False


def quiet_collector() -> None:
    """Freeze the objects that exist now and disable automatic collection up to EMERGENCY_ALLOCATIONS.

    `collect_when_idle` collects the rest while no finger is down.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    gc.unfreeze()  # objects of an earlier daemon in this process
    gc.collect()
    gc.freeze()
    _trim_heap()
    gc.set_threshold(EMERGENCY_ALLOCATIONS, 10, 10)


def _trim_heap() -> None:
    """Return the memory used during start (some megabytes) to the system; glibc would keep it."""
    trim = getattr(_libc(), "malloc_trim", None)  # not in musl
    if trim is not None:
        trim(0)


def collect_when_idle() -> None:
    """Run a collection while no finger is down. Frozen objects cost nothing."""
    if sum(gc.get_count()) > 0:
        gc.collect()


class Pauses:
    """Call `on_pause(span_ns)` after each garbage collection, from construction to `close`."""

    def __init__(self, on_pause: Callable[[int], None], *, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._on_pause = on_pause
        self._clock_ns = clock_ns
        self._t_begin_ns = clock_ns()
        gc.callbacks.append(self._collected)

    def close(self) -> None:
        """Remove the callback. Safe to call twice."""
        if self._collected in gc.callbacks:
            gc.callbacks.remove(self._collected)

    def _collected(self, phase: str, _: dict[str, int]) -> None:
        if phase == "start":
            self._t_begin_ns = self._clock_ns()
        else:
            self._on_pause(self._clock_ns() - self._t_begin_ns)


class PeriodicTimer:
    """Call `on_due(late_ns, missed)` on the loop every `period_ns` of the monotonic clock, without drift.

    Ticks that fell due while the loop was busy are counted in `missed` and skipped. Raises OSError.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        period_ns: int,
        on_due: Callable[[int, int], None],
        *,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._loop = loop
        self._on_due = on_due
        self._clock_ns = clock_ns
        self._settime = _libc().timerfd_settime
        self._fd: int = _libc().timerfd_create(time.CLOCK_MONOTONIC, os.O_NONBLOCK | os.O_CLOEXEC)
        if self._fd < 0:
            raise OSError(ctypes.get_errno(), "timerfd_create")
        loop.add_reader(self._fd, self._readable)
        self.set_period(period_ns)

    def set_period(self, period_ns: int, first_ns: int | None = None) -> None:
        """Restart the timer: the next tick is `first_ns` from now (None: one period)."""
        self.period_ns = period_ns
        first_ns = period_ns if first_ns is None else first_ns
        self._t_due_ns = self._clock_ns() + first_ns
        if self._settime(self._fd, 0, _times(period_ns, first_ns), None) != 0:
            raise OSError(ctypes.get_errno(), "timerfd_settime")

    def close(self) -> None:
        """Stop the timer. Safe to call twice."""
        if self._fd >= 0:
            self._loop.remove_reader(self._fd)
            os.close(self._fd)
            self._fd = -1

    def _readable(self) -> None:
        try:
            (ticks,) = struct.unpack("=Q", os.read(self._fd, 8))
        except BlockingIOError:
            return  # it was restarted after it fired
        t_last_due_ns = self._t_due_ns + (ticks - 1) * self.period_ns
        self._t_due_ns = t_last_due_ns + self.period_ns
        self._on_due(self._clock_ns() - t_last_due_ns, ticks - 1)


@functools.cache
def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


@functools.lru_cache(8)  # a daemon has three periods
def _times(period_ns: int, first_ns: int) -> bytes:
    return _ITIMERSPEC.pack(*divmod(period_ns, 1_000_000_000), *divmod(first_ns, 1_000_000_000))
