"""Apple trackpad reports to TouchFrames: bytes in, values out, no I/O.

Layouts, ranges and the meaning of states are those of the Linux driver `drivers/hid/hid-magicmouse.c`: report 0x02
(Magic Trackpad 2 and USB-C over USB), 0x31 (the same over Bluetooth) and 0x28, alone or two in a 0xF7 (Magic
Trackpad 1). `tests/data/trackpad-golden.jsonl` holds what that driver itself makes of 121 reports.

On USB, bytes 8.. of a report are the Bluetooth report. A contact record is 9 bytes; its first four, little-endian,
hold x (13 bits, signed), y (13 bits, signed, up) and, not on the Magic Trackpad 1, finger (3) and state (3).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass

from ..values import AffineMap, Contact, TouchFrame

__all__ = ["GEOMETRY", "MODELS", "Contact", "Decoder", "PadGeometry", "TouchFrame"]

RECORD = struct.Struct("<I5B")  # position and state, major, minor, and three bytes that differ between the models
MAX_RECORDS = 15
STAMP_WRAP_MS = 1 << 21

_USB, _BLUETOOTH, _MT1, _MT1_PAIR, _MOUSE = 0x02, 0x31, 0x28, 0xF7, 0x02
_MOUSE_LENGTHS = range(3, 10)  # what a pad sends before the multitouch enable, or after losing it
_MT1_TIMEOUT_NS = 100_000_000  # nine frames: an MT1 contact that is not mentioned for so long has gone
_MT1_PERIOD_NS = 11_250_000  # as the later models' frames; a pair's first frame waited for so long
_STEP_NS = 2_000_000_000  # beyond the 0.7 s that 63 reports in the kernel's ring can be late
_BACKWARDS_MS = 100
_DRIFT = 1000  # one part in a thousand: no quartz is that wrong
_CENTRED = AffineMap()


@dataclass(frozen=True, slots=True)
class PadGeometry:
    """The range of positions a pad declares (raw units, y up) and the size in mm that the kernel gives it."""

    x_min_raw: int
    x_max_raw: int
    y_min_raw: int
    y_max_raw: int
    width_mm: float
    height_mm: float

    @property
    def units_per_mm(self) -> tuple[float, float]:
        """Raw units per mm along x and y."""
        return (self.x_max_raw - self.x_min_raw) / self.width_mm, (self.y_max_raw - self.y_min_raw) / self.height_mm

    @property
    def centre_raw(self) -> tuple[float, float]:
        """The raw position that is pad (0, 0) mm: the middle of the declared range."""
        return (self.x_min_raw + self.x_max_raw) / 2, (self.y_min_raw + self.y_max_raw) / 2


_PAD_1 = PadGeometry(-2909, 3167, -2565, 2456, 130.0, 110.0)
_PAD_2 = PadGeometry(-3678, 3934, -2587, 2478, 160.0, 114.9)

GEOMETRY = {"mt1": _PAD_1, "mt2-usb": _PAD_2, "mt2-bt": _PAD_2, "usbc-usb": _PAD_2, "usbc-bt": _PAD_2}
MODELS = tuple(GEOMETRY)


class Decoder:
    """Reports of one trackpad to TouchFrames in the plate frame.

    `decode` takes whatever bytes come: what is not a whole multitouch report gives no frame and is counted by
    reason, and nothing raises. `ValueError` from the constructor if the model is unknown.

    Every record of a report is in the frame; `touching` says which press the glass (Magic Trackpad 2: state 4 or 5,
    Magic Trackpad 1: any but 0). A contact missing from a Magic Trackpad 2 frame is gone. On the Magic Trackpad 1
    it stays, where it was last seen, until its state is 0 or nothing was heard of it for 100 ms.

    `angle_rad` is in [0, pi). Lengths of the contact ellipse follow the kernel (raw byte x 4 in position units);
    their scale is undocumented. `pressure_frac` is raw / 253, on the Magic Trackpad 1 contact size / 63.
    """

    def __init__(self, model: str, plate_from_pad: AffineMap = _CENTRED) -> None:
        if model not in GEOMETRY:
            raise ValueError(f"unknown trackpad model {model!r}: use one of {', '.join(MODELS)}")
        self.model = model
        self._refused = dict.fromkeys(("foreign", "length", "duplicate_id", "mouse"), 0)
        self._frames = 0
        self._needs_enable = False
        self._layout: _Mt1Layout | _Mt2Layout
        if model == "mt1":
            self._layout = _Mt1Layout(_PlateMap(GEOMETRY[model], plate_from_pad, orientations=64))
        else:
            plate_map = _PlateMap(GEOMETRY[model], plate_from_pad, orientations=8)
            self._layout = _Mt2Layout(plate_map, usb=model.endswith("-usb"))

    @property
    def needs_enable(self) -> bool:
        """The pad speaks as a mouse: it lost, or never got, the multitouch enable. Cleared by the next touch frame."""
        return self._needs_enable

    @property
    def counters(self) -> dict[str, int]:
        """Since the decoder was made: frames given, reports refused by reason, steps of the device's clock."""
        return {"frames": self._frames, **self._refused, "clock_steps": self._layout.clock_steps}

    def reset(self) -> None:
        """Forget contacts and clock, as after a reconnect. Counters stay."""
        self._needs_enable = False
        self._layout.reset()

    def decode(self, report: bytes, t_host_ns: int) -> tuple[TouchFrame, ...]:
        """The frames of one report (report id first, as hidraw gives it): one, two from a 0xF7, none if refused.

        `t_ns` of a frame is the device's millisecond stamp, unwrapped and anchored to the host time of the first
        report; on the Magic Trackpad 1, whose stamp is not understood, it is `t_host_ns`, less one period for the
        first of a pair.
        """
        try:
            frames = self._layout.decode(report, t_host_ns)
        except _RefusedError as refused:
            is_mouse = len(report) in _MOUSE_LENGTHS and report[0] == _MOUSE
            self._needs_enable = self._needs_enable or is_mouse
            self._refused["mouse" if is_mouse else refused.reason] += 1
            return ()
        self._needs_enable = False
        self._frames += len(frames)
        return frames


