"""Recordings of Linux input devices by other programs: `libinput record` (YAML) and `evemu-record`.

Both hold what a device declares and every event with its time: a touchscreen that somebody else has. Of YAML only the
lines that `libinput record` writes are read; of a recording of several devices the first one with touches.
"""

from __future__ import annotations

import re
from typing import Final

from ...values import RawReport
from ...wire.trackpad import evdev
from .input_nodes import Axis

_NUMBER = r"(-?\d{1,10})"
_FIVE = " *, *".join([_NUMBER] * 5)
_KEY = re.compile(r" +([a-z_]+):(.*)")
_AXIS = re.compile(rf" +(\d{{1,3}}): *\[ *{_FIVE} *\]")
_EVENT = re.compile(rf" *- \[ *{_FIVE} *\]")
_EVEMU_AXIS = re.compile(rf"A: ([0-9a-f]{{1,3}}) {_NUMBER} {_NUMBER} {_NUMBER} {_NUMBER}(?: {_NUMBER})?")
_EVEMU_EVENT = re.compile(rf"E: (\d{{1,10}})\.(\d{{6}}) ([0-9a-f]{{1,4}}) ([0-9a-f]{{1,4}}) {_NUMBER}")
_POSITIONS: Final = {evdev.POSITION_X, evdev.POSITION_Y}
_MOST_AXES: Final = 64
_MOST_RAW: Final = 1 << 31
_MOST_SECONDS: Final = 1 << 32
_MOST_NAME: Final = 100

_Event = tuple[int, int, int, int, int]  # seconds, microseconds, type, code, value


def begins_one(line: str) -> bool:
    """Whether a file whose first line this is, is one of these recordings."""
    return line.startswith(("# libinput record", "# EVEMU", "N: "))


class InputRecording:
    """The touch device of a recording, `name` and `axes`, and its `reports`, whose times begin anywhere."""

    def __init__(self) -> None:
        self.name = ""
        self.axes: dict[int, Axis] = {}
        self.reports: list[RawReport] = []
        self._section = ""
        self._is_over = False  # the device with touches was read: what follows is of another
        self._events: list[_Event] = []

    def take(self, line: str) -> None:
        """Take the next line. Raises ValueError with what is wrong with it."""
        if self._is_over:
            return
        if event := _event(line):
            self._take_event(event)
        elif axis := _axis(line, is_yaml=self._section == "absinfo"):
            if not all(-_MOST_RAW <= value < _MOST_RAW for value in axis[1]):
                raise ValueError("the range of an axis does not fit in 32 bits")
            if len(self.axes) < _MOST_AXES:
                self.axes[axis[0]] = axis[1]
        elif line.startswith("- node:"):
            self._is_over = self.axes.keys() >= _POSITIONS
            if not self._is_over:
                self._forget()
        elif line.startswith("N: "):
            self.name = _printable(line[3:])
        elif key := _KEY.match(line):
            self._section = key[1]
            if key[1] == "name":
                self.name = _printable(key[2])

    def _forget(self) -> None:
        """Another device without touches."""
        self.axes.clear()
        self.reports.clear()
        self._events.clear()

    def _take_event(self, event: _Event) -> None:
        second_s, microsecond_us, kind, code, value = event
        if not (0 <= second_s < _MOST_SECONDS and 0 <= microsecond_us < 1_000_000):
            raise ValueError("its time must be seconds, and microseconds below a million")
        if not (0 <= kind <= 0xFFFF and 0 <= code <= 0xFFFF and -_MOST_RAW <= value < _MOST_RAW):
            raise ValueError("type and code of an event have 16 bits, its value 32")
        is_end = (kind, code) == (evdev.EV_SYN, evdev.SYN_REPORT)
        if is_end or len(self._events) < evdev.MAX_EVENTS - 1:  # no device has so many axes
            self._events.append(event)
        if is_end:
            t_ns = second_s * 1_000_000_000 + microsecond_us * 1000
            if self.reports and t_ns < self.reports[-1].t_host_ns:
                raise ValueError("its time is before that of the report above")
            self.reports.append(RawReport(t_ns, b"".join([evdev.EVENT.pack(*one) for one in self._events])))
            self._events.clear()


def _event(line: str) -> _Event | None:
    if found := _EVENT.match(line):
        second_s, microsecond_us, kind, code, value = map(int, found.groups())
        return second_s, microsecond_us, kind, code, value
    if found := _EVEMU_EVENT.match(line):
        return int(found[1]), int(found[2]), int(found[3], 16), int(found[4], 16), int(found[5])
    return None


def _axis(line: str, *, is_yaml: bool) -> tuple[int, Axis] | None:
    """Return the code of an axis and what the device declares of it: lowest, highest, fuzz, flat, resolution."""
    if found := _AXIS.match(line) if is_yaml else None:
        return int(found[1]), Axis(0, int(found[2]), int(found[3]), int(found[6]))
    if found := _EVEMU_AXIS.match(line):
        return int(found[1], 16), Axis(0, int(found[2]), int(found[3]), int(found[6] or 0))
    return None


def _printable(text: str) -> str:
    return "".join(one for one in text.strip().strip('"') if one.isprintable())[:_MOST_NAME]
