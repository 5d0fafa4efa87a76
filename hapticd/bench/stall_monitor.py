"""Stall monitor of one processor: `python -m hapticd.bench.stall_monitor PROCESSOR PRIORITY`.

Sleeps for 5 ms at a time with SCHED_FIFO at PRIORITY, where that is granted: then only the hypervisor or the kernel
can delay it, as they delay the service. For each line on standard input it prints the longest delay in ms between two
wake-ups since the last such line.
"""

from __future__ import annotations

import contextlib
import os
import select
import sys
import time

SLEEP_S = 0.005


def main(processor: int, priority: int) -> None:
    """Monitor until standard input ends."""
    with contextlib.suppress(OSError):
        os.sched_setaffinity(0, {processor})
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    late_s, t_woke_s = 0.0, time.monotonic()
    print("ready", flush=True)
    while True:
        requested, _, _ = select.select([sys.stdin], [], [], SLEEP_S)
        t_last_s, t_woke_s = t_woke_s, time.monotonic()  # from wake-up to wake-up, so that no instant is missed
        late_s = max(late_s, t_woke_s - t_last_s - SLEEP_S)  # also with a request, which may arrive in a stall
        if not requested:
            continue
        if not sys.stdin.readline():
            return
        print(late_s * 1e3, flush=True)
        late_s = 0.0


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
