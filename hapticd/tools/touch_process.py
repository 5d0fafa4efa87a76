"""The process that calibrates while the plate is touched: MessagePack from the daemon in, verdicts as JSON lines out.

`python -m hapticd.tools.touch_process`; the daemon starts it (`daemon.self_calibration`). It has the lowest priority,
bounded memory, and fits only while it has used less than DUTY of the time.

    {...}               the header of the recording that the daemon could make
    [kind, t_ns, {..}]  a record: `board_bytes`, `written`, `pass`; `adopt` ends what can be fitted together
    null                records were lost
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, BinaryIO, TextIO

import msgpack

from ..design.touch.judge import calibrate
from ..design.touch.observations import in_windows
from ..errors import HapticdError
from ..files.recording.header import Header, header_from
from ..files.recording.kinds import Record
from .touch_correction import MOST_SHIFT_S
from .touch_recording import Collected, touched

DUTY = 0.1  # of one processor
FIT_TICKS = 12_000  # while the plate follows references: 24 s at 500 Hz
MOST_TICKS = 4 * FIT_TICKS  # of all: a plate that is touched so rarely shows little
MOST_FRAMES = MOST_TICKS // 4  # 36 s of the shortest, of 3 ms
MOST_POSITIONS = 4 * MOST_TICKS  # 96 s of 16 fingers at 125 Hz
LEAST_NICE = 19
MOST_BYTES = 1 << 28  # the service may have twice as much


@dataclass(slots=True)
class Accumulator:
    """Collects records until there are enough to fit, and then no more until the fit."""

    header: Header
    _collected: Collected = field(default_factory=Collected)

    def take(self, record: Record) -> None:
        """Take one record, in their order."""
        if record.kind == "adopt":
            self.restart()
        elif not self.is_full:
            try:
                self._collected.take(record)
            except HapticdError:  # another board took part
                self.restart()
            if self._is_too_long:
                self.restart()

    @property
    def _is_too_long(self) -> bool:
        collected = self._collected
        others = max(len(collected.frames), len(collected.drives))
        return len(collected.samples) > MOST_TICKS or others > MOST_FRAMES or collected.positions > MOST_POSITIONS

    def restart(self) -> None:
        """Reset what was collected: it does not belong to what comes."""
        before = self._collected
        self._collected = Collected(control_hz=before.control_hz, drive_hz=before.drive_hz)

    @property
    def is_full(self) -> bool:
        """There is enough for a verdict."""
        return self._collected.live_ticks >= FIT_TICKS

    def verdict(self) -> dict[str, Any]:
        """Fit and judge what was collected, and begin again. A `refusal` comes with no correction."""
        collected = self._collected
        self.restart()
        try:
            found = touched(collected, self.header, "the touching")
            windows = in_windows(found.ticks, found.tracks, MOST_SHIFT_S)
            judged = calibrate(windows, self.header.modes, self.header.parasitic_modes, has_map=False)
        except HapticdError as error:
            return {"refusal": str(error)}
        if judged.refusal:
            return {"refusal": judged.refusal, "touched_s": judged.touched_s}
        matrix, offset_mm = judged.calibration.affine
        return {
            "refusal": "",
            "touched_s": judged.touched_s,
            "matrix": matrix.ravel().tolist(),
            "offset_mm": offset_mm.tolist(),
            "latency_s": judged.latency_s,
        }


def serve(
    source: BinaryIO, out: TextIO, spent_s: Callable[[], float], now_s: Callable[[], float], duty: float = DUTY
) -> None:
    """Read until the end; write verdicts when there is enough to fit and time to do so."""
    unpacker = msgpack.Unpacker(source, raw=False, strict_map_key=True)
    accumulator = Accumulator(header_from(next(unpacker)))
    t_start_s = now_s()
    for seq, message in enumerate(unpacker):
        if message is None:
            accumulator.restart()
            continue
        kind, t_ns, fields = message
        accumulator.take(Record(kind, seq, t_ns, fields))
        if accumulator.is_full and spent_s() <= duty * (now_s() - t_start_s):
            print(json.dumps(accumulator.verdict()), file=out, flush=True)


def main() -> None:
    """Serve standard input and output."""
    _yield_to_others()
    with contextlib.suppress(OSError, ValueError):  # the service may have a lower limit
        resource.setrlimit(resource.RLIMIT_DATA, (MOST_BYTES, MOST_BYTES))
    serve(sys.stdin.buffer, sys.stdout, time.process_time, time.monotonic)


def _yield_to_others() -> None:
    """Give up the real-time priority and the processor that the daemon may have: they are inherited.

    The service's unit refuses `nice`, which an idle policy needs no more.
    """
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    with contextlib.suppress(OSError):
        os.sched_setaffinity(0, range(os.cpu_count() or 1))
    with contextlib.suppress(OSError):
        os.nice(LEAST_NICE)


if __name__ == "__main__":
    main()
