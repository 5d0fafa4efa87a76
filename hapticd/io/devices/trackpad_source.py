"""Interface of all touch-report sources.

A source delivers raw reports in order of arrival, all that were waiting in one call, so that its receiver can use the
newest and drop none of the others. Report bytes are decoded in `wire.trackpad`, not here. Sources: `hid_trackpad`,
`evdev_trackpad`, `socket_trackpad` (the simulated rig) and `replay` (recordings).
"""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from ...errors import TrackpadError
from ...values import RawReport
from ...wire.trackpad import Pad

OnReports = Callable[[Sequence[RawReport]], None]
OnLink = Callable[[Pad | None, str], None]

REPORT_BYTES = 4096  # the longest is of ten axes of 16 contacts as input events; a short read would lose the rest
BATCH = 64  # the kernel keeps 63 reports


class TrackpadSource(Protocol):
    """A stream of raw reports that reconnects after unplugging. All callbacks run on the loop.

    `on_link(pad, description)` precedes the first report: the pad that was opened, by which its reports are decoded.
    `on_link(None, reason)` follows once when the stream ends or cannot start; a source that can reconnect keeps trying.
    """

    @property
    def counters(self) -> Mapping[str, int | str]:
        """Counts of input that became no reports, by cause; empty where that cannot be."""

    def start(self, loop: asyncio.AbstractEventLoop, on_reports: OnReports, on_link: OnLink) -> None: ...

    def request_enable(self) -> None:
        """Send the multitouch enable again: the pad reports as a mouse."""

    async def close(self) -> None:
        """Stop. After return there is no thread, task, open file or further callback."""


class LoopSource(ABC):
    """A source on the loop, which searches for its device every RETRY_S until it is there, and again after its loss."""

    RETRY_S = 1.0

    def __init__(self, clock_ns: Callable[[], int]) -> None:
        self._clock_ns = clock_ns
        self._timer: asyncio.Handle | None = None
        self._is_up: bool | None = None  # None: nothing was reported

    @property
    def counters(self) -> Mapping[str, int | str]:
        return {}

    def start(self, loop: asyncio.AbstractEventLoop, on_reports: OnReports, on_link: OnLink) -> None:
        self._loop, self._on_reports, self._on_link = loop, on_reports, on_link
        self._timer = loop.call_soon(self._search)

    def request_enable(self) -> None:  # noqa: B027 - most devices have no mode to enable
        pass

    async def close(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._release()

    @abstractmethod
    def _open(self) -> tuple[Pad, str]:
        """Open the device; return its pad and description. Raises TrackpadError, and leaves nothing open."""

    @abstractmethod
    def _begin(self) -> None:
        """Read the device from now on."""

    @abstractmethod
    def _release(self) -> None:
        """Close the device if it is open."""

    def _search(self) -> None:
        try:
            link = self._open()
        except TrackpadError as error:
            self._lost(str(error))
            return
        self._is_up = True
        self._on_link(*link)
        self._begin()

    def _lost(self, reason: str) -> None:
        """Close the device and search for it; report it once."""
        self._release()
        self._timer = self._loop.call_later(self.RETRY_S, self._search)
        if self._is_up is not False:
            self._is_up = False
            self._on_link(None, reason)
