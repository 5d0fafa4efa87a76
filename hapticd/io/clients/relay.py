"""Relay between one client's connection and ZeroMQ: each end is read only while the other takes the bytes."""

from __future__ import annotations

import asyncio
import select
import socket
import time
from collections.abc import Callable

CHUNK_BYTES = 65_536

Inbound = Callable[[int], bool]  # given how many bytes have come, returns whether the connection goes on


class _Pipe:
    """One direction. `waiting` are the bytes that `sink` has not taken."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        source: socket.socket,
        sink: socket.socket,
        close: Callable[[], None],
        inbound: Inbound = lambda _: True,
    ) -> None:
        self.waiting = b""
        self._loop, self._source, self._sink = loop, source, sink
        self._close, self._inbound = close, inbound
        loop.add_reader(source, self.move)

    def move(self) -> bool:
        """Pass on what has come, or what waits; return whether there was any. After its end close."""
        was_waiting = len(self.waiting) > 0
        try:
            if not was_waiting:
                self.waiting = self._source.recv(CHUNK_BYTES)
                if not self.waiting or not self._inbound(len(self.waiting)):
                    self._close()
                    return False
            self.waiting = self.waiting[self._sink.send(self.waiting) :]
        except BlockingIOError:
            if not self.waiting:
                return False
        except OSError:
            self._close()
            return False
        if self.waiting and not was_waiting:
            self._loop.remove_reader(self._source)
            self._loop.add_writer(self._sink, self.move)
        elif was_waiting and not self.waiting:
            self._loop.remove_writer(self._sink)
            self._loop.add_reader(self._source, self.move)
        return True


class Relay:
    """One client's connection and its counterpart to ZeroMQ. `on_close` is called once, whoever closes it."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        outer: socket.socket,
        inner: socket.socket,
        inbound: Inbound,
        on_close: Callable[[Relay], None],
    ) -> None:
        self.is_local = outer.family == socket.AF_UNIX
        self._loop, self._ends, self._on_close = loop, (outer, inner), on_close
        self._is_closed = False
        _Pipe(loop, outer, inner, self.close, inbound)
        self._to_client = _Pipe(loop, inner, outer, self.close)

    @property
    def is_behind(self) -> bool:
        """Whether the client leaves bytes unread."""
        return len(self._to_client.waiting) > 0

    def finish(self, t_end_s: float) -> None:
        """Pass on what ZeroMQ sends until it has closed, from `t_end_s` on as far as it comes at once; then close."""
        while not self._is_closed:
            poll = select.poll()
            poll.register(*((self._ends[0], select.POLLOUT) if self.is_behind else (self._ends[1], select.POLLIN)))
            if not poll.poll(max(t_end_s - time.monotonic(), 0.0) * 1e3):
                break
            self._to_client.move()
        self.close()

    def close(self) -> None:
        """Close both ends. Safe to call twice."""
        if self._is_closed:
            return
        self._is_closed = True
        for one in self._ends:
            if not self._loop.is_closed():
                self._loop.remove_reader(one)
                self._loop.remove_writer(one)
            one.close()
        self._on_close(self)
