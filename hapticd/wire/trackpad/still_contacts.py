"""Contacts that lie still, on devices that report only what changes.

Elsewhere silence means that the pad has failed, and fingers are lifted. Here a finger that rests is silent too, so its
last report has to be repeated, at the device's own rate: else predictors would let it slide on.
"""

from __future__ import annotations

from collections import deque
from typing import Final

LONGEST_REST_NS: Final = 10_000_000_000  # a finger so still is lost: what it feels comes from sliding anyway
_GAPS: Final = 31
_FASTEST_NS, _USUAL_NS, _SLOWEST_NS = 1_000_000, 8_333_333, 20_000_000
_LATE: Final = 0.5  # of a period, that a report is awaited before the last is repeated
_LEAST_LATE_NS: Final = 2_000_000  # of the host


class StillContacts:
    """Timer that repeats the last report. `took` each report; `repeat` once `due_ns` has passed."""

    def __init__(self, longest_rest_ns: int = LONGEST_REST_NS) -> None:
        self._longest_rest_ns = longest_rest_ns
        self._gaps_ns: deque[int] = deque(maxlen=_GAPS)
        self.reset()

    def reset(self) -> None:
        """The device is another, or was unplugged."""
        self._gaps_ns.clear()
        self._t_report_ns = self._t_ns = 0
        self._are_down = False

    @property
    def period_ns(self) -> int:
        """The median of the last gaps between reports, from 1 ms to 20 ms."""
        gaps_ns = sorted(self._gaps_ns) or [_USUAL_NS]
        middle = len(gaps_ns) // 2
        usual_ns = round((gaps_ns[middle] + gaps_ns[~middle]) / 2)
        return min(max(usual_ns, _FASTEST_NS), _SLOWEST_NS)

    def took(self, t_ns: int, *, are_down: bool) -> None:
        """Record the instant of a report, and whether there are contacts after it."""
        gap_ns = t_ns - self._t_report_ns
        if self._are_down and 0 < gap_ns <= 2 * _SLOWEST_NS:
            self._gaps_ns.append(gap_ns)
        self._t_report_ns = self._t_ns = t_ns
        self._are_down = are_down

    @property
    def due_ns(self) -> int | None:
        """Instant at which to repeat the last report if none comes before; None: there is nothing to repeat."""
        t_next_ns = self._t_ns + self.period_ns
        if not self._are_down or t_next_ns - self._t_report_ns > self._longest_rest_ns:
            return None
        return t_next_ns + max(round(_LATE * self.period_ns), _LEAST_LATE_NS)

    def repeat(self, t_now_ns: int) -> int:
        """Return the instant of the repeated report: whole periods after the last, and not after now."""
        self._t_ns += max((t_now_ns - self._t_ns) // self.period_ns, 1) * self.period_ns
        return self._t_ns
