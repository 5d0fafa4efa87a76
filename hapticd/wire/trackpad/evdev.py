"""Reports of any Linux multitouch device: the kernel's input events, protocol B (slots) and A (anonymous contacts).

A report is what one read of /dev/input/event* gives up to its SYN_REPORT: `struct input_event` of a 64-bit kernel, 24
bytes each, little-endian. Meaning of axes: the kernel's `Documentation/input/multi-touch-protocol.rst`. The kernel
sends what has changed, so the contacts are kept here; what was dropped is forgotten until the link tells all of it.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import Final

from ...values import AffineMap, Contact, TouchFrame
from .event_clock import EventClock
from .pad import Family, Layout, PadGeometry, RefusedError

EVENT: Final = struct.Struct("<qqHHi")  # seconds, microseconds, type, code, value
MAX_EVENTS: Final = 170  # of one report: ten axes of all contacts
MAX_CONTACTS: Final = 16

EV_SYN, EV_KEY, EV_ABS, EV_MSC = 0, 1, 3, 4
SYN_REPORT, SYN_MT_REPORT, SYN_DROPPED = 0, 2, 3
BTN_LEFT, MSC_TIMESTAMP = 0x110, 0x05
SLOT, TOUCH_MAJOR, TOUCH_MINOR, ORIENTATION = 0x2F, 0x30, 0x31, 0x34
POSITION_X, POSITION_Y, TOOL_TYPE, TRACKING_ID, PRESSURE, DISTANCE = 0x35, 0x36, 0x37, 0x39, 0x3A, 0x3B
FINGER = 0  # of TOOL_TYPE; others are pens, palms and dials
AXES: Final = (*(POSITION_X, POSITION_Y, TOUCH_MAJOR, TOUCH_MINOR, ORIENTATION, PRESSURE, DISTANCE), TOOL_TYPE)

_COUNTER = 1 << 32  # MSC_TIMESTAMP counts microseconds so far
_MOST_S = 1 << 33
_HOVERS, _TOUCHES = 0, 1  # a contact's `state`
_FARTHEST_MM: Final = 40.0  # between reports, of a contact without a number: 60 Hz at 2.4 m/s
_NUMBERS: Final = 1 << 16
_Axes = dict[int, int]
_RawPlace = tuple[int, int]


class InputEvents(Layout):
    """Decoder of a device's input events. Keeps its slots, at most MAX_CONTACTS; those beyond are not seen."""

    def __init__(self, geometry: PadGeometry, plate_from_pad: AffineMap) -> None:
        super().__init__(geometry, plate_from_pad)
        self._clock = EventClock()
        self._numbers = ContactNumbers(geometry)
        self.reset()

    @property
    def clock_steps(self) -> int:
        return self._clock.steps

    def reset(self) -> None:
        self._slots: dict[int, _Axes] = {}  # of protocol B, with TRACKING_ID while the contact is there
        self._slot = 0
        self._anonymous: list[_Axes] = []  # of protocol A, this report's
        self._begun: _Axes = {}  # of protocol A, the contact that the next SYN_MT_REPORT ends
        self._is_anonymous = self._is_dropped = self._button = False
        self._counter_us: int | None = None
        self._numbers.reset()
        self._clock.reset()

    def decode(self, report: bytes, t_host_ns: int) -> tuple[TouchFrame, ...]:
        """One frame for each SYN_REPORT but one that ends what the kernel dropped."""
        count, rest = divmod(len(report), EVENT.size)
        if rest != 0 or not 0 < count <= MAX_EVENTS:
            raise RefusedError("length")
        frames = []
        for second_s, microsecond_us, kind, code, value in EVENT.iter_unpack(report):
            if kind == EV_ABS:
                self._take(code, value)
            elif kind == EV_KEY and code == BTN_LEFT:
                self._button = value != 0
            elif kind == EV_MSC and code == MSC_TIMESTAMP:
                self._counter_us = value % _COUNTER
            elif kind == EV_SYN and code == SYN_MT_REPORT:
                self._end_anonymous()
            elif kind == EV_SYN and code == SYN_DROPPED:
                self._slots.clear()
                self._is_dropped = True
            elif kind == EV_SYN and code == SYN_REPORT:
                stamp_ns = min(max(second_s, 0), _MOST_S) * 1_000_000_000 + microsecond_us % 1_000_000 * 1000
                frames += self._end_report(stamp_ns, t_host_ns)
        return tuple(frames)

    def _take(self, code: int, value: int) -> None:
        """Take the value of an axis."""
        if code == SLOT:
            self._slot = value
        elif self._slot in range(MAX_CONTACTS):
            if code == TRACKING_ID:
                self._identify(value)
            elif code in AXES:
                self._begun[code] = value
                self._slots.setdefault(self._slot, {})[code] = value  # it may come before its id, or without change

    def _identify(self, tracking_id: int) -> None:
        self._begun[TRACKING_ID] = tracking_id
        axes = self._slots.setdefault(self._slot, {})
        if tracking_id < 0:
            axes.pop(TRACKING_ID, None)
        else:
            axes[TRACKING_ID] = tracking_id

    def _end_anonymous(self) -> None:
        self._is_anonymous = True
        if POSITION_X in self._begun and POSITION_Y in self._begun and len(self._anonymous) < MAX_CONTACTS:
            self._anonymous.append(self._begun)
        self._begun = {}

    def _end_report(self, stamp_ns: int, t_host_ns: int) -> list[TouchFrame]:
        there, counter_us, is_dropped = self._there(), self._counter_us, self._is_dropped
        self._begun, self._anonymous, self._counter_us, self._is_dropped = {}, [], None, False
        if is_dropped:
            return []
        contacts = tuple([self._contact(number, axes) for number, axes in there.items()])
        return [TouchFrame(self._clock.instant_ns(stamp_ns, counter_us, t_host_ns), contacts, self._button)]

    def _there(self) -> dict[int, _Axes]:
        """Return the axes of each contact that is there, by its number."""
        if not self._is_anonymous:
            whole = [axes for axes in self._slots.values() if {TRACKING_ID, POSITION_X, POSITION_Y} <= axes.keys()]
            return {axes[TRACKING_ID]: axes for axes in whole}
        numbered = {axes[TRACKING_ID]: axes for axes in self._anonymous if axes.get(TRACKING_ID, -1) >= 0}
        if len(numbered) == len(self._anonymous):
            return numbered
        places = [(axes[POSITION_X], axes[POSITION_Y]) for axes in self._anonymous]
        return dict(zip(self._numbers.of(places), self._anonymous, strict=True))

    def _contact(self, number: int, axes: _Axes) -> Contact:
        raw_x, raw_y = axes[POSITION_X], -axes[POSITION_Y]  # evdev's y points to the user
        x_mm, y_mm = self._plate_map.at(raw_x, raw_y)
        major_raw = max(axes.get(TOUCH_MAJOR, 0), 0)
        minor_raw = min(max(axes.get(TOUCH_MINOR, major_raw), 0), major_raw)
        quarter, most = self._geometry.quarter_turn_raw, self._geometry.pressure_max_raw
        if quarter == 0:  # an ellipse without a direction is taken for a disc
            major_raw = minor_raw = round(math.sqrt(major_raw * minor_raw))
        turned_rad = axes.get(ORIENTATION, 0) * math.pi / (2 * quarter) if quarter > 0 else 0.0
        angle_rad, major_mm, minor_mm = self._plate_map.axis(math.pi / 2 - turned_rad)
        pressure_frac = min(max(axes.get(PRESSURE, 0) / most, 0.0), 1.0) if most > 0 else 0.0
        is_lifted = self._is_anonymous and axes.get(PRESSURE, 1) <= 0  # as drivers of protocol A say it
        is_touching = axes.get(DISTANCE, 0) <= 0 and axes.get(TOOL_TYPE, FINGER) == FINGER and not is_lifted
        return Contact(
            number, x_mm, y_mm, major_raw * major_mm, minor_raw * minor_mm, angle_rad,
            pressure_frac, is_touching, _TOUCHES if is_touching else _HOVERS, raw_x, raw_y,
        )  # fmt: skip


