"""CPU wake-up latency: keep processors out of sleep states while fingers are down.

A processor that slept since the last report wakes late and with cold caches: a pass then takes half as long again or
more. Linux bounds the wake-up latency while a process holds `/dev/cpu_dma_latency` open with a value written
(`Documentation/power/pm_qos_interface.rst`). It costs heat, so the bound ends 2 s after the last touch.
"""

from __future__ import annotations

import contextlib
import os
import struct
from pathlib import Path

LATENCY_FILE = Path("/dev/cpu_dma_latency")
LINGER_NS = 2_000_000_000  # the next stroke usually follows within this time

_NO_SLEEP_US, _UNBOUNDED_US = 0, 2_000_000_000  # the second is the kernel's default


class CpuLatencyHold:
    """Holds `cpu_dma_latency` while fingers are down; inactive before the first touch.

    The constructor raises OSError where this user may not open the file.
    """

    def __init__(self, file: Path) -> None:
        self._fd: int | None = os.open(file, os.O_WRONLY | os.O_CLOEXEC)
        self._is_held = False
        self._t_touched_ns = 0

    def look(self, is_touched: bool, t_now_ns: int) -> None:
        """Request or release the latency bound for the touch state at `t_now_ns`."""
        if is_touched:
            self._t_touched_ns = t_now_ns
            if not self._is_held:
                self._write(True)
        elif self._is_held and t_now_ns - self._t_touched_ns >= LINGER_NS:
            self._write(False)

    def close(self) -> None:
        """Release the bound; the kernel does so too when the process ends. Safe to call twice."""
        if self._fd is not None:
            os.close(self._fd)
            self._fd = None

    def _write(self, is_held: bool) -> None:
        self._is_held = is_held
        if self._fd is None:
            return
        with contextlib.suppress(OSError):  # without the bound only latency suffers
            os.write(self._fd, struct.pack("=i", _NO_SLEEP_US if is_held else _UNBOUNDED_US))
