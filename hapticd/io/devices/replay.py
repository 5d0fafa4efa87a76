"""A recording of another program (`input_recordings`) as a trackpad source."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

from ...errors import TrackpadError
from ...regular_file import read_lines
from ...values import RawReport
from ...wire.trackpad import Decoder, Pad, StillContacts, evdev
from .input_nodes import packed
from .input_recordings import InputRecording
from .repeats import RepeatedReports
from .trackpad_source import LoopSource

MAX_LINES = 4_000_000  # of a recording: an hour of reports, of eight events each

__all__ = ["ReplayTrackpad", "read_recording"]


def read_recording(path: str | os.PathLike[str], size_mm: tuple[float, ...] = ()) -> tuple[Pad, list[RawReport]]:
    """Return pad and reports of a recording. Raises TrackpadError with the file, the line and the defect.

    `size_mm` is the size of the range of positions of an input device that does not say it.
    """
    number, recording = 1, InputRecording()
    try:
        for number, line in read_lines(Path(path), MAX_LINES):  # noqa: B007 - named in the error
            recording.take(line)
    except OSError as error:
        raise TrackpadError(f"The recording {os.fspath(path)} cannot be read: {error.strerror}.") from error
    except UnicodeDecodeError as error:
        raise TrackpadError(f"The recording {os.fspath(path)} is no text in UTF-8.") from error
    except ValueError as error:
        raise TrackpadError(f"{os.fspath(path)}, line {number}: {error}.") from error
    return recording.pad(os.fspath(path), size_mm), recording.reports


class ReplayTrackpad(LoopSource):
    """Trackpad source that plays a recording once, with its original timing.

    Reports get the host times at which they are due, so their spacing is exact to the nanosecond. As the kernel says
    nothing of fingers that lie still, the last report is repeated, as `EvdevTrackpad` does. The constructor reads the
    file and raises TrackpadError if it is invalid; `size_mm` as of `read_recording`.
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
        if frames := self._decoder.decode(report.data, report.t_host_ns):
            self._still.took(played.t_host_ns, are_down=len(frames[-1].contacts) > 0)
        return played

    def _repeated(self, t_ns: int) -> bytes:
        """The last report once more, stamped by the recording's clock."""
        return packed(t_ns - self._t_begin_ns + self._reports[0].t_host_ns, [(evdev.EV_SYN, evdev.SYN_REPORT, 0)])

    def _due_ns(self, report: RawReport) -> int:
        """Return when a report was recorded, since the first one."""
        return report.t_host_ns - self._reports[0].t_host_ns
