"""Who notes when the machine itself stands still: `python -m hapticd.bench.stall_monitor PROCESSOR PRIORITY`.

It sleeps for 5 ms again and again, ahead of everybody else on its processor (SCHED_FIFO at PRIORITY, where that is
granted). What keeps it asleep is no other program but the hypervisor or the kernel, and no priority helps against that.
Each line on standard input is answered with the longest time, in ms, by which one waking came too late after the one
before it, since the last such line.
"""

from __future__ import annotations

import contextlib
import os
import select
import sys
import time

SLEEP_S = 0.005


def main(processor: int, priority: int) -> None:
    """Watch until standard input ends."""
    with contextlib.suppress(OSError):
        os.sched_setaffinity(0, {processor})
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    late_s, t_woke_s = 0.0, time.monotonic()
    print("ready", flush=True)
    while True:
        asked, _, _ = select.select([sys.stdin], [], [], SLEEP_S)
        t_asleep_s, t_woke_s = t_woke_s, time.monotonic()  # from waking to waking: no instant is outside
        late_s = max(late_s, t_woke_s - t_asleep_s - SLEEP_S)  # asked or not: the question may come while all stands
        if not asked:
            continue
        if not sys.stdin.readline():
            return
        print(late_s * 1e3, flush=True)
        late_s = 0.0


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
