"""Interface of all touch-report sources.

A source delivers raw reports in order of arrival, all that were waiting in one call, so that its receiver can use the
newest and drop none of the others. Report bytes are decoded in `wire.trackpad`, not here. Sources: `hid_trackpad`,
`evdev_trackpad`, `socket_trackpad` (the simulated rig) and `replay` (recordings).
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

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
        """What of the input did not become reports, by cause; empty where that cannot be."""

    def start(self, loop: asyncio.AbstractEventLoop, on_reports: OnReports, on_link: OnLink) -> None: ...

    def request_enable(self) -> None:
        """Send the multitouch enable again: the pad reports as a mouse."""

    async def close(self) -> None:
        """Stop. After return there is no thread, task, open file or further callback."""
