"""The programs beside the service in a soak in real time: witnesses of the machine, hogs, clients that flood."""

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
    """Programs that say so when they are ready, from then to the end of this."""
    running = [
        subprocess.Popen([sys.executable, *command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
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


def witnesses(priority: int) -> AbstractContextManager[list[subprocess.Popen[str]]]:
    """One for each processor, with `priority` ahead of rig and service."""
    processors = sorted(os.sched_getaffinity(0))
    return _processes([("-m", "hapticd.bench.stall_monitor", f"{number}", f"{priority}") for number in processors])


@contextlib.contextmanager
def hogs() -> Iterator[list[Counts]]:
    """One program for each processor that never pauses."""
    hog = ("-c", "print(flush=True)\nwhile True: pass")
    with _processes([hog] * len(os.sched_getaffinity(0))):
        yield []


@contextlib.contextmanager
def flood(endpoint: str) -> Iterator[list[Counts]]:
    """Clients that offer as many messages as they can; what they offered a second is told at the end."""
    told: list[Counts] = []
    commands = [("-m", "hapticd.bench.flood", endpoint, f"flood {number}") for number in range(FLOODERS)]
    with _processes(commands) as running:
        t_from_s = time.monotonic()
        yield told
        lasted_s = time.monotonic() - t_from_s
        said = [process.communicate()[0].split() for process in running]
    offered, sent = (sum(float(words[column]) for words in said) / lasted_s for column in (0, 1))
    told.append({"offered_hz": offered, "sent_hz": sent})


def stood_ms(witnesses: Sequence[subprocess.Popen[str]]) -> float:
    """The longest that any processor stood still, since this was asked last."""
    for witness in witnesses:
        assert witness.stdin is not None
        print(file=witness.stdin, flush=True)
    return max(float(witness.stdout.readline()) for witness in witnesses if witness.stdout is not None)