class _RefusedError(Exception):
    """Not a touch report, for `reason`. Never leaves this module."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


class _Mt2Layout:
    """Reports 0x31 and, behind an eight-byte prefix, 0x02. No state but the clock."""

    def __init__(self, plate_map: _PlateMap, *, usb: bool) -> None:
        self._map = plate_map
        self._start = 8 if usb else 0
        self._report_id = _USB if usb else _BLUETOOTH
        self._clock = _DeviceClock()

    @property
    def clock_steps(self) -> int:
        return self._clock.steps

    def reset(self) -> None:
        self._clock.reset()

    def decode(self, report: bytes, t_host_ns: int) -> tuple[TouchFrame, ...]:
        start = self._start
        records = _records(report, self._report_id, start + 4)
        if report[start] != _BLUETOOTH:
            raise _RefusedError("foreign")
        contacts = tuple([self._contact(record) for record in records])
        _require_distinct_ids(contacts)
        stamp_ms = report[start + 1] >> 3 | report[start + 2] << 5 | report[start + 3] << 13
        return (TouchFrame(self._clock.unwrap(stamp_ms, t_host_ns), contacts, report[1] & 1 == 1),)

    def _contact(self, record: tuple[int, ...]) -> Contact:
        word, major, minor, _size, pressure, last = record
        x_mm, y_mm, raw_x, raw_y = self._map.position(word)
        angle_rad, major_mm, minor_mm = self._map.axes[last >> 5]
        state = word >> 29
        return Contact(
            last & 15, x_mm, y_mm, major * major_mm, minor * minor_mm, angle_rad,
            pressure / 253 if pressure < 253 else 1.0, state in (4, 5), state, raw_x, raw_y,
        )  # fmt: skip


class _Mt1Layout:
    """Report 0x28 and pairs of it in 0xF7. Remembers the contacts: only state 0 ends one."""

    clock_steps = 0

    def __init__(self, plate_map: _PlateMap) -> None:
        self._map = plate_map
        self._down: dict[int, tuple[Contact, int]] = {}  # by id: the contact and when it was last mentioned

    def reset(self) -> None:
        self._down.clear()

    def decode(self, report: bytes, t_host_ns: int) -> tuple[TouchFrame, ...]:
        parsed = [self._parse(part) for part in _mt1_parts(report)]  # the whole report is sound before any is taken
        first_ns = t_host_ns - _MT1_PERIOD_NS * (len(parsed) - 1)
        return tuple(
            TouchFrame(first_ns + index * _MT1_PERIOD_NS, self._merge(seen, t_host_ns), button)
            for index, (seen, button) in enumerate(parsed)
        )

    def _parse(self, part: bytes) -> tuple[tuple[Contact, ...], bool]:
        contacts = tuple([self._contact(record) for record in _records(part, _MT1, 4)])
        _require_distinct_ids(contacts)
        return contacts, part[1] & 1 == 1

    def _merge(self, seen: tuple[Contact, ...], t_host_ns: int) -> tuple[Contact, ...]:
        for contact in seen:
            self._down.pop(contact.contact_id, None)
        self._down = {i: kept for i, kept in self._down.items() if t_host_ns - kept[1] <= _MT1_TIMEOUT_NS}
        absent = tuple(contact for contact, _ in self._down.values())
        self._down.update((contact.contact_id, (contact, t_host_ns)) for contact in seen if contact.touching)
        return seen + absent

    def _contact(self, record: tuple[int, ...]) -> Contact:
        word, major, minor, size_and_id, id_and_angle, last = record
        x_mm, y_mm, raw_x, raw_y = self._map.position(word)
        angle_rad, major_mm, minor_mm = self._map.axes[id_and_angle >> 2]
        state = last >> 4
        return Contact(
            (id_and_angle & 3) << 2 | size_and_id >> 6, x_mm, y_mm, major * major_mm, minor * minor_mm, angle_rad,
            (size_and_id & 63) / 63, state != 0, state, raw_x, raw_y,
        )  # fmt: skip


def _mt1_parts(report: bytes) -> tuple[bytes, ...]:
    """The 0x28 frames of a report: a 0xF7 holds two, the first one's length before it."""
    if len(report) < 2 or report[0] != _MT1_PAIR:
        return (report,)
    end = 2 + report[1]
    return report[2:end], report[end:]


