"""A pseudo-terminal in place of a board's serial port."""

from __future__ import annotations

import fcntl
import os
import pty
import struct
import termios
import tty


class Terminal:
    """`port` is what a program opens; this end, `master`, reads what it writes."""

    def __init__(self) -> None:
        self.master, self.slave = pty.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        self.port = os.ttyname(self.slave)

    def received(self) -> bytes:
        """What was written since the last call."""
        try:
            return os.read(self.master, 1 << 16)
        except BlockingIOError:
            return b""

    @property
    def waiting(self) -> int:
        """How many bytes the program could read: a pseudo-terminal hands them over in its own time."""
        (count,) = struct.unpack("i", fcntl.ioctl(self.slave, termios.FIONREAD, bytes(4)))
        return int(count)

    def close(self) -> None:
        os.close(self.master)
        os.close(self.slave)
