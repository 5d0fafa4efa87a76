"""The rig's two connectors: the board's and the trackpad's endpoint in its directory.

board      a link to a pseudo-terminal: bytes to and from the board, delayed by `LINK_S` in each direction
trackpad   a unix SOCK_SEQPACKET endpoint: raw reports, one per packet, to all connections
"""

from __future__ import annotations

import contextlib
import os
import pty
import selectors
import socket
import tty
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path

LINK_S = 0.005
READ_SIZE = 4096


class BoardPlug:
    """The serial line behind `link`."""

    def __init__(self, link: Path, selector: selectors.BaseSelector, now_s: Callable[[], float]) -> None:
        """`selector`'s data are functions to call; `now_s` returns the time of arrival of bytes."""
        self._link = link
        self._now_s = now_s
        self._t_looked_s = 0.0
        self._to_board: deque[tuple[float, bytes]] = deque()
        self._to_host: deque[tuple[float, bytes]] = deque()
        self._master, self._slave = pty.openpty()  # the slave too is kept open: no hang-up when a daemon closes it
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        selector.register(self._master, selectors.EVENT_READ, self._read)
        link.symlink_to(os.ttyname(self._slave))

    def close(self) -> None:
        """Remove the link, and close the terminal."""
        self._link.unlink(missing_ok=True)
        for end in (self._master, self._slave):
            os.close(end)

    def due_s(self) -> list[float]:
        """Return when the next bytes arrive, for each direction with bytes in transit."""
        return [queue[0][0] for queue in (self._to_board, self._to_host) if queue]

    def arrived(self, now_s: float) -> Iterator[tuple[float, bytes]]:
        """Yield bytes that have reached the board, with their time."""
        self._t_looked_s = now_s
        while self._to_board and self._to_board[0][0] <= now_s:
            yield self._to_board.popleft()

    def send(self, data: bytes, t_s: float) -> None:
        """Queue the board's output of `t_s` for the host."""
        self._to_host.append((t_s + LINK_S, data))

    def deliver(self, now_s: float) -> None:
        """Write the bytes that have reached the host."""
        while self._to_host and self._to_host[0][0] <= now_s:
            data = self._to_host.popleft()[1]
            with contextlib.suppress(BlockingIOError):  # not read: lost, as on a serial line
                os.write(self._master, data)

    def _read(self) -> None:
        now_s = self._now_s()
        was_late = now_s - self._t_looked_s > LINK_S  # the bytes have waited for as long as the line takes
        with contextlib.suppress(BlockingIOError):
            self._to_board.append((now_s if was_late else now_s + LINK_S, os.read(self._master, READ_SIZE)))


class TrackpadPlug:
    """The endpoint at `link` and its connections."""

    def __init__(self, link: Path, selector: selectors.BaseSelector) -> None:
        """`selector`'s data are functions to call."""
        self._link = link
        self._readers: list[socket.socket] = []
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._listener.setblocking(False)
        self._listener.bind(str(link))
        self._listener.listen()
        selector.register(self._listener, selectors.EVENT_READ, self._accept)

    def close(self) -> None:
        """Remove the link, and close all connections."""
        self._link.unlink(missing_ok=True)
        for endpoint in (*self._readers, self._listener):
            endpoint.close()

    def send(self, report: bytes) -> None:
        """Send one report to all connections."""
        for endpoint in tuple(self._readers):
            try:
                endpoint.send(report)
            except BlockingIOError:
                continue  # a stalled reader loses reports, as from the kernel's ring
            except OSError:
                endpoint.close()
                self._readers.remove(endpoint)

    def _accept(self) -> None:
        endpoint, _ = self._listener.accept()
        endpoint.setblocking(False)
        self._readers.append(endpoint)
