"""Serial link to the board: opens the port, transfers bytes, detects loss and reopens.

pyserial configures the port and opens it exclusively. The descriptor is then non-blocking and watched by the loop,
which halves the cost of a write. A write that the port does not accept at once is dropped and the output flushed, so
that a stalled board never receives a queue of stale frames.

A board in steady use sends a status per reference, an idle one ten a second. So that none of them wakes the loop, bytes
then wait for the next `read`, which the daemon makes with each pass.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import termios
from collections.abc import Callable

import serial

from ..time_budget import TimeBudget

RETRY_S = 0.25  # as long as two handshakes; an attempt on a missing port takes 0.02 ms
READ_SIZE = 4096
SHARE, BURST_NS = 0.4, 50_000_000  # of the loop's time; the simulated board takes 0.1 %
FRAME_END = b"\0"  # see firmware/PROTOCOL.md; empty frames are ignored


class SerialLink:
    """One serial port, reopened until closed. Callbacks run on the loop."""

    def __init__(self, port: str, baud: int) -> None:
        self.port = port
        self._baud = baud
        self._serial: serial.Serial | None = None
        self._retry: asyncio.TimerHandle | None = None
        self._is_reported_missing = False
        self._is_torn = False
        self._is_watched = False
        self._budget = TimeBudget(SHARE, BURST_NS)
        self.left_out = 0  # times that what waited was dropped unread

    def start(
        self,
        loop: asyncio.AbstractEventLoop,
        on_bytes: Callable[[bytes], None],
        on_link: Callable[[bool, str], None],
    ) -> None:
        """Open the port now or once it exists. `on_link(up, reason)` reports each change once."""
        self._loop, self._on_bytes, self._on_link = loop, on_bytes, on_link
        self._open()

    def write(self, data: bytes) -> bool:
        """Write `data` whole or drop it; returns whether it was written."""
        if self._serial is None:
            return False
        if self._is_torn:
            data = FRAME_END + data  # ends the partial frame that a dropped write left
        try:
            written = os.write(self._serial.fd, data)
        except BlockingIOError:
            written = 0
        except OSError as error:
            self._lost(f"write failed: {error.strerror}")
            return False
        self._is_torn = written != len(data)
        if not self._is_torn:
            return True
        with contextlib.suppress(termios.error):
            termios.tcflush(self._serial.fd, termios.TCOFLUSH)
        return False

    def set_baud(self, baud: int) -> None:
        """Set the speed until the port is closed. What was written must have been answered: nothing waits here."""
        if self._serial is None:
            return
        try:
            self._serial.baudrate = baud
            os.set_blocking(self._serial.fd, False)
        except (OSError, ValueError, termios.error) as error:
            self._lost(f"it cannot be set to {baud} baud: {_cause(error)}")

    def wait(self, may_wait: bool) -> None:
        """Set whether received bytes wait for the next `read`, or the loop makes it."""
        if self._serial is None or may_wait is not self._is_watched:
            return
        self._is_watched = not may_wait
        if may_wait:
            self._loop.remove_reader(self._serial.fd)
        else:
            self._loop.add_reader(self._serial.fd, self.read)

    def read(self) -> None:
        """Read what has arrived, if anything; of a board that sends too much, drop it."""
        if self._serial is None:
            return
        if not self._budget.has_time:
            self.left_out += 1
            with contextlib.suppress(termios.error):
                termios.tcflush(self._serial.fd, termios.TCIFLUSH)
            return
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
        with self._budget:
            self._on_bytes(data)

    async def drained(self, within_s: float) -> None:
        """Wait until the port has sent all written bytes, at most `within_s`."""
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
            # Without an inter-byte timeout VMIN is 1: otherwise a read of an idle terminal looks like end of file.
            self._serial = serial.Serial(self.port, self._baud, timeout=0, inter_byte_timeout=0, exclusive=True)
        except (OSError, ValueError, termios.error) as error:
            if not self._is_reported_missing:
                self._on_link(False, f"{self.port} cannot be opened: {_cause(error)}")
                self._is_reported_missing = True
            self._retry_later()
            return
        self._is_reported_missing = self._is_torn = False
        os.set_blocking(self._serial.fd, False)
        self.wait(False)
        self._on_link(True, f"{self.port} open at {self._baud} baud")

    def _lost(self, reason: str) -> None:
        self._release()
        self._is_reported_missing = True
        self._on_link(False, f"{self.port} lost: {reason}")
        self._retry_later()

    def _release(self) -> None:
        if self._serial is None:
            return
        self.wait(True)
        with contextlib.suppress(OSError):
            self._serial.close()
        self._serial = None

    def _retry_later(self) -> None:
        self._retry = self._loop.call_later(RETRY_S, self._open)


def _cause(error: Exception) -> str:
    """Return the operating system's message where pyserial wraps it."""
    number = error.args[0] if isinstance(error, termios.error) else getattr(error, "errno", None)
    if number == errno.EWOULDBLOCK:
        return "another program holds it"
    return os.strerror(number) if isinstance(number, int) else str(error)
