"""The budget of processor time that one source of input has, whatever it sends."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

_LONGEST_DEBT_S: Final = 1.0


class TimeBudget:
    """Token bucket in processor time: `share` of the time that passes, and at most `burst_ns` at once.

    Ask `has_time` before each item, and handle it within `with budget:`, on one thread and without an `await` in it.
    An item may cost more than is left: `wait_s` is how long that debt, a second at most, delays the next. Time in which
    another program had the processor costs nothing. `clock_ns` and `processor_ns` measure both.
    """

    def __init__(
        self,
        share: float,
        burst_ns: int,
        *,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        processor_ns: Callable[[], int] = time.thread_time_ns,
    ) -> None:
        self._share, self._burst_ns = share, float(burst_ns)
        self._clock_ns, self._processor_ns = clock_ns, processor_ns
        self._left_ns, self._t_ns = self._burst_ns, clock_ns()
        self._begin_ns = 0

    @property
    def has_time(self) -> bool:
        """Whether the next item may be handled now."""
        t_now_ns = self._clock_ns()
        self._left_ns = min(self._left_ns + max(t_now_ns - self._t_ns, 0) * self._share, self._burst_ns)
        self._t_ns = t_now_ns
        return self._left_ns > 0.0

    @property
    def wait_s(self) -> float:
        """Time until there is time again, from the last look at `has_time` on."""
        return max(-self._left_ns, 0.0) / self._share * 1e-9

    def __enter__(self) -> None:
        self._begin_ns = self._processor_ns()

    def __exit__(self, *_: object) -> None:
        spent_ns = self._processor_ns() - self._begin_ns
        self._left_ns = max(self._left_ns - spent_ns, -_LONGEST_DEBT_S * 1e9 * self._share)
