"""The rig's two plugs, which can be pulled and put back: what a program opens in its directory to have the hardware.

    board      a link to a pseudo-terminal: bytes to and from the board, each way `LINK_S` late
    trackpad   a unix SOCK_SEQPACKET endpoint: raw reports, one a packet, to each that connects

Whatever is on its way when a plug is pulled is lost.
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
        """`selector`'s data are functions to call; `now_s` tells the time that bytes are stamped with."""
        self._link = link
        self._selector = selector
        self._now_s = now_s
        self._terminal: tuple[int, int] | None = None
        self._to_board: deque[tuple[float, bytes]] = deque()
        self._to_host: deque[tuple[float, bytes]] = deque()
        self.replug()

    def replug(self) -> None:
        """Pull it, or put it back."""
        self._link.unlink(missing_ok=True)
        if self._terminal is None:
            master, slave = self._terminal = pty.openpty()  # our hold on the slave: a daemon that leaves is no hang-up
            tty.setraw(slave)
            os.set_blocking(master, False)
            self._selector.register(master, selectors.EVENT_READ, lambda: self._read(master))
            self._link.symlink_to(os.ttyname(slave))
            return
        self._selector.unregister(self._terminal[0])
        for end in self._terminal:
            os.close(end)
        self._terminal = None
        self._to_board.clear()
        self._to_host.clear()

    def close(self) -> None:
        """Pull it, if it is in."""
        if self._terminal is not None:
            self.replug()

    def due_s(self) -> list[float]:
        """When the next bytes arrive, of each way on which there are some."""
        return [queue[0][0] for queue in (self._to_board, self._to_host) if queue]

    def arrived(self, now_s: float) -> Iterator[tuple[float, bytes]]:
        """What has reached the board up to now, and when."""
        while self._to_board and self._to_board[0][0] <= now_s:
            yield self._to_board.popleft()

    def say(self, said: bytes, t_s: float) -> None:
        """The board says it at `t_s`."""
        self._to_host.append((t_s + LINK_S, said))

    def deliver(self, now_s: float) -> None:
        """Give the host what has reached it up to now."""
        while self._to_host and self._to_host[0][0] <= now_s:
            said = self._to_host.popleft()[1]
            if self._terminal is not None:
                with contextlib.suppress(BlockingIOError):  # nobody reads: a serial line loses it too
                    os.write(self._terminal[0], said)

    def _read(self, master: int) -> None:
        with contextlib.suppress(BlockingIOError):
            self._to_board.append((self._now_s() + LINK_S, os.read(master, READ_SIZE)))


class TrackpadPlug:
    """The endpoint at `link`, and all that are connected to it."""

    def __init__(self, link: Path, selector: selectors.BaseSelector) -> None:
        """`selector`'s data are functions to call."""
        self._link = link
        self._selector = selector
        self._listener: socket.socket | None = None
        self._readers: list[socket.socket] = []
        self.replug()

    def replug(self) -> None:
        """Pull it, or put it back."""
        self._link.unlink(missing_ok=True)
        if self._listener is None:
            self._listener = listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            listener.setblocking(False)
            listener.bind(str(self._link))
            listener.listen()
            self._selector.register(listener, selectors.EVENT_READ, lambda: self._accept(listener))
            return
        self._selector.unregister(self._listener)
        for endpoint in (*self._readers, self._listener):
            endpoint.close()
        self._readers.clear()
        self._listener = None

    def close(self) -> None:
        """Pull it, if it is in."""
        if self._listener is not None:
            self.replug()

    def tell(self, report: bytes) -> None:
        """One report, to each that reads."""
        for endpoint in tuple(self._readers):
            try:
                endpoint.send(report)
            except BlockingIOError:
                continue  # a reader that stalls loses reports, as from the kernel's ring
            except OSError:
                endpoint.close()
                self._readers.remove(endpoint)

    def _accept(self, listener: socket.socket) -> None:
        endpoint, _ = listener.accept()
        endpoint.setblocking(False)
        self._readers.append(endpoint)
