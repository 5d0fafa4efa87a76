"""Reports of the Magic Trackpad 2 and USB-C: 0x31 over Bluetooth and, behind an eight-byte prefix, 0x02 over USB."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Final

from ...values import AffineMap, Contact, TouchFrame
from .pad import (
    BLUETOOTH,
    USB,
    Family,
    HidIds,
    Layout,
    Pad,
    PadGeometry,
    RefusedError,
    records,
    require_distinct_ids,
)

STAMP_WRAP_MS: Final = 1 << 21
_USB, _BLUETOOTH = 0x02, 0x31
_STEP_NS = 2_000_000_000  # beyond the 0.7 s that 63 reports in the kernel's ring can be late
_BACKWARDS_MS = 100
_DRIFT = 1000  # one part in a thousand: no quartz is that wrong


class DeviceClock:
    """A 21-bit millisecond counter, unwrapped and mapped to host time.

    The host's clock determines the number of wraps since the last report, so an idle gap may last for weeks. The
    offset between the two clocks is tracked within the drift of a quartz. Where the counter deviates by more than a
    queue can explain, or runs backwards, it was stopped or restarted, and the next stamp is anchored to host time.
    """

    def __init__(self) -> None:
        self.steps = 0
        self.reset()

    def reset(self) -> None:
        self._stamp_ms: int | None = None
        self._t_ns = self._t_host_ns = self._ahead_ns = 0

    def unwrap(self, stamp_ms: int, t_host_ns: int) -> int:
        """Return the instant of a stamp, in ns. The first one after a reset is `t_host_ns` itself."""
        if self._stamp_ms is None or not self._follow(stamp_ms - self._stamp_ms, t_host_ns):
            self._t_ns, self._ahead_ns = t_host_ns, 0
        self._stamp_ms, self._t_host_ns = stamp_ms, t_host_ns
        return self._t_ns

    def _follow(self, step_ms: int, t_host_ns: int) -> bool:
        """Advance by `step_ms` and the number of wraps that fits host time best; False for a step of the clock."""
        elapsed_ns = t_host_ns - self._t_host_ns
        wraps = (elapsed_ns // 1_000_000 - step_ms + STAMP_WRAP_MS // 2) // STAMP_WRAP_MS
        step_ms += wraps * STAMP_WRAP_MS
        t_ns = self._t_ns + step_ms * 1_000_000
        drift_ns = t_ns - t_host_ns - self._ahead_ns
        slack_ns = max(elapsed_ns // _DRIFT, 0)
        if step_ms < -_BACKWARDS_MS or abs(drift_ns) > _STEP_NS + slack_ns:
            self.steps += 1
            return False
        self._t_ns = t_ns
        self._ahead_ns += min(max(drift_ns, -slack_ns), slack_ns)
        return True


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
