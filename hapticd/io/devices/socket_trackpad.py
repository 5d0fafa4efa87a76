"""Trackpad source of the simulated rig: a unix SOCK_SEQPACKET endpoint, one report per packet."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable

from ...errors import TrackpadError
from ...values import RawReport
from ...wire.trackpad import DEFAULT_PAD, Pad
from .trackpad_source import BATCH, REPORT_BYTES, LoopSource

__all__ = ["SocketTrackpad"]


class SocketTrackpad(LoopSource):
    """The rig's trackpad. End of file or an error counts as unplugged."""

    RETRY_S = 0.25

    def __init__(self, path: str | os.PathLike[str], *, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        super().__init__(clock_ns)
        self._path = os.fspath(path)
        self._socket: socket.socket | None = None

    def _open(self) -> tuple[Pad, str]:
        endpoint = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        endpoint.setblocking(False)
        try:
            endpoint.connect(self._path)
        except OSError as error:
            endpoint.close()
            raise TrackpadError(f"no simulated trackpad at {self._path} ({error}): start the rig") from None
        self._socket = endpoint
        return DEFAULT_PAD, f"simulated trackpad at {self._path}"

    def _begin(self) -> None:
        assert self._socket is not None
        self._loop.add_reader(self._socket, self._on_readable, self._socket)

    def _on_readable(self, endpoint: socket.socket) -> None:
        batch, lost = self._drain(endpoint)
        if batch:
            self._on_reports(batch)
        if lost:
            self._lost(f"the simulated trackpad at {self._path} was lost ({lost}): reconnecting")

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

    def _release(self) -> None:
        if self._socket is not None:
            self._loop.remove_reader(self._socket)
            self._socket.close()
            self._socket = None
