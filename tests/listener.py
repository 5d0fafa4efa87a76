"""What receives the reports of a touch source in tests."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

from hapticd.io.devices.trackpad_source import TrackpadSource
from hapticd.values import RawReport
from hapticd.wire.trackpad import Pad


class Listener:
    """What a source events, in order, and a way to wait for the next thing."""

    def __init__(self) -> None:
        self.events: list[tuple[Pad | None, str] | list[bytes]] = []
        self.reports: list[RawReport] = []
        self._news: asyncio.Queue[None] = asyncio.Queue()

    def on_reports(self, reports: Sequence[RawReport]) -> None:
        self.reports.extend(reports)
        self.events.append([report.data for report in reports])
        self._news.put_nowait(None)

    def on_link(self, pad: Pad | None, reason: str) -> None:
        self.events.append((pad, reason))
        self._news.put_nowait(None)

    @property
    def links(self) -> list[tuple[Pad | None, str]]:
        return [item for item in self.events if isinstance(item, tuple)]

    def listen(self, source: TrackpadSource) -> None:
        source.start(asyncio.get_running_loop(), self.on_reports, self.on_link)

    async def until(self, condition: Callable[[], bool]) -> None:
        async with asyncio.timeout(5):
            while not condition():
                await self._news.get()