class ContactNumbers:
    """Numbers for contacts of a device that gives none: each keeps that of the nearest one of the report before.

    `core.touch.fingers` judges by how fingers move whether a number can be right.
    """

    def __init__(self, geometry: PadGeometry) -> None:
        self._units_x, self._units_y = geometry.units_per_mm
        self.reset()

    def reset(self) -> None:
        self._last: dict[int, _RawPlace] = {}
        self._next = 0

    def of(self, places: Sequence[_RawPlace]) -> list[int]:
        """Return a number for each place (raw units)."""
        distances = sorted(
            (distance_mm, number, index)
            for number, before in self._last.items()
            for index, place in enumerate(places)
            if (distance_mm := self._distance_mm(before, place)) <= _FARTHEST_MM
        )
        found: dict[int, int] = {}
        for _, number, index in distances:
            if index not in found and number not in found.values():
                found[index] = number
        for index in range(len(places)):
            if index not in found:
                found[index] = self._unused()
        self._last = {found[index]: place for index, place in enumerate(places)}
        return [found[index] for index in range(len(places))]

    def _unused(self) -> int:
        """Return a number that no contact has had for long: there are many more numbers than contacts."""
        self._next = (self._next + 1) % _NUMBERS
        return self._next

    def _distance_mm(self, one: _RawPlace, other: _RawPlace) -> float:
        return math.hypot((one[0] - other[0]) / self._units_x, (one[1] - other[1]) / self._units_y)


FAMILY: Final[Family] = Family((), {"evdev": InputEvents})
