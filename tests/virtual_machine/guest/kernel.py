"""What the kernel says of a pad: which driver has it, its nodes, and through evdev which contacts it sees.

Layouts: the kernel's `include/uapi/linux/input.h`. The state of an event node is read, not its events: hidraw hands a
report over after the driver has taken it, so whoever has read the report finds the driver's whole result.
"""

from __future__ import annotations

import fcntl
import os
import select
import struct
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

PATIENCE_S = 90.0  # for an emulated machine that others keep waiting
SLOTS = 16
BTN_MOUSE = 0x110
ABS = {"x": 0x35, "y": 0x36, "major": 0x30, "minor": 0x31, "orientation": 0x34, "pressure": 0x3A}
ABS_SLOT, ABS_TRACKING_ID = 0x2F, 0x39
ABSINFO = struct.Struct("<6i")  # value, minimum, maximum, fuzz, flat, resolution

Found = TypeVar("Found")


def wait_for(what: str, look: Callable[[], Found | None], every_s: float = 0.01) -> Found:
    """Poll until there is something; TimeoutError names what never came."""
    t_end_s = time.monotonic() + PATIENCE_S
    while not (found := look()):
        if time.monotonic() > t_end_s:
            raise TimeoutError(f"{what} did not come about in {PATIENCE_S:.0f} s")
        time.sleep(every_s)
    return found


@dataclass(frozen=True, slots=True)
class Node:
    """One HID interface: its hidraw device, the driver that has it, the event device of its touches if any."""

    hidraw: Path
    driver: str
    hid_id: str
    event: Path | None


def nodes() -> list[Node]:
    """All that there are, in the order of their names."""
    found = []
    for entry in sorted(Path("/sys/class/hidraw").iterdir()):
        device = (entry / "device").resolve()
        driver = device / "driver"
        events = sorted(device.glob("input/input*/event*"))
        event = Path("/dev/input") / events[0].name if events else None
        name = driver.resolve().name if driver.exists() else ""
        found.append(Node(Path("/dev") / entry.name, name, device.name.rpartition(".")[0], event))
    return found


def touch_node(hid_id: str) -> Node:
    """The node with these ids (such as 0005:004C:0265) whose touches the kernel takes, once it is whole."""

    def look() -> Node | None:
        return next((node for node in nodes() if node.hid_id == hid_id and node.event and node.event.exists()), None)

    return wait_for(f"an event device of {hid_id}", look)


class EventDevice:
    """The kernel's own multitouch state, slot by slot."""

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_RDWR)

    def close(self) -> None:
        os.close(self._fd)

    def ranges(self) -> dict[str, tuple[int, int, int]]:
        """Of each axis minimum, maximum and resolution. OSError if the device has it not."""
        infos = {name: self._absinfo(code) for name, code in ABS.items()}
        return {name: (low, high, resolution) for name, (_, low, high, _, _, resolution) in infos.items()}

    def without_fuzz(self) -> None:
        """Make the kernel say every change: by default it smooths small ones away."""
        for code in ABS.values():
            value, low, high, _, flat, resolution = self._absinfo(code)
            request = ABSINFO.pack(value, low, high, 0, flat, resolution)
            fcntl.ioctl(self._fd, _ioc(1, 0xC0 + code, ABSINFO.size), request)

    def contacts(self, names: Iterable[str] = tuple(ABS)) -> dict[int, dict[str, int]]:
        """By slot, which is the pad's contact id, the axes of every contact that is down."""
        tracking = self._slots(ABS_TRACKING_ID)
        axes = {name: self._slots(ABS[name]) for name in names}
        down = [slot for slot, tracking_id in enumerate(tracking) if tracking_id >= 0]
        return {slot: {name: values[slot] for name, values in axes.items()} for slot in down}

    def button(self) -> bool:
        keys = fcntl.ioctl(self._fd, _ioc(2, 0x18, 96), bytes(96))
        return bool(keys[BTN_MOUSE // 8] >> BTN_MOUSE % 8 & 1)

    def _absinfo(self, code: int) -> tuple[int, ...]:
        return ABSINFO.unpack(fcntl.ioctl(self._fd, _ioc(2, 0x40 + code, ABSINFO.size), bytes(ABSINFO.size)))

    def _slots(self, code: int) -> tuple[int, ...]:
        count = self._absinfo(ABS_SLOT)[2] + 1
        request = struct.pack("<i", code) + bytes(4 * count)
        return struct.unpack_from(f"<{count}i", fcntl.ioctl(self._fd, _ioc(2, 0x0A, len(request)), request), 4)


def _ioc(direction: int, number: int, size: int) -> int:
    return direction << 30 | size << 16 | ord("E") << 8 | number


class Hidraw:
    """A reader of its own of a hidraw node, in parallel with the kernel's driver and whoever else reads."""

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_RDWR)

    def close(self) -> None:
        os.close(self._fd)

    def read(self) -> bytes:
        """The next report. TimeoutError if none comes."""
        if not select.select([self._fd], [], [], PATIENCE_S)[0]:
            raise TimeoutError("hidraw gave no report")
        return os.read(self._fd, 4096)
