"""Reports of the Magic Trackpad 2 and USB-C: 0x31 over Bluetooth and, behind an eight-byte prefix, 0x02 over USB."""

from __future__ import annotations

from ...values import Contact, TouchFrame
from .device_clock import DeviceClock
from .geometry import PlateMap
from .records import RefusedError, records, require_distinct_ids

_USB, _BLUETOOTH = 0x02, 0x31


class MagicTrackpad2:
    """Decoder of these models' reports. Its only state is the device's clock."""

    def __init__(self, plate_map: PlateMap, *, usb: bool) -> None:
        self.plate_map = plate_map
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
        return (TouchFrame(self._clock.unwrap(stamp_ms, t_host_ns), contacts, report[1] & 1 == 1),)

    def _contact(self, record: tuple[int, ...]) -> Contact:
        word, major, minor, _size, pressure, last = record
        x_mm, y_mm, raw_x, raw_y = self.plate_map.position(word)
        angle_rad, major_mm, minor_mm = self.plate_map.axes[last >> 5]
        state = word >> 29
        return Contact(
            last & 15, x_mm, y_mm, major * major_mm, minor * minor_mm, angle_rad,
            pressure / 253 if pressure < 253 else 1.0, state in (4, 5), state, raw_x, raw_y,
        )  # fmt: skip
