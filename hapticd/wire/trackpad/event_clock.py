"""Sampling instants of a device of the kernel's input layer: the kernel's stamps, and the device's own counter, if any.

The kernel stamps an event when the bus delivers it: on USB up to one polling interval late, and that is 8 ms on some
touchscreens. The device's counter (MSC_TIMESTAMP) has no such jitter, but some count in a wrong unit.
"""

from __future__ import annotations

from typing import Final

_SAME_CLOCK_NS: Final = 2_000_000_000  # a kernel's stamp is no older than this, or on another clock, as in a recording
_APART_NS: Final = 50_000_000  # no bus is so late: the counter is wrong, or was set
_FOLLOWED: Final = 256  # reports in which the counter's offset follows the kernel's stamps
_MOST_STEPS: Final = 3  # of the counter: then it is not used any more
_COUNTER_US: Final = 1 << 32


class EventClock:
    """Instants of reports on the host's axis, whatever clock the stamps are of."""

    def __init__(self) -> None:
        self.steps = 0
        self._counter_steps = 0
        self.reset()

    def reset(self) -> None:
        self._offset_ns: int | None = None  # from the stamps' clock to the host's
        self._counter_us: int | None = None
        self._t_ns = 0

    def instant_ns(self, stamp_ns: int, counter_us: int | None, t_host_ns: int) -> int:
        """Return when a report was sampled: its stamp, the device's counter (None: it has none), when it was read."""
        if self._offset_ns is None or abs(stamp_ns + self._offset_ns - t_host_ns) > _SAME_CLOCK_NS:
            self.steps += self._offset_ns is not None
            self._offset_ns = 0 if abs(stamp_ns - t_host_ns) <= _SAME_CLOCK_NS else t_host_ns - stamp_ns
        return self._counted_ns(stamp_ns + self._offset_ns, counter_us)

    def _counted_ns(self, t_stamp_ns: int, counter_us: int | None) -> int:
        last_us, self._counter_us = self._counter_us, counter_us
        t_ns = t_stamp_ns
        if counter_us and last_us is not None and self._counter_steps < _MOST_STEPS:  # the kernel restarts it at 0
            t_ns = self._t_ns + (counter_us - last_us) % _COUNTER_US * 1000
            if abs(t_stamp_ns - t_ns) > _APART_NS:
                self.steps += 1
                self._counter_steps += 1
                t_ns = t_stamp_ns
            else:
                t_ns += (t_stamp_ns - t_ns) // _FOLLOWED
        self._t_ns = t_ns
        return t_ns
