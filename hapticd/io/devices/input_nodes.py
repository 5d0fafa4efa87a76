"""Linux input devices: which of them report touches, and what they declare of their axes.

By the `evdev` package, an extra (`touchscreen`), which only an open node needs; it lacks the stamps' clock and the
slots, which are ioctls of the kernel's `include/uapi/linux/input.h`.
"""

from __future__ import annotations

import array
import contextlib
import errno
import fcntl
import os
import struct
import time
from collections.abc import Iterable, Iterator, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from ...errors import TrackpadError, missing_library
from ...wire.trackpad import Pad, PadGeometry, evdev

FOLDER = Path("/dev/input")
_MOST_SLOTS = 64
_OF_PAD = (evdev.POSITION_X, evdev.POSITION_Y, evdev.PRESSURE, evdev.ORIENTATION)
_LONGEST_MM = 5000.0
_UNKNOWN_NS = 8_333_333  # the period of most touchscreens, until stamps show it


def require_package() -> None:
    """Raise HapticdError where the `evdev` package is missing."""
    if find_spec("evdev") is None:
        raise missing_library("A touchscreen is read by the evdev package", "touchscreen")


def _code(direction: int, number: int, size_bytes: int) -> int:
    return direction << 30 | size_bytes << 16 | ord("E") << 8 | number


class Axis(NamedTuple):
    """An axis as a device declares it, and its value now; `resolution` is in units per mm, 0: unknown."""

    present: int
    low: int
    high: int
    resolution: int


class InputNode:
    """One open node. Raises OSError where it cannot be opened, or was unplugged."""

    def __init__(self, path: Path) -> None:
        from evdev import InputDevice

        self.path = path
        try:
            self._device = InputDevice(str(path), readonly=True)
        except UnicodeDecodeError:  # of its name
            raise OSError(errno.EILSEQ, os.strerror(errno.EILSEQ)) from None
        self.fd = self._device.fd
        self._declared = self._device.capabilities(absinfo=False).get(evdev.EV_ABS, [])

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._device.close()

    @property
    def name(self) -> str:
        """Name that the device reports."""
        return "".join(one for one in self._device.name if one.isprintable())

    def axis(self, code: int) -> Axis | None:
        """Return an axis, None if the device has no such."""
        if code not in self._declared:
            return None
        info = self._device.absinfo(code)
        return Axis(info.value, info.min, info.max, info.resolution)

    def claim(self) -> None:
        """Take the device for this process alone, and have its events stamped by the monotonic clock."""
        fcntl.ioctl(self.fd, _code(1, 0xA0, 4), struct.pack("i", time.CLOCK_MONOTONIC))
        self._device.grab()

    def slots(self, count: int) -> dict[int, list[int]]:
        """Return the present values of a contact's axes in each slot, by axis; those that the device has."""
        values = {}
        for code in (evdev.TRACKING_ID, *evdev.AXES):
            if self.axis(code) is not None:
                asked = array.array("i", [code, *[0] * count])
                fcntl.ioctl(self.fd, _code(2, 0x0A, asked.itemsize * len(asked)), asked)
                values[code] = asked[1:].tolist()
        return values

    def slot_count(self) -> int:
        """Return how many slots it has; 0: it speaks protocol A."""
        slot = self.axis(evdev.SLOT)
        return 0 if slot is None else min(max(slot.high + 1, 0), _MOST_SLOTS)


def find_nodes(device: str, folder: Path = FOLDER) -> Iterator[InputNode]:
    """Yield the open nodes of multitouch devices whose path or name is `device`; empty: of all. The caller closes them.

    A node that cannot be opened is left out, unless its path is `device`: then OSError is raised.
    """
    if device.startswith("/"):
        paths = [Path(device)]
    else:
        paths = sorted(folder.glob("event*"), key=lambda path: (len(path.name), path.name))
    for path in paths:
        try:
            node = InputNode(path)
        except OSError:
            if device.startswith("/"):
                raise
            continue
        if _is_asked_for(node, device):
            yield node
        else:
            node.close()


def _is_asked_for(node: InputNode, device: str) -> bool:
    try:
        has_touches = None not in (node.axis(evdev.POSITION_X), node.axis(evdev.POSITION_Y))
        return has_touches and (device == "" or device.startswith("/") or node.name == device)
    except OSError:
        return False  # unplugged meanwhile, or no input device


def describe(node: InputNode, size_mm: tuple[float, ...]) -> Pad:
    """Return the pad that a node is, as `described`. Raises TrackpadError, OSError."""
    axes = {code: axis for code in _OF_PAD if (axis := node.axis(code)) is not None}
    return described(node.name or node.path.name, f"at {node.path}", axes, size_mm)


def described(name: str, where: str, axes: Mapping[int, Axis], size_mm: tuple[float, ...]) -> Pad:
    """Return the pad that a device with these axes is. `size_mm` is what the user says of its range of positions;
    empty: the device's resolution.

    Raises TrackpadError where neither gives millimetres.
    """
    x, y = axes.get(evdev.POSITION_X), axes.get(evdev.POSITION_Y)
    if x is None or y is None or not (x.low < x.high and y.low < y.high):
        raise TrackpadError(f"{name} {where} declares no range of positions: choose another device.")
    if size_mm:
        width_mm, height_mm = size_mm
    elif x.resolution > 0 and y.resolution > 0:
        width_mm, height_mm = (x.high - x.low) / x.resolution, (y.high - y.low) / y.resolution
    else:
        raise TrackpadError(
            f"{name} {where} does not say how large it is: measure its active area, and set trackpad.size_mm."
        )
    if not (1.0 <= width_mm <= _LONGEST_MM and 1.0 <= height_mm <= _LONGEST_MM):
        raise TrackpadError(
            f"{name} {where} says it is {width_mm:g} x {height_mm:g} mm: set trackpad.size_mm to its true size."
        )
    pressure, turned = axes.get(evdev.PRESSURE), axes.get(evdev.ORIENTATION)
    return Pad(
        model="evdev",
        name=name,
        layout="evdev",
        geometry=PadGeometry(
            *(x.low, x.high, -y.high, -y.low, width_mm, height_mm),
            pressure_max_raw=max(pressure.high, 0) if pressure is not None else 0,
            quarter_turn_raw=max(turned.high, 0) if turned is not None else 0,
        ),
        period_ns=_UNKNOWN_NS,
        source="evdev",
    )


def packed(t_ns: int, events: Iterable[tuple[int, int, int]]) -> bytes:
    """Return events (type, code, value) of one instant, as a 64-bit kernel writes them."""
    second_s, rest_ns = divmod(t_ns, 1_000_000_000)
    return b"".join([evdev.EVENT.pack(second_s, rest_ns // 1000, *event) for event in events])
