"""Recorded touch reports as a trackpad source.

JSON lines: first the pad, as `wire.trackpad.to_fields` gives it ({"model": "mt2-usb"} is enough for a known one), then
{"t_ns": 123, "report": "02ab.."} each. `t_ns` is the host time at which the report was read (any origin, not
decreasing), `report` its bytes in hex, report id first. Blank lines and comments may precede them. Recordings of other
programs are read as they are (`input_recordings`).
"""

from __future__ import annotations

import itertools
import json
import os
import time
from collections.abc import Callable, Iterable
from pathlib import Path

from ...errors import TrackpadError
from ...regular_file import read_lines
from ...values import RawReport
from ...wire.trackpad import Decoder, Pad, StillContacts, evdev, from_fields, to_fields
from .input_nodes import packed
from .input_recordings import InputRecording
from .repeats import RepeatedReports
from .trackpad_source import REPORT_BYTES, LoopSource

MAX_LINES = 500_000  # of a recording: an hour of reports
MAX_EVENT_LINES = 8 * MAX_LINES  # of a recording of events: eight of a report

__all__ = ["ReplayTrackpad", "read_recording", "write_recording"]


def write_recording(path: str | os.PathLike[str], pad: Pad, reports: Iterable[RawReport]) -> None:
    """Write reports of one trackpad for `read_recording`. Raises OSError if the file cannot be written."""
    with open(path, "w", encoding="ascii") as file:
        file.write(json.dumps(to_fields(pad)) + "\n")
        for report in reports:
            file.write(json.dumps({"t_ns": report.t_host_ns, "report": report.data.hex()}) + "\n")


def read_recording(path: str | os.PathLike[str], size_mm: tuple[float, ...] = ()) -> tuple[Pad, list[RawReport]]:
    """Return pad and reports of a recording. Raises TrackpadError with the file, the line and the defect.

    `size_mm` is the size of the range of positions of an input device that does not say it.
    """
    number, reports = 1, list[RawReport]()
    try:
        lines = read_lines(Path(path), MAX_EVENT_LINES)
        start = next((one for one in lines if one[1].strip() and not one[1].startswith("#")), (1, ""))
        number, first = start
        if not first.startswith("{"):
            recording = InputRecording()
            for number, line in itertools.chain([start], lines):  # noqa: B007 - named in the error
                recording.take(line)
            return recording.pad(os.fspath(path), size_mm), recording.reports
        pad = _pad(first)
        for number, line in lines:
            if number > MAX_LINES:
                raise ValueError(f"a recording has at most {MAX_LINES} lines")
            reports.append(_report(line, not_before_ns=reports[-1].t_host_ns if reports else None))
    except OSError as error:
        raise TrackpadError(f"The recording {os.fspath(path)} cannot be read: {error.strerror}.") from error
    except UnicodeDecodeError as error:
        raise TrackpadError(f"The recording {os.fspath(path)} is no text in UTF-8.") from error
    except ValueError as error:
        raise TrackpadError(f"{os.fspath(path)}, line {number}: {error}.") from error
    return pad, reports


def _pad(line: str) -> Pad:
    form = 'the first line must be {"model": "..."}'
    try:
        return from_fields(_fields(line, form))
    except ValueError as error:
        raise ValueError(f"{error}; {form}" if form not in str(error) else str(error)) from None


def _report(line: str, not_before_ns: int | None) -> RawReport:
    form = 'a report must be {"t_ns": integer, "report": "hex"}'
    fields = _fields(line, form)
    t_ns, text = fields.get("t_ns"), fields.get("report")
    if type(t_ns) is not int or type(text) is not str:
        raise ValueError(form)
    if not -(1 << 63) <= t_ns < 1 << 63:
        raise ValueError("its t_ns does not fit in 64 bits")
    if not_before_ns is not None and t_ns < not_before_ns:
        raise ValueError("its t_ns is before the line above: sort the recording by t_ns")
    try:
        data = bytes.fromhex(text)
    except ValueError as error:
        raise ValueError("its report is not hex: two digits for each byte") from error
    if len(data) > REPORT_BYTES:
        raise ValueError(f"its report has {len(data)} bytes, and no trackpad sends more than {REPORT_BYTES}")
    return RawReport(t_ns, data)


def _fields(line: str, form: str) -> dict[str, object]:
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"not JSON, and {form}") from error
    if not isinstance(fields, dict):
        raise ValueError(form)
    return fields


class ReplayTrackpad(LoopSource):
    """Trackpad source that plays a recording once, with its original timing.

    Reports get the host times at which they are due, so their spacing is exact to the nanosecond. Of an input device,
    whose kernel says nothing of fingers that lie still, the last report is repeated, as `EvdevTrackpad` does. The
    constructor reads the file and raises TrackpadError if it is invalid; `size_mm` as of `read_recording`.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        size_mm: tuple[float, ...] = (),
        *,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._pad, self._reports = read_recording(path, size_mm)
        super().__init__(clock_ns)
        self._path = os.fspath(path)
        self._next = 0
        self._decoder = Decoder(self._pad)
        self._still = StillContacts()
        self._repeats = RepeatedReports(self._still, self._repeated, clock_ns)

    def _open(self) -> tuple[Pad, str]:
        return self._pad, f"replay of {len(self._reports)} reports from {self._path}"

    def _release(self) -> None:
        self._repeats.stop()

    def _begin(self) -> None:
        self._t_begin_s, self._t_begin_ns = self._loop.time(), self._clock_ns()
        self._repeats.start(self._loop, self._on_reports)
        self._arm()

    def _arm(self) -> None:
        """Set when the next report is due."""
        if self._next == len(self._reports):
            self._repeats.stop()
            self._on_link(None, "replay ended")
            return
        due_s = self._t_begin_s + self._due_ns(self._reports[self._next]) * 1e-9
        self._timer = self._loop.call_at(due_s, self._play)

    def _play(self) -> None:
        """Deliver the report that the timer was set for, and those that fell due while the loop was busy."""
        elapsed_ns = (self._loop.time() - self._t_begin_s) * 1e9
        first = self._next
        self._next += 1
        while self._next < len(self._reports) and self._due_ns(self._reports[self._next]) <= elapsed_ns:
            self._next += 1
        self._repeats.pass_on([self._played(report) for report in self._reports[first : self._next]])
        self._arm()

    def _played(self, report: RawReport) -> RawReport:
        played = RawReport(self._t_begin_ns + self._due_ns(report), report.data)
        if self._pad.layout == "evdev" and (frames := self._decoder.decode(report.data, report.t_host_ns)):
            self._still.took(played.t_host_ns, are_down=len(frames[-1].contacts) > 0)
        return played

    def _repeated(self, t_ns: int) -> bytes:
        """The last report once more, stamped by the recording's clock."""
        return packed(t_ns - self._t_begin_ns + self._reports[0].t_host_ns, [(evdev.EV_SYN, evdev.SYN_REPORT, 0)])

    def _due_ns(self, report: RawReport) -> int:
        """Return when a report was recorded, since the first one."""
        return report.t_host_ns - self._reports[0].t_host_ns
