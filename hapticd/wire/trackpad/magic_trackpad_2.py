"""Reports of the Magic Trackpad 2 and USB-C: 0x31 over Bluetooth and, behind an eight-byte prefix, 0x02 over USB."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Final

from ...values import AffineMap, Contact, TouchFrame
from .device_clock import DeviceClock
from .geometry import PadGeometry
from .pad import BLUETOOTH, USB, Family, HidIds, Layout, Pad
from .records import RefusedError, records, require_distinct_ids

_USB, _BLUETOOTH = 0x02, 0x31


class MagicTrackpad2(Layout):
    """Decoder of these models' reports. Its only state is the device's clock."""

    def __init__(self, geometry: PadGeometry, plate_from_pad: AffineMap, *, usb: bool) -> None:
        super().__init__(geometry, plate_from_pad, orientations=8)
        self._start = 8 if usb else 0
        self._report_id = _USB if usb else _BLUETOOTH
        self._clock = DeviceClock()

    @property
    def clock_steps(self) -> int:
        return self._clock.steps

    def reset(self) -> None:
        self._clock.reset()

    def decode(self, report: bytes, t_host_ns: int) -> tuple[TouchFrame, ...]:
        start = self._start
        raw_records = records(report, self._report_id, start + 4)
        if report[start] != _BLUETOOTH:
            raise RefusedError("foreign")
        contacts = tuple([self._contact(record) for record in raw_records])
        require_distinct_ids(contacts)
        stamp_ms = report[start + 1] >> 3 | report[start + 2] << 5 | report[start + 3] << 13
        t_ns, is_pressed = self._clock.unwrap(stamp_ms, t_host_ns), report[1] & 1 == 1
        return (tuple.__new__(TouchFrame, (t_ns, contacts, is_pressed)),)

    def _contact(self, record: tuple[int, ...]) -> Contact:
        word, major, minor, _size, pressure, last = record
        x_mm, y_mm, raw_x, raw_y = self._plate_map.position(word)
        angle_rad, major_mm, minor_mm = self._plate_map.axes[last >> 5]
        state = word >> 29
        return tuple.__new__(Contact, (
            last & 15, x_mm, y_mm, major * major_mm, minor * minor_mm, angle_rad,
            pressure / 253 if pressure < 253 else 1.0, state in (4, 5), state, raw_x, raw_y,
        ))  # fmt: skip


_USB_PAD = Pad(
    model="mt2-usb",
    name="Magic Trackpad 2 on USB",
    layout="mt2-usb",
    geometry=PadGeometry(-3678, 3934, -2587, 2478, 160.0, 114.9),
    period_ns=11_250_000,
    ids=HidIds(USB, 0x05AC, 0x0265, interface=1),
    enable=b"\x02\x01",
)
_BLUETOOTH_PAD = replace(
    _USB_PAD,
    model="mt2-bt",
    name="Magic Trackpad 2 on Bluetooth",
    layout="mt2-bt",
    ids=HidIds(BLUETOOTH, 0x004C, 0x0265),
    enable=b"\xf1\x02\x01",
)
FAMILY: Final[Family] = Family(
    (
        replace(
            _USB_PAD,
            model="usbc-usb",
            name="Magic Trackpad (USB-C) on USB",
            ids=HidIds(USB, 0x05AC, 0x0324, interface=1),
        ),
        _USB_PAD,
        replace(
            _BLUETOOTH_PAD,
            model="usbc-bt",
            name="Magic Trackpad (USB-C) on Bluetooth",
            ids=HidIds(BLUETOOTH, 0x004C, 0x0324),
        ),
        _BLUETOOTH_PAD,
    ),
    {"mt2-usb": partial(MagicTrackpad2, usb=True), "mt2-bt": partial(MagicTrackpad2, usb=False)},
)
