"""Processors that do not sleep while somebody touches.

A processor that slept since the last report wakes late and with cold caches (a virtual one may have been somebody
else's meanwhile): what a pass computes then takes half as long again or more. Linux keeps processors awake for whoever
holds `/dev/cpu_dma_latency` open and writes there how late they may wake (`Documentation/power/pm_qos_interface.rst`).
It costs heat, so it is asked for only while fingers are down, and for a moment after.
"""

from __future__ import annotations

import contextlib
import os
import struct
from pathlib import Path

LATENCY_FILE = Path("/dev/cpu_dma_latency")
LINGER_NS = 2_000_000_000  # the next stroke mostly follows

_NEVER_SLEEP_US, _SLEEP_AS_YOU_LIKE_US = 0, 2_000_000_000  # the second is what the kernel takes for no wish


class CpuLatencyHold:
    """A wish to the kernel, from the constructor to `close`; none before the first touch.

    The constructor raises OSError where this user may not have one.
    """

    def __init__(self, file: Path) -> None:
        self._fd: int | None = os.open(file, os.O_WRONLY | os.O_CLOEXEC)
        self._is_held = False
        self._t_touched_ns = 0

    def look(self, is_touched: bool, t_now_ns: int) -> None:
        """Keep all processors awake, or let them sleep, as it is wanted now."""
        if is_touched:
            self._t_touched_ns = t_now_ns
            if not self._is_held:
                self._wish(True)
        elif self._is_held and t_now_ns - self._t_touched_ns >= LINGER_NS:
            self._wish(False)

    def close(self) -> None:
        """Let them sleep; the kernel does it too when the process dies. Safe to call twice."""
        if self._fd is not None:
            os.close(self._fd)
            self._fd = None

    def _wish(self, is_held: bool) -> None:
        self._is_held = is_held
        if self._fd is None:
            return
        with contextlib.suppress(OSError):  # then they sleep, as they would without us
            os.write(self._fd, struct.pack("=i", _NEVER_SLEEP_US if is_held else _SLEEP_AS_YOU_LIKE_US))
