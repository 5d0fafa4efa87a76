"""A TUIO tracker: datagrams at one UDP address, read on the loop. Those that are no TUIO frame go no further."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Callable
from typing import Final

from ...values import RawReport
from ...wire.trackpad import Decoder, Pad, StillContacts, tuio
from ..time_budget import TimeBudget
from .repeats import RepeatedReports
from .trackpad_source import BATCH, REPORT_BYTES, OnLink, OnReports

SHARE, BURST_NS = 0.2, 4_000_000  # of the tracker: ten contacts take 0.1 ms to decode
_LONGEST_REST_NS: Final = 2_500_000_000  # trackers speak once a second, whatever happens
_RETRY_S: Final = 1.0


def bound(address: str) -> socket.socket:
    """Return a socket that is bound to "host:port". Raises OSError."""
    host, _, port = address.rpartition(":")
    family, kind, protocol, _, place = socket.getaddrinfo(
        host.strip("[]"), int(port), type=socket.SOCK_DGRAM, flags=socket.AI_NUMERICHOST | socket.AI_PASSIVE
    )[0]
    endpoint = socket.socket(family, kind, protocol)
    try:
        endpoint.setblocking(False)
        endpoint.bind(place)
    except OSError:
        endpoint.close()
        raise
    return endpoint


class TuioTrackpad:
    """Frames of a tracker at `address`; `pad` is the surface that it watches."""

    def __init__(self, address: str, pad: Pad, *, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._address, self._pad = address, pad
        self._clock_ns = clock_ns
        self._decoder = Decoder(pad)
        self._still = StillContacts(_LONGEST_REST_NS)
        self._repeats = RepeatedReports(self._still, lambda _: tuio.REPEAT, clock_ns)
        self._socket: socket.socket | None = None
        self._timer: asyncio.Handle | None = None
        self._budget = TimeBudget(SHARE, BURST_NS, clock_ns=clock_ns)
        self._is_reported = False
        self.left_out = 0  # datagrams beyond the time budget

    def start(self, loop: asyncio.AbstractEventLoop, on_reports: OnReports, on_link: OnLink) -> None:
        self._loop, self._on_link = loop, on_link
        self._repeats.start(loop, on_reports)
        self._timer = loop.call_soon(self._bind)

    def request_enable(self) -> None:
        """Does nothing: a tracker has no mode to enable."""

    async def close(self) -> None:
        self._repeats.stop()
        if self._timer is not None:
            self._timer.cancel()
        if self._socket is not None:
            self._loop.remove_reader(self._socket)
            self._socket.close()
            self._socket = None

    def _bind(self) -> None:
        try:
            self._socket = bound(self._address)
        except OSError as error:
            if not self._is_reported:
                self._is_reported = True
                self._on_link(
                    None, f"{self._address} cannot be bound ({error.strerror}): does another program listen there?"
                )
            self._timer = self._loop.call_later(_RETRY_S, self._bind)
            return
        self._on_link(self._pad, f"{self._pad.name} at {self._address}")
        self._loop.add_reader(self._socket, self._on_readable, self._socket)

    def _on_readable(self, endpoint: socket.socket) -> None:
        batch: list[RawReport] = []
        for _ in range(BATCH):
            try:
                data = endpoint.recv(REPORT_BYTES)
            except OSError:  # nothing waits; an error is of an earlier datagram
                break
            t_now_ns = self._clock_ns()
            if not self._budget.has_time:
                self.left_out += 1
                continue
            with self._budget:
                frames = self._decoder.decode(data, t_now_ns)
            if frames:
                self._still.took(t_now_ns, are_down=len(frames[-1].contacts) > 0)
                batch.append(RawReport(t_now_ns, data))
        if batch:
            self._repeats.pass_on(batch)
