"""Recordings of Linux input devices by other programs: `libinput record` (YAML), `evemu-record` and `evtest`.

They hold what a device declares and every event with its time: a touchscreen that somebody else has. Lines that none of
them writes are passed over; of a recording of several devices the first one with touches is read.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final

from ...errors import TrackpadError
from ...values import RawReport
from ...wire.trackpad import Pad, evdev
from .input_nodes import Axis, described

_NUMBER = r"(-?\d{1,10})"
_FIVE = " *, *".join([_NUMBER] * 5)
_KEY = re.compile(r" +([a-z_]+):(.*)")
_AXIS = re.compile(rf" +(\d{{1,3}}): *\[ *{_FIVE} *\]")
_EVEMU_AXIS = re.compile(rf" *A: ([0-9a-f]{{1,3}}) {_NUMBER} {_NUMBER} {_NUMBER} {_NUMBER}(?: {_NUMBER})?")
_EVTEST_CODE = re.compile(r" +Event (type|code) (\d{1,5}) ")
_EVTEST_LIMIT = re.compile(rf" +(Min|Max|Resolution) +{_NUMBER}$")
_NAME = re.compile(r" *(?:N: |Input device name: )(.*)")
_POSITIONS: Final = {evdev.POSITION_X, evdev.POSITION_Y}
_MOST_AXES: Final = 64
_MOST_RAW: Final = 1 << 31
_MOST_SECONDS: Final = 1 << 32
_MOST_NAME: Final = 100

_Event = tuple[int, int, int, int, int]  # seconds, microseconds, type, code, value
_Found = re.Match[str]


def _of_evtest(found: _Found) -> _Event:
    if found[6]:
        return int(found[1]), int(found[2]), evdev.EV_SYN, _EVTEST_SYN[found[6]], 0
    return int(found[1]), int(found[2]), int(found[3]), int(found[4]), int(found[5] or 0)


_EVTEST_SYN: Final = {"-": evdev.SYN_REPORT, "+": evdev.SYN_MT_REPORT, ">": evdev.SYN_DROPPED}
_EVENTS: Final[dict[str, tuple[re.Pattern[str], Callable[[_Found], _Event]]]] = {
    "libinput record": (
        re.compile(rf" *- \[ *{_FIVE} *\]"),
        lambda found: (int(found[1]), int(found[2]), int(found[3]), int(found[4]), int(found[5])),
    ),
    "evemu-record": (
        re.compile(rf" *E: (\d{{1,10}})\.(\d{{6}}) ([0-9a-f]{{1,4}}) ([0-9a-f]{{1,4}}) {_NUMBER}"),
        lambda found: (int(found[1]), int(found[2]), int(found[3], 16), int(found[4], 16), int(found[5])),
    ),
    "evtest": (
        re.compile(
            r" *Event: time (\d{1,10})\.(\d{6}), "
            rf"(?:type (\d{{1,5}}) [^,]*, code (\d{{1,5}}) [^,]*, value {_NUMBER}?|([-+>]))"
        ),
        _of_evtest,
    ),
}
_DECLARED: Final = {"libinput record": "absinfo:", "evemu-record": "N: and A:", "evtest": "Supported events:"}
_GETEVENT = re.compile(r"(\[ *\d+\.\d+\] +)?(/dev/input/\w+: )?(EV_[A-Z]+|[0-9a-f]{4}) +\w+ +([0-9a-f]{8}|DOWN|UP)")
_READ = "libinput record, evemu-record or evtest"


class InputRecording:
    """The touch device of a recording, `name` and `axes`, and its `reports`, whose times begin anywhere."""

    def __init__(self) -> None:
        self.name = ""
        self.axes: dict[int, Axis] = {}
        self.reports: list[RawReport] = []
        self._program = ""  # that wrote the last event
        self._section = ""
        self._code = -1  # of the axis that evtest is about to list
        self._is_over = False  # the device with touches was read: what follows is of another
        self._events: list[_Event] = []

    def pad(self, where: str, size_mm: tuple[float, ...]) -> Pad:
        """Return the device as a pad; `where` is the file, `size_mm` as of `described`. Raises TrackpadError."""
        if self._program == "getevent":
            raise TrackpadError(f"{where}: a log of getevent lacks the ranges of the axes: record it by {_READ}.")
        if self._program and not self.axes:
            raise TrackpadError(
                f"{where}: has events of {self._program} without what the device declares: add the lines "
                f"{_DECLARED[self._program]} from before the first event."
            )
        if not self.axes and not self.name:
            raise TrackpadError(f"{where}: is no recording of {_READ}: make one.")
        return described(self.name or "The device", f"in {where}", self.axes, size_mm)

    def take(self, line: str) -> None:
        """Take the next line. Raises ValueError with what is wrong with it."""
        if self._is_over:
            return
        for program, (pattern, event) in _EVENTS.items():
            if found := pattern.match(line):
                self._program = program
                self._take_event(event(found))
                return
        if found := _AXIS.match(line) if self._section == "absinfo" else None:
            self._declare(int(found[1]), Axis(0, int(found[2]), int(found[3]), int(found[6])))
        elif found := _EVEMU_AXIS.match(line):
            self._declare(int(found[1], 16), Axis(0, int(found[2]), int(found[3]), int(found[6] or 0)))
        elif found := _EVTEST_CODE.match(line):
            self._section = self._section if found[1] == "code" else found[2]
            self._code = int(found[2]) if (found[1], self._section) == ("code", str(evdev.EV_ABS)) else -1
        elif found := _EVTEST_LIMIT.match(line) if self._code >= 0 else None:
            axis, limit = self.axes.get(self._code, Axis(0, 0, 0, 0)), int(found[2])
            match found[1]:
                case "Min":
                    axis = axis._replace(low=limit)
                case "Max":
                    axis = axis._replace(high=limit)
                case "Resolution":
                    axis = axis._replace(resolution=limit)
            self._declare(self._code, axis)
        elif line.startswith("- node:"):
            self._is_over = self.axes.keys() >= _POSITIONS
            if not self._is_over:
                self._forget()
        elif found := _NAME.match(line):
            self.name = _printable(found[1])
        elif found := _KEY.match(line):
            self._section = found[1]
            if found[1] == "name":
                self.name = _printable(found[2])
        elif _GETEVENT.match(line):
            self._program = "getevent"

    def _declare(self, code: int, axis: Axis) -> None:
        if not all(-_MOST_RAW <= value < _MOST_RAW for value in axis):
            raise ValueError("the range of an axis does not fit in 32 bits")
        if len(self.axes) < _MOST_AXES:
            self.axes[code] = axis

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


def _printable(text: str) -> str:
    return "".join(one for one in text.strip().strip('"') if one.isprintable())[:_MOST_NAME]
