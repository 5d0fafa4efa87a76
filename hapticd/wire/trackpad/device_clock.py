"""Device time of a trackpad: its 21-bit millisecond counter on the host's time axis."""

from __future__ import annotations

STAMP_WRAP_MS = 1 << 21

_STEP_NS = 2_000_000_000  # beyond the 0.7 s that 63 reports in the kernel's ring can be late
_BACKWARDS_MS = 100
_DRIFT = 1000  # one part in a thousand: no quartz is that wrong


class DeviceClock:
    """A 21-bit millisecond counter, unwrapped and mapped to host time.

    The host's clock determines the number of wraps since the last report, so an idle gap may last for weeks. The
    offset between the two clocks is tracked within the drift of a quartz. Where the counter deviates by more than a
    queue can explain, or runs backwards, it was stopped or restarted, and the next stamp is anchored to host time.
    """

    def __init__(self) -> None:
        self.steps = 0
        self.reset()

    def reset(self) -> None:
        self._stamp_ms: int | None = None
        self._t_ns = self._t_host_ns = self._ahead_ns = 0

    def unwrap(self, stamp_ms: int, t_host_ns: int) -> int:
        """Return the instant of a stamp, in ns. The first one after a reset is `t_host_ns` itself."""
        if self._stamp_ms is None or not self._follow(stamp_ms - self._stamp_ms, t_host_ns):
            self._t_ns, self._ahead_ns = t_host_ns, 0
        self._stamp_ms, self._t_host_ns = stamp_ms, t_host_ns
        return self._t_ns

    def _follow(self, step_ms: int, t_host_ns: int) -> bool:
        """Advance by `step_ms` and the number of wraps that fits host time best; False for a step of the clock."""
        elapsed_ns = t_host_ns - self._t_host_ns
        wraps = (elapsed_ns // 1_000_000 - step_ms + STAMP_WRAP_MS // 2) // STAMP_WRAP_MS
        step_ms += wraps * STAMP_WRAP_MS
        t_ns = self._t_ns + step_ms * 1_000_000
        drift_ns = t_ns - t_host_ns - self._ahead_ns
        slack_ns = max(elapsed_ns // _DRIFT, 0)
        if step_ms < -_BACKWARDS_MS or abs(drift_ns) > _STEP_NS + slack_ns:
            self.steps += 1
            return False
        self._t_ns = t_ns
        self._ahead_ns += min(max(drift_ns, -slack_ns), slack_ns)
        return True
