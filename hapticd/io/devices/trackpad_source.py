"""Interface of all touch-report sources, and the trackpads that are known.

A source delivers raw reports in order of arrival, all that were waiting in one call, so that its receiver can use the
newest and drop none of the others. Report bytes are decoded in `wire.trackpad`, not here. Sources: `hid_trackpad`,
`socket_trackpad` (the simulated rig) and `replay` (recordings).

Ids and enable bytes are those of the Linux driver `drivers/hid/hid-magicmouse.c`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from ...values import RawReport

OnReports = Callable[[Sequence[RawReport]], None]
OnLink = Callable[[bool, str], None]

REPORT_BYTES = 512  # the longest report is 280 bytes, and a short read would lose the rest
BATCH = 64  # the kernel keeps 63 reports
_USB, _BLUETOOTH = 1, 2  # hidapi's bus_type


@dataclass(frozen=True, slots=True)
class PadId:
    """HID ids of one trackpad model on one bus, and the feature report that switches it to multitouch."""

    model: str
    name: str
    bus: int
    vendor_id: int
    product_id: int
    interface: int
    enable: bytes


PADS = (
    PadId("usbc-usb", "Magic Trackpad (USB-C) on USB", _USB, 0x05AC, 0x0324, 1, b"\x02\x01"),
    PadId("mt2-usb", "Magic Trackpad 2 on USB", _USB, 0x05AC, 0x0265, 1, b"\x02\x01"),
    PadId("usbc-bt", "Magic Trackpad (USB-C) on Bluetooth", _BLUETOOTH, 0x004C, 0x0324, -1, b"\xf1\x02\x01"),
    PadId("mt2-bt", "Magic Trackpad 2 on Bluetooth", _BLUETOOTH, 0x004C, 0x0265, -1, b"\xf1\x02\x01"),
    PadId("mt1", "Magic Trackpad on Bluetooth", _BLUETOOTH, 0x05AC, 0x030E, -1, b"\xd7\x01"),
)
MODELS = tuple(pad.model for pad in PADS)


class TrackpadSource(Protocol):
    """A stream of raw reports that reconnects after unplugging. All callbacks run on the loop.

    `on_link(True, description)` precedes the first report. `on_link(False, reason)` follows once when the stream ends
    or cannot start; a source that can reconnect keeps trying. `model` selects the decoder and is set when
    `on_link(True, ...)` is called.
    """

    @property
    def model(self) -> str | None: ...

    def start(self, loop: asyncio.AbstractEventLoop, on_reports: OnReports, on_link: OnLink) -> None: ...

    def request_enable(self) -> None:
        """Send the multitouch enable again: the pad reports as a mouse."""

    async def close(self) -> None:
        """Stop. After return there is no thread, task, open file or further callback."""
