"""Recorded touch reports as a trackpad source.

JSON lines: first the pad, as `wire.trackpad.to_fields` gives it ({"model": "mt2-usb"} is enough for a known one), then
{"t_ns": 123, "report": "02ab.."} each. `t_ns` is the host time at which the report was read (any origin, not
decreasing), `report` its bytes in hex, report id first.
"""

from __future__ import annotations

import asyncio
import json
import os
import time
from collections.abc import Callable, Iterable
from pathlib import Path

from ...errors import TrackpadError
from ...regular_file import read_lines
from ...values import RawReport
from ...wire.trackpad import Pad, from_fields, to_fields
from .trackpad_source import REPORT_BYTES, OnLink, OnReports

MAX_LINES = 500_000  # of a recording: an hour of reports

__all__ = ["ReplayTrackpad", "read_recording", "write_recording"]


def write_recording(path: str | os.PathLike[str], pad: Pad, reports: Iterable[RawReport]) -> None:
    """Write reports of one trackpad for `read_recording`. Raises OSError if the file cannot be written."""
    with open(path, "w", encoding="ascii") as file:
        file.write(json.dumps(to_fields(pad)) + "\n")
        for report in reports:
            file.write(json.dumps({"t_ns": report.t_host_ns, "report": report.data.hex()}) + "\n")


def read_recording(path: str | os.PathLike[str]) -> tuple[Pad, list[RawReport]]:
    """Return pad and reports of a recording. Raises TrackpadError with the file, the line and the defect."""
    number, reports = 1, list[RawReport]()
    try:
        lines = read_lines(Path(path), MAX_LINES)
        pad = _pad(next(lines, (1, ""))[1])
        for number, line in lines:  # noqa: B007 - named in the error
            reports.append(_report(line, not_before_ns=reports[-1].t_host_ns if reports else None))
    except OSError as error:
        raise TrackpadError(f"The recording {os.fspath(path)} cannot be read: {error.strerror}.") from error
    except UnicodeDecodeError as error:
        raise TrackpadError(f"The recording {os.fspath(path)} is not JSON: it is no text in UTF-8.") from error
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


class ReplayTrackpad:
    """Trackpad source that plays a recording once, with its original timing.

    Reports get the host times at which they are due, so their spacing is exact to the nanosecond. The constructor reads
    the file and raises TrackpadError if it is invalid.
    """

    def __init__(self, path: str | os.PathLike[str], *, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._pad, self._reports = read_recording(path)
        self._path = os.fspath(path)
        self._clock_ns = clock_ns
        self._next = 0
        self._timer: asyncio.Handle | None = None

    def start(self, loop: asyncio.AbstractEventLoop, on_reports: OnReports, on_link: OnLink) -> None:
        self._loop, self._on_reports, self._on_link = loop, on_reports, on_link
        self._timer = loop.call_soon(self._begin)

    def request_enable(self) -> None:
        """Does nothing: a recording has no mode to enable."""

    async def close(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def _begin(self) -> None:
        self._t_begin_s, self._t_begin_ns = self._loop.time(), self._clock_ns()
        self._on_link(self._pad, f"replay of {len(self._reports)} reports from {self._path}")
        self._arm()

    def _arm(self) -> None:
        if self._next < len(self._reports):
            due_s = self._t_begin_s + self._due_ns(self._next) * 1e-9
            self._timer = self._loop.call_at(due_s, self._play)
        else:
            self._on_link(None, "replay ended")

    def _play(self) -> None:
        """Deliver the report that the timer was set for, and those that fell due while the loop was busy."""
        elapsed_ns = (self._loop.time() - self._t_begin_s) * 1e9
        first = self._next
        self._next += 1
        while self._next < len(self._reports) and self._due_ns(self._next) <= elapsed_ns:
            self._next += 1
        self._on_reports(
            [RawReport(self._t_begin_ns + self._due_ns(i), self._reports[i].data) for i in range(first, self._next)]
        )
        self._arm()

    def _due_ns(self, index: int) -> int:
        """Time of a report since the first one."""
        return self._reports[index].t_host_ns - self._reports[0].t_host_ns
