"""A loop with real-time priority that never sleeps is made to, and loses its priority before the kernel kills it."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from hapticd.io.host.runaway import WINDOW_NS, RealtimeThrottle


class Thread:
    """A thread whose clock and processor time a test moves."""

    def __init__(self, *, is_real_time: bool = True) -> None:
        self.t_ns = self.ran_ns = 0
        self.slept_s: list[float] = []
        self.throttle = RealtimeThrottle(
            clock_ns=lambda: self.t_ns,
            ran_ns=lambda: self.ran_ns,
            sleep=self.slept_s.append,
            is_real_time=lambda: is_real_time,
        )

    def go(self, spans: int, *, is_overrun: bool = False) -> int:
        """Run for quarters of a window and return how often it slept."""
        for _ in range(spans):
            self.t_ns += WINDOW_NS // 4
            self.ran_ns += WINDOW_NS // 4
            self.throttle.look(is_overrun=is_overrun)
        assert self.throttle.throttled == len(self.slept_s)
        return self.throttle.throttled


def test_a_real_time_thread_that_never_sleeps_sleeps_once_in_each_window() -> None:
    assert Thread().go(40) == 10


@pytest.mark.parametrize("is_real_time", [True, False])
def test_after_a_pass_that_overran_it_sleeps_before_the_next(is_real_time: bool) -> None:
    assert Thread(is_real_time=is_real_time).go(1, is_overrun=True) == 1


RUNAWAY = """
import os, resource, sys, time
from hapticd.io.host.runaway import on_processor_limit
resource.setrlimit(resource.RLIMIT_RTTIME, (100_000, 400_000))
try:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
except PermissionError:
    sys.exit(77)
if sys.argv[1] == "guarded":
    on_processor_limit(print)
before_s = time.thread_time()
while time.thread_time() - before_s < 0.8:
    pass
print(os.sched_getscheduler(0) == os.SCHED_OTHER)
"""


def test_at_the_soft_limit_the_priority_is_dropped_and_the_process_goes_on() -> None:
    done = subprocess.run([sys.executable, "-c", RUNAWAY, "guarded"], capture_output=True, text=True, check=False)
    if done.returncode == 77:
        pytest.skip("this user may not have real-time priority")
    assert done.returncode == 0, done.stderr
    said, is_ordinary = done.stdout.splitlines()
    assert "continues with ordinary priority" in said
    assert is_ordinary == "True"
    alone = subprocess.run([sys.executable, "-c", RUNAWAY, "alone"], capture_output=True, check=False)
    assert alone.returncode in (-signal.SIGXCPU, -signal.SIGKILL)
