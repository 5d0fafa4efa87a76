"""TCP ports for servers that need them by number."""

from __future__ import annotations

import os
import socket
from contextlib import ExitStack

FIRST, LAST = 20000, 32000  # below those that the kernel gives out
COUNT = 3  # a daemon's: targets, telemetry, control


def free_ports() -> int:
    """The first of three consecutive free ports. Processes at the same time begin at different ones."""
    for n in range((LAST - FIRST) // COUNT):
        port = FIRST + COUNT * (os.getpid() + n) % (LAST - FIRST)
        try:
            with ExitStack() as taken:
                for offset in range(COUNT):
                    taken.enter_context(socket.socket()).bind(("127.0.0.1", port + offset))
            return port
        except OSError:
            continue
    raise AssertionError("no ports are free")
