"""The connected pad during a step: its touch frames, decoded as the service decodes them."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager

from ...io.devices.trackpad_source import TrackpadSource
from ...values import RawReport, TouchFrame
from ...wire.trackpad import DEFAULT_PAD, Decoder, Pad


@asynccontextmanager
async def reading(
    pad: TrackpadSource, take: Callable[[TouchFrame], None], on_link: Callable[[Pad | None], None]
) -> AsyncIterator[None]:
    """Context in which `take` gets each frame, and `on_link` the pad that is connected; it is closed at the end."""
    decoder = Decoder(DEFAULT_PAD)

    def linked(found: Pad | None, reason: str) -> None:  # before its first report
        nonlocal decoder
        print(f"trackpad: {reason}", flush=True)
        decoder = Decoder(found or DEFAULT_PAD)
        on_link(found)

    def reported(reports: Sequence[RawReport]) -> None:
        for report in reports:
            for frame in decoder.decode(report.data, report.t_host_ns):
                take(frame)
        if decoder.needs_enable:
            pad.request_enable()

    pad.start(asyncio.get_running_loop(), reported, linked)
    try:
        yield
    finally:
        await pad.close()
