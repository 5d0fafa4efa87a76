"""Trackpad source of the simulated rig: a unix SOCK_SEQPACKET endpoint, one report per packet."""

from __future__ import annotations

import asyncio
import os
import socket
import time
from collections.abc import Callable

from ...values import RawReport
from ...wire.trackpad import DEFAULT_PAD
from .trackpad_source import BATCH, REPORT_BYTES, OnLink, OnReports

__all__ = ["SocketTrackpad"]

_RETRY_S = (0.25, 0.5, 1.0)


class SocketTrackpad:
    """The rig's trackpad.

    The multitouch enable is sent over the same socket, as the feature report's bytes: after connecting and on request.
    End of file or an error counts as unplugged; it reconnects after 0.25 s, 0.5 s, then every second.
    """

    def __init__(self, path: str | os.PathLike[str], *, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._path = os.fspath(path)
        self._clock_ns = clock_ns
        self._socket: socket.socket | None = None
        self._timer: asyncio.Handle | None = None
        self._failures = 0
        self._is_up: bool | None = None

    @property
    def counters(self) -> dict[str, int | str]:
        return {}

    def start(self, loop: asyncio.AbstractEventLoop, on_reports: OnReports, on_link: OnLink) -> None:
        self._loop, self._on_reports, self._on_link = loop, on_reports, on_link
        self._timer = loop.call_soon(self._connect)

    def request_enable(self) -> None:
        if self._socket is None:
            return
        try:
            self._socket.send(DEFAULT_PAD.enable)
        except OSError:
            return  # as with a pad that refuses it; a lost connection shows at the next read

    async def close(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._disconnect()

    def _connect(self) -> None:
        endpoint = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        endpoint.setblocking(False)
        try:
            endpoint.connect(self._path)
        except OSError as error:
            endpoint.close()
            self._retry(f"no simulated trackpad at {self._path} ({error}): start the rig")
            return
        self._socket, self._is_up = endpoint, True
        self._loop.add_reader(endpoint, self._on_readable, endpoint)
        self.request_enable()
        self._on_link(DEFAULT_PAD, f"simulated trackpad at {self._path}")

    def _on_readable(self, endpoint: socket.socket) -> None:
        batch, lost = self._drain(endpoint)
        if batch:
            self._failures = 0
            self._on_reports(batch)
        if lost:
            self._disconnect()
            self._retry(f"the simulated trackpad at {self._path} was lost ({lost}): reconnecting")

    def _drain(self, endpoint: socket.socket) -> tuple[list[RawReport], str]:
        """Read all waiting packets; also returns the reason why the stream ended, or an empty text."""
        batch: list[RawReport] = []
        while len(batch) < BATCH:
            try:
                data = endpoint.recv(REPORT_BYTES)
            except BlockingIOError:
                break
            except OSError as error:
                return batch, str(error)
            if not data:
                return batch, "closed by the rig"
            batch.append(RawReport(self._clock_ns(), data))
        return batch, ""

    def _disconnect(self) -> None:
        if self._socket is not None:
            self._loop.remove_reader(self._socket)
            self._socket.close()
            self._socket = None

    def _retry(self, reason: str) -> None:
        delay_s = _RETRY_S[min(self._failures, len(_RETRY_S) - 1)]
        self._failures += 1
        self._timer = self._loop.call_later(delay_s, self._connect)
        if self._is_up is not False:
            self._is_up = False
            self._on_link(None, reason)
