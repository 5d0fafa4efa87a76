"""Reports of a device that says nothing of fingers that lie still: passed on, and the last one repeated."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from ...values import RawReport
from ...wire.trackpad import StillContacts
from .trackpad_source import OnReports


class RepeatedReports:
    """Passes reports on, and repeats the last one when `still` says so; `repeat` makes its bytes, for an instant."""

    def __init__(self, still: StillContacts, repeat: Callable[[int], bytes], clock_ns: Callable[[], int]) -> None:
        self._still, self._bytes, self._clock_ns = still, repeat, clock_ns
        self._timer: asyncio.TimerHandle | None = None

    def start(self, loop: asyncio.AbstractEventLoop, on_reports: OnReports) -> None:
        self._loop, self._on_reports = loop, on_reports

    def pass_on(self, batch: list[RawReport]) -> None:
        self._on_reports(batch)
        self.stop()
        due_ns = self._still.due_ns
        if due_ns is not None:
            self._timer = self._loop.call_later((due_ns - self._clock_ns()) * 1e-9, self._repeat)

    def stop(self) -> None:
        """Repeat nothing until the next reports."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _repeat(self) -> None:
        t_now_ns = self._clock_ns()
        self.pass_on([RawReport(t_now_ns, self._bytes(self._still.repeat(t_now_ns)))])
