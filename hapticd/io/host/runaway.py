"""Guards of a loop with real-time priority that would never sleep: the kernel kills it at RLIMIT_RTTIME without a word.

RealtimeThrottle     sleeps for a moment where the loop's thread has run for long without a sleep, and after an overrun
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


def is_real_time() -> bool:
    """Return whether the kernel counts this thread against RLIMIT_RTTIME, and lets nothing ordinary run beside it."""
    return os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK in (os.SCHED_FIFO, os.SCHED_RR)


class RealtimeThrottle:
    """Sleeps BREATH_S where a real-time thread has not slept for WINDOW_NS, and after what took too long.

    `throttled` counts.
    """

    def __init__(
        self,
        *,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        ran_ns: Callable[[], int] = time.thread_time_ns,
        sleep: Callable[[float], None] = time.sleep,
        is_real_time: Callable[[], bool] = is_real_time,
    ) -> None:
        self.throttled = 0
        self._is_real_time = is_real_time
        self._clock_ns = clock_ns
        self._ran_ns = ran_ns
        self._sleep = sleep
        self._t_ns, self._t_ran_ns = clock_ns(), ran_ns()

    def look(self, *, is_overrun: bool = False) -> None:
        """Sleep if it is time."""
        span_ns = self._clock_ns() - self._t_ns
        if span_ns < WINDOW_NS and not is_overrun:
            return
        is_busy = self._ran_ns() - self._t_ran_ns >= BUSY_FRAC * span_ns
        if is_overrun or (is_busy and self._is_real_time()):
            self._sleep(BREATH_S)
            self.throttled += 1
        self._t_ns, self._t_ran_ns = self._clock_ns(), self._ran_ns()


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

    signal.signal(signal.SIGXCPU, give_back)