def _records(report: bytes, report_id: int, header_bytes: int) -> Iterator[tuple[int, ...]]:
    if not report or report[0] != report_id:
        raise _RefusedError("foreign" if report else "length")
    count, rest = divmod(len(report) - header_bytes, RECORD.size)
    if rest != 0 or not 0 <= count <= MAX_RECORDS:
        raise _RefusedError("length")
    return RECORD.iter_unpack(report[header_bytes:])


def _require_distinct_ids(contacts: tuple[Contact, ...]) -> None:
    """A pad never gives one id twice in a frame: such a report is torn."""
    if len({contact.contact_id for contact in contacts}) != len(contacts):
        raise _RefusedError("duplicate_id")


class _PlateMap:
    """Raw units to plate mm in one step, and for each orientation code the ellipse's angle and mm per raw count.

    The driver's orientation (its codes negated) turns clockwise from +y by 180 degrees over all codes; anticlockwise
    from +x that is code x 180 degrees / codes. Under a map that shears, the ellipse is taken along the mapped axis.
    """

    def __init__(self, geometry: PadGeometry, affine: AffineMap, *, orientations: int) -> None:
        (units_x, units_y), (centre_x, centre_y) = geometry.units_per_mm, geometry.centre_raw
        self._x_x, self._x_y = affine.xx / units_x, affine.xy / units_y
        self._y_x, self._y_y = affine.yx / units_x, affine.yy / units_y
        self._x_0 = affine.offset_x_mm - self._x_x * centre_x - self._x_y * centre_y
        self._y_0 = affine.offset_y_mm - self._y_x * centre_x - self._y_y * centre_y
        mm_per_count = 4 / ((units_x + units_y) / 2)
        angles_rad = (code * math.pi / orientations for code in range(orientations))
        self.axes = tuple(_mapped_axis(affine, angle_rad, mm_per_count) for angle_rad in angles_rad)

    def position(self, word: int) -> tuple[float, float, int, int]:
        """x and y on the plate, and as the record's first word has them: two 13-bit two's complement numbers."""
        raw_x, raw_y = ((word & 0x1FFF) ^ 0x1000) - 0x1000, ((word >> 13 & 0x1FFF) ^ 0x1000) - 0x1000
        return (
            self._x_x * raw_x + self._x_y * raw_y + self._x_0,
            self._y_x * raw_x + self._y_y * raw_y + self._y_0,
            raw_x,
            raw_y,
        )


def _mapped_axis(affine: AffineMap, angle_rad: float, mm_per_count: float) -> tuple[float, float, float]:
    """Angle on the plate, and mm per raw count along the major axis and along the minor."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    major_x, major_y = affine.xx * cos + affine.xy * sin, affine.yx * cos + affine.yy * sin
    minor_x, minor_y = affine.xy * cos - affine.xx * sin, affine.yy * cos - affine.yx * sin
    folded = math.atan2(major_y, major_x) % math.pi
    return (
        folded if folded < math.pi else 0.0,  # a tiny negative angle rounds up to pi itself
        math.hypot(major_x, major_y) * mm_per_count,
        math.hypot(minor_x, minor_y) * mm_per_count,
    )


class _DeviceClock:
    """A 21-bit millisecond counter, unwrapped and laid on the host's axis.

    The host's clock chooses the number of wraps since the last report, so an idle gap may last for weeks. The
    distance between the two clocks is followed as far as a quartz can drift; where the counter leaves it by more
    than a queue can explain, or runs backwards, it was stopped or restarted: the stamp is anchored anew.
    """

    def __init__(self) -> None:
        self.steps = 0
        self.reset()

    def reset(self) -> None:
        self._stamp_ms: int | None = None
        self._t_ns = self._t_host_ns = self._ahead_ns = 0

    def unwrap(self, stamp_ms: int, t_host_ns: int) -> int:
        """The instant of a stamp, in ns. The first one after a reset is `t_host_ns` itself."""
        if self._stamp_ms is None or not self._follow(stamp_ms - self._stamp_ms, t_host_ns):
            self._t_ns, self._ahead_ns = t_host_ns, 0
        self._stamp_ms, self._t_host_ns = stamp_ms, t_host_ns
        return self._t_ns

    def _follow(self, step_ms: int, t_host_ns: int) -> bool:
        """Move on by `step_ms` and as many wraps as bring it nearest to the host's clock; False if that is a step."""
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
