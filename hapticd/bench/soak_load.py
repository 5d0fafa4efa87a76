"""Load on a real-time soak: stall monitors, busy loops on all processors, clients that flood the service."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager

FLOODERS = 4

Counts = dict[str, float]


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


def stall_monitors(priority: int) -> AbstractContextManager[list[subprocess.Popen[str]]]:
    """Run a stall monitor on each processor; `priority` is above that of rig and service."""
    processors = sorted(os.sched_getaffinity(0))
    return _processes([("-m", "hapticd.bench.stall_monitor", f"{number}", f"{priority}") for number in processors])


@contextlib.contextmanager
def hogs() -> Iterator[list[Counts]]:
    """Run a busy loop for each processor."""
    hog = ("-c", "print(flush=True)\nwhile True: pass")
    with _processes([hog] * len(os.sched_getaffinity(0))):
        yield []


@contextlib.contextmanager
def flood(endpoint: str) -> Iterator[list[Counts]]:
    """Run clients that offer as many messages as they can; the yielded list gets their rates at the end."""
    rates: list[Counts] = []
    commands = [("-m", "hapticd.bench.flood", endpoint, f"flood {number}") for number in range(FLOODERS)]
    with _processes(commands) as running:
        t_from_s = time.monotonic()
        yield rates
        lasted_s = time.monotonic() - t_from_s
        counts = [process.communicate()[0].split() for process in running]
    offered, sent = (sum(float(words[column]) for words in counts) / lasted_s for column in (0, 1))
    rates.append({"offered_hz": offered, "sent_hz": sent})


def longest_stall_ms(monitors: Sequence[subprocess.Popen[str]]) -> float:
    """Return the longest stall of any processor since the last call."""
    for monitor in monitors:
        assert monitor.stdin is not None
        print(file=monitor.stdin, flush=True)
    return max(float(monitor.stdout.readline()) for monitor in monitors if monitor.stdout is not None)
