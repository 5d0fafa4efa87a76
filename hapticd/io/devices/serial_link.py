"""The serial link to the board: opens it, moves bytes, notices that it is gone, opens it again.

pyserial sets the port up and holds it exclusively; then the descriptor is non-blocking and the loop watches it, which
halves the cost of a write against pyserial's own. A write that the port does not take at once is dropped and the
output flushed: a stalled board must never find a queue of stale frames.

A board at rest speaks ten times a second all the same. Each time would wake the loop, so meanwhile what it says waits
for `read`, or for the answer to what was written last.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import termios
from collections.abc import Callable

import serial

FIRST_RETRY_S = 0.25
LAST_RETRY_S = 2.0
READ_SIZE = 4096
FRAME_END = b"\0"  # see firmware/PROTOCOL.md; an empty frame is none


class SerialLink:
    """One serial port, reopened for ever until closed. Callbacks run on the loop."""

    def __init__(self, port: str, baud: int) -> None:
        self.port = port
        self.dropped_writes = 0
        self._baud = baud
        self._serial: serial.Serial | None = None
        self._retry: asyncio.TimerHandle | None = None
        self._retry_s = FIRST_RETRY_S
        self._said_missing = False
        self._torn = False
        self._is_watched = False
        self._is_resting = False

    def start(
        self,
        loop: asyncio.AbstractEventLoop,
        on_bytes: Callable[[bytes], None],
        on_link: Callable[[bool, str], None],
    ) -> None:
        """Open now, or as soon as the port is there. `on_link(up, reason)` tells each change once."""
        self._loop, self._on_bytes, self._on_link = loop, on_bytes, on_link
        self._open()

    def write(self, data: bytes) -> bool:
        """Hand `data` to the port whole, or drop it."""
        if self._serial is None:
            return False
        self._watch(True)
        if self._torn:
            data = FRAME_END + data  # what a dropped write left on the line must not cost this one too
        try:
            written = os.write(self._serial.fd, data)
        except BlockingIOError:
            written = 0
        except OSError as error:
            self._lost(f"write failed: {error.strerror}")
            return False
        self._torn = written != len(data)
        if not self._torn:
            return True
        self.dropped_writes += 1
        with contextlib.suppress(termios.error):
            termios.tcflush(self._serial.fd, termios.TCOFLUSH)
        return False

    def rest(self, is_resting: bool) -> None:
        """Whether what comes may wait."""
        self._is_resting = is_resting
        self._watch(not is_resting)

    def read(self) -> None:
        """Take what has come, if anything has."""
        if self._serial is not None:
            self._readable()

    async def drained(self, within_s: float) -> None:
        """Wait until the port has sent what was written, at most `within_s`."""
        if self._serial is None:
            return
        deadline_s = self._loop.time() + within_s
        while self._serial is not None and self._loop.time() < deadline_s:
            try:
                if self._serial.out_waiting == 0:
                    return
            except OSError:
                return
            await asyncio.sleep(0.002)

    def close(self) -> None:
        """Close for good."""
        if self._retry is not None:
            self._retry.cancel()
            self._retry = None
        self._release()

    def _open(self) -> None:
        self._retry = None
        try:
            # No time between bytes means VMIN = 1: else of an idle terminal a read looks like its end.
            self._serial = serial.Serial(self.port, self._baud, timeout=0, inter_byte_timeout=0, exclusive=True)
        except (OSError, ValueError, termios.error) as error:
            if not self._said_missing:
                self._on_link(False, f"{self.port} cannot be opened: {_cause(error)}")
                self._said_missing = True
            self._try_again()
            return
        self._said_missing = self._torn = False
        self._retry_s = FIRST_RETRY_S
        os.set_blocking(self._serial.fd, False)
        self._watch(True)
        self._on_link(True, f"{self.port} open at {self._baud} baud")

    def _readable(self) -> None:
        assert self._serial is not None
        try:
            data = os.read(self._serial.fd, READ_SIZE)
        except BlockingIOError:
            return
        except OSError as error:
            self._lost(f"read failed: {error.strerror}")
            return
        if not data:
            self._lost("end of file")
            return
        if self._is_resting:
            self._watch(False)
        self._on_bytes(data)

    def _watch(self, is_watched: bool) -> None:
        """Have the loop call `_readable`, or no more."""
        if self._serial is None or is_watched is self._is_watched:
            return
        self._is_watched = is_watched
        if is_watched:
            self._loop.add_reader(self._serial.fd, self._readable)
        else:
            self._loop.remove_reader(self._serial.fd)

    def _lost(self, reason: str) -> None:
        self._release()
        self._said_missing = True
        self._on_link(False, f"{self.port} lost: {reason}")
        self._try_again()

    def _release(self) -> None:
        if self._serial is None:
            return
        self._watch(False)
        with contextlib.suppress(OSError):
            self._serial.close()
        self._serial = None

    def _try_again(self) -> None:
        self._retry = self._loop.call_later(self._retry_s, self._open)
        self._retry_s = min(2 * self._retry_s, LAST_RETRY_S)


def _cause(error: Exception) -> str:
    """The operating system's own words where pyserial wraps them."""
    number = error.args[0] if isinstance(error, termios.error) else getattr(error, "errno", None)
    if number == errno.EWOULDBLOCK:
        return "another program holds it"
    return os.strerror(number) if isinstance(number, int) else str(error)
