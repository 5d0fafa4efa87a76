"""A touchscreen, made by /dev/uinput: what is written to it goes through the kernel's whole input layer.

Layouts: the kernel's `include/uapi/linux/uinput.h`.
"""

from __future__ import annotations

import fcntl
import os
import struct

EV_SYN, EV_KEY, EV_ABS = 0, 1, 3
BTN_TOUCH, INPUT_PROP_DIRECT = 0x14A, 1
DEV_CREATE, DEV_DESTROY = 0x5501, 0x5502
SETUP = struct.Struct("<4H80sI")
ABS_SETUP = struct.Struct("<H2x6i")
EVENT = struct.Struct("@llHHi")
SLOT, TRACKING_ID, X, Y = 0x2F, 0x39, 0x35, 0x36
UNITS_PER_MM, WIDTH_MM, HEIGHT_MM = 10, 344, 97
RANGES = {SLOT: (9, 0), TRACKING_ID: (65535, 0)} | {  # the highest value, units per mm
    X: (WIDTH_MM * UNITS_PER_MM, UNITS_PER_MM),
    Y: (HEIGHT_MM * UNITS_PER_MM, UNITS_PER_MM),
}


class Touchscreen:
    """Plugged in from the construction to `unplug`."""

    def __init__(self, name: str) -> None:
        self._fd = os.open("/dev/uinput", os.O_WRONLY)
        for number, value in ((100, EV_SYN), (100, EV_KEY), (100, EV_ABS), (101, BTN_TOUCH), (110, INPUT_PROP_DIRECT)):
            fcntl.ioctl(self._fd, _write_code(number, 4), value)
        for code, (high, resolution) in RANGES.items():
            fcntl.ioctl(self._fd, _write_code(103, 4), code)
            fcntl.ioctl(self._fd, _write_code(4, ABS_SETUP.size), ABS_SETUP.pack(code, 0, 0, high, 0, 0, resolution))
        fcntl.ioctl(self._fd, _write_code(3, SETUP.size), SETUP.pack(3, 0x1234, 0x5678, 1, name.encode(), 0))
        fcntl.ioctl(self._fd, DEV_CREATE)

    def touch(self, places_mm: list[tuple[float, float]], frame: int) -> None:
        """Fingers by slot. The kernel says nothing of one that does not move at all, so they tremble."""
        events = []
        for slot, (x_mm, y_mm) in enumerate(places_mm):
            x = round((WIDTH_MM / 2 + x_mm) * UNITS_PER_MM) + frame % 2
            y = round((HEIGHT_MM / 2 - y_mm) * UNITS_PER_MM)
            events += [(EV_ABS, SLOT, slot), (EV_ABS, TRACKING_ID, 1 + slot), (EV_ABS, X, x), (EV_ABS, Y, y)]
        os.write(self._fd, b"".join(EVENT.pack(0, 0, *event) for event in [*events, (EV_SYN, 0, 0)]))

    def unplug(self) -> None:
        fcntl.ioctl(self._fd, DEV_DESTROY)
        os.close(self._fd)


def _write_code(number: int, size: int) -> int:
    return 1 << 30 | size << 16 | ord("U") << 8 | number
