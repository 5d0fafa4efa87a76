"""In parallel with programs that take every processor whole: with SCHED_FIFO no keep-alive is missed."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest
from service import PIPE, Bench, drive, wait_for

HOGS_PER_PROCESSOR = 2
LOADED_S = 4.0
PRIORITY = 20


def may_have_fifo() -> bool:
    """Whether the kernel would give this process SCHED_FIFO: script of a child, which ends with it."""
    script = f"import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param({PRIORITY}))"
    return subprocess.run([sys.executable, "-c", script], stderr=subprocess.DEVNULL, check=False).returncode == 0


@pytest.mark.alone
@pytest.mark.skipif(not may_have_fifo(), reason="SCHED_FIFO needs root or CAP_SYS_NICE")
def test_hogs_on_every_processor_cost_a_fifo_service_no_keep_alive(bench: Bench) -> None:
    rig = bench.rig()
    os.sched_setscheduler(rig.process.pid, os.SCHED_FIFO, os.sched_param(PRIORITY + 1))  # hardware is never preempted
    bench.configure(f"[realtime]\nfifo_priority = {PRIORITY}\n")
    service = bench.service()
    client = bench.client()
    drive(client)
    before = client.status()
    assert before["real_time"]["priority"] == PRIORITY
    processors = len(os.sched_getaffinity(0))
    hogs = [
        subprocess.Popen([sys.executable, "-c", "print(flush=True)\nwhile True: pass"], stdout=PIPE)
        for _ in range(HOGS_PER_PROCESSOR * processors)
    ]
    try:
        for hog in hogs:
            assert hog.stdout is not None
            hog.stdout.readline()
        passes = before["timing"]["histograms"]["compute"]["count"]
        t_end_s = time.monotonic() + LOADED_S
        wait_for(lambda: time.monotonic() >= t_end_s)
        after = client.status()
    finally:
        for hog in hogs:
            hog.kill()
            hog.communicate()
    assert service.process.poll() is None
    assert after["timing"]["histograms"]["compute"]["count"] > passes
    assert after["board"]["deadman_trips"] == before["board"]["deadman_trips"]
