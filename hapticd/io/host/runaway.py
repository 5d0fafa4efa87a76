"""Guards of a loop with real-time priority that would never sleep: the kernel kills it at RLIMIT_RTTIME without a word.

Breather             sleeps for a moment where the loop's thread has run for long without a sleep
on_processor_limit   at the soft limit, the sooner one: gives the priority back, and says so
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from typing import Final

WINDOW_NS: Final = 40_000_000
BUSY_FRAC: Final = 0.95  # of a window: a loop that sleeps is below
BREATH_S: Final = 0.001  # any sleep ends the kernel's count; this one also lets others run


class Breather:
    """Sleeps BREATH_S where a thread has not slept for WINDOW_NS, and after what took too long; `breaths` counts."""

    def __init__(
        self,
        *,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        ran_ns: Callable[[], int] = time.thread_time_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.breaths = 0
        self._clock_ns = clock_ns
        self._ran_ns = ran_ns
        self._sleep = sleep
        self._t_ns, self._t_ran_ns = clock_ns(), ran_ns()

    def look(self, *, is_overrun: bool = False) -> bool:
        """Sleep if it is time; return whether it was."""
        span_ns = self._clock_ns() - self._t_ns
        if span_ns < WINDOW_NS and not is_overrun:
            return False
        is_busy = is_overrun or self._ran_ns() - self._t_ran_ns >= BUSY_FRAC * span_ns
        if is_busy:
            self._sleep(BREATH_S)
            self.breaths += 1
        self._t_ns, self._t_ran_ns = self._clock_ns(), self._ran_ns()
        return is_busy


def on_processor_limit(say: Callable[[str], None]) -> None:
    """At the soft RLIMIT_RTTIME, return this thread to ordinary scheduling, which has no such limit, and `say` so.

    The hard limit ends the process: the kernel raises the soft one after its signal, and warns only once.
    """

    def give_back(*_: object) -> None:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        say(
            "the loop did not sleep for RLIMIT_RTTIME: it continues with ordinary priority until the service restarts "
            "(what took so long is in `status`: timing and touch)"
        )

    if hasattr(signal, "SIGXCPU"):
        signal.signal(signal.SIGXCPU, give_back)
