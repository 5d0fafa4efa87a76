"""A touchscreen, made by /dev/uinput: what is written to it goes through the kernel's whole input layer.

Layouts: the kernel's `include/uapi/linux/uinput.h`.
"""

from __future__ import annotations

import fcntl
import os
import struct

from kernel import ABS, ABS_TRACKING_ID, SLOTS

EV_SYN, EV_KEY, EV_ABS = 0, 1, 3
ABS_SLOT, BTN_TOUCH, INPUT_PROP_DIRECT = 0x2F, 0x14A, 1
DEV_CREATE, DEV_DESTROY = 0x5501, 0x5502
SETUP = struct.Struct("<4H80sI")
ABS_SETUP = struct.Struct("<H2x6i")
EVENT = struct.Struct("@llHHi")
RANGES = {  # lowest, highest, units per mm
    "x": (0, 3440, 10), "y": (0, 1940, 20), "major": (0, 400, 0), "minor": (0, 400, 0),
    "orientation": (0, 90, 0), "pressure": (0, 255, 0),
}  # fmt: skip


class Touchscreen:
    """Plugged in from the construction to `unplug`."""

    def __init__(self, name: str, x_high: int = RANGES["x"][1]) -> None:
        self._fd = os.open("/dev/uinput", os.O_WRONLY)
        for kind in (EV_SYN, EV_KEY, EV_ABS):
            fcntl.ioctl(self._fd, _write_code(100, 4), kind)
        fcntl.ioctl(self._fd, _write_code(101, 4), BTN_TOUCH)
        fcntl.ioctl(self._fd, _write_code(110, 4), INPUT_PROP_DIRECT)
        ranges = {ABS[axis]: limits for axis, limits in RANGES.items()}
        ranges |= {ABS["x"]: (0, x_high, 10), ABS_SLOT: (0, SLOTS - 1, 0), ABS_TRACKING_ID: (0, 65535, 0)}
        for code, (low, high, resolution) in ranges.items():
            fcntl.ioctl(self._fd, _write_code(103, 4), code)
            fcntl.ioctl(self._fd, _write_code(4, ABS_SETUP.size), ABS_SETUP.pack(code, 0, low, high, 0, 0, resolution))
        fcntl.ioctl(self._fd, _write_code(3, SETUP.size), SETUP.pack(3, 0x1234, 0x5678, 1, name.encode(), 0))
        fcntl.ioctl(self._fd, DEV_CREATE)

    def send(self, contacts: dict[int, dict[str, int] | None]) -> None:
        """One report: by slot the axes of a contact that is there, `id` that of one that lands; None lifts it."""
        events = []
        for slot, axes in contacts.items():
            events.append((EV_ABS, ABS_SLOT, slot))
            if axes is None:
                events.append((EV_ABS, ABS_TRACKING_ID, -1))
            else:
                events += [(EV_ABS, (ABS | {"id": ABS_TRACKING_ID})[name], value) for name, value in axes.items()]
        os.write(self._fd, b"".join(EVENT.pack(0, 0, *event) for event in [*events, (EV_SYN, 0, 0)]))

    def unplug(self) -> None:
        fcntl.ioctl(self._fd, DEV_DESTROY)
        os.close(self._fd)


def _write_code(number: int, size: int) -> int:
    return 1 << 30 | size << 16 | ord("U") << 8 | number
