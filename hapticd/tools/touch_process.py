"""The process that calibrates while the plate is touched: MessagePack from the daemon in, verdicts as JSON lines out.

`python -m hapticd.tools.touch_process`; the daemon starts it (`daemon.self_calibration`). It has the lowest priority,
bounded memory, and fits only while it has used less than DUTY of the time.

    {...}               the header of the recording that the daemon could make
    [kind, t_ns, {..}]  a record: `board_bytes`, `written`, `pass`; `adopt`, `adopt_readings`, `adopt_map` and
                        `adopt_load`, which say what is in force: fingers are kept as the configured pad would have
                        them, and sensors report as they did, so that what was seen before and after is fitted together
    null                records were lost
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
import resource
import sys
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any, BinaryIO, TextIO

import msgpack
import numpy as np

from ..core.plate.mode_shapes import ModeShapes
from ..daemon.adoption import shapes_of
from ..daemon.settings import CALIBRATION_HZ
from ..design.touch.coverage import known_sentence
from ..design.touch.evidence import Taken, gained
from ..design.touch.judge import Judged, calibrate
from ..design.touch.model import LATENCY, Calibration
from ..design.touch.observations import Windows
from ..errors import HapticdError
from ..files.recording.header import Header, header_from
from ..files.recording.kinds import Record
from .touch_correction import known_better, learned_contacts, learned_load, mode_map, windows_of
from .touch_recording import Collected, Touched, touched

DUTY = 0.1  # of one processor
FIT_S = 24.0  # of a plate that follows references, after which there is a verdict
TOGETHER = 3  # such spans are fitted together, for the map
LONGEST_S = 150.0  # since the first of them began: the plate's own rates drift
ONE_OF = 2  # windows that came later judge what is in force where there is no time for a fit: a second on four modes
APART_US = round(0.95e6 / CALIBRATION_HZ)  # a recording may have the board report more often
MOST_TICKS = round(4 * FIT_S * CALIBRATION_HZ)  # of all: a plate that is touched so rarely shows little
MOST_FRAMES = MOST_TICKS // 4  # 36 s of the shortest, of 3 ms
MOST_POSITIONS = 4 * MOST_TICKS  # 96 s of 16 fingers at 125 Hz
LEAST_NICE = 19
MOST_BYTES = 3 << 27  # the service may have a third more


class Accumulator:
    """Collects records in spans of FIT_S, each of which judges what is in force; the newest are fitted together."""

    def __init__(self, header: Header) -> None:
        self._header = header  # its map and parasitic modes are those in force
        self._configured = Taken.as_configured(header.modes)
        self._readings = np.eye(header.modes.M, dtype=np.complex128)
        self._collected = Collected.of(header.config, APART_US)
        self._earlier: deque[tuple[int, Collected]] = deque(maxlen=TOGETHER - 1)
        self._waits = False  # since the last fit a span has ended
        self._t_begin_ns = self._t_ns = header.t_start_ns

    def take(self, record: Record) -> None:
        """Take one record, in their order."""
        self._t_ns = record.t_ns
        if record.kind == "adopt_readings":
            flat = np.array(record.fields["d"]) + 1j * np.array(record.fields["q"])
            self._readings = flat.reshape(self._readings.shape)
        elif record.kind == "adopt_map":
            shapes = shapes_of(record.fields["shapes"], self._modes)
            modes = self._modes.with_shapes(shapes, record.fields["steepest_1_mm"])
            self._header = replace(self._header, modes=modes)
        elif record.kind == "adopt_load":
            assert self._header.parasitic_modes is not None
            load_1_s = complex(record.fields["decay_1_s"], -record.fields["detuning_rad_s"])
            self._header = replace(self._header, parasitic_modes=self._header.parasitic_modes.with_load(load_1_s))
        elif record.kind == "adopt" or not self.is_full:
            try:
                self._collected.take(record)
            except HapticdError:  # another board took part
                self.restart()
            if self._is_too_long:
                self.restart()

    @property
    def _modes(self) -> ModeShapes:
        return self._header.modes

    @property
    def _is_too_long(self) -> bool:
        collected = self._collected
        others = max(len(collected.frames), len(collected.drives))
        return len(collected.samples) > MOST_TICKS or others > MOST_FRAMES or collected.positions > MOST_POSITIONS

    def restart(self) -> None:
        """Reset what was collected: it does not belong to what comes."""
        self._earlier.clear()
        self._begin(self._collected.next())

    def _begin(self, after: Collected) -> None:
        self._collected, self._t_begin_ns, self._waits = after, self._t_ns, False

    @property
    def is_full(self) -> bool:
        """There is enough to judge what is in force."""
        return self._collected.live_us >= 1e6 * FIT_S

    @property
    def is_enough(self) -> bool:
        """There is enough for a verdict."""
        return self._waits or self.is_full

    def evidence(self) -> dict[str, Any] | None:
        """Judge what is in force by what was collected last, and go on: a verdict without a fit, which takes little
        time, or None where these touches say nothing of it."""
        newest, t_begin_ns = self._collected, self._t_begin_ns
        self._end_span()
        self._waits = True
        if self._is_as_configured:
            return None
        try:
            windows = windows_of(touched(newest, self._header, "the touching"))
            in_force = self._evidence(windows.part(slice(None, None, ONE_OF)), t_begin_ns)
        except HapticdError:
            return None
        return {"in_force": in_force} if in_force else None

    def _end_span(self) -> None:
        self._earlier.append((self._t_begin_ns, self._collected))
        self._begin(self._collected.next())

    def verdict(self) -> dict[str, Any]:
        """Fit and judge what was collected last, and go on. A `refusal` comes with no correction; `in_force` says
        whether the newest touches are fitted `better` by what is in force than by what is configured, or `worse`.

        Each fit begins at what is configured: by what is in force, the touches that taught it would teach no more.
        """
        t_newest_ns = self._t_begin_ns
        since_s = 1e-9 * (t_newest_ns - self._header.t_start_ns)
        oldest_ns = self._t_ns - round(1e9 * LONGEST_S)
        together = self._collected
        for t_begin_ns, collected in reversed(self._earlier):
            if t_begin_ns >= oldest_ns:
                together = collected.followed_by(together)
        if self.is_full:
            self._end_span()
        self._waits = False
        try:
            found = touched(together, self._header, "the touching")
            windows = windows_of(found)
            in_force = self._evidence(windows.part(windows.start_s >= since_s), t_newest_ns)
            judged = calibrate(windows, self._configured.modes, self._header.parasitic_modes)
        except HapticdError as error:
            return {"refusal": str(error)}
        verdict: dict[str, Any] = {
            "refusal": judged.refusal,
            "map_refusal": judged.map_refusal,
            "touched_s": judged.touched_s,
        }
        if in_force:
            verdict["in_force"] = in_force
        if judged.next_place is not None:
            verdict["next_place"] = [judged.next_place.column, judged.next_place.row]
        if (load_1_s := learned_load(found, windows, judged)) is not None:
            verdict["load_1_s"] = [load_1_s.real, load_1_s.imag]
        if (sizes := learned_contacts(found, judged)) is not None:
            verdict["contacts"] = sizes
        return verdict if judged.refusal else verdict | self._found(judged, found)

    def _evidence(self, newest: Windows, t_newest_ns: int) -> str:
        """What touches that came since the last verdict say of what is in force, if that is not as configured."""
        if self._is_as_configured:
            return ""
        in_force = Taken(self._modes, self._in_force)
        gain = gained(newest, self._configured, in_force, self._header.parasitic_modes)
        if gain is None:
            return ""
        if gain.is_worse:  # what came before was of another plate
            while self._earlier and self._earlier[0][0] < t_newest_ns:
                self._earlier.popleft()
            return "worse"
        return "better" if gain.is_sure else ""

    @property
    def _is_as_configured(self) -> bool:
        is_plate = self._modes is self._configured.modes and np.array_equal(self._readings, np.eye(self._modes.M))
        return is_plate and self._collected.now == self._collected.pad

    @property
    def _in_force(self) -> Calibration:
        """What the daemon has adopted, relative to what is configured."""
        now, pad = self._collected.now, self._collected.pad
        after, before = now.plate_from_pad, pad.plate_from_pad
        linear = np.array(((after.xx, after.xy), (after.yx, after.yy)))
        matrix = linear @ np.linalg.inv(np.array(((before.xx, before.xy), (before.yx, before.yy))))
        offset_mm = np.array((after.offset_x_mm, after.offset_y_mm))
        offset_mm -= matrix @ np.array((before.offset_x_mm, before.offset_y_mm))
        late_s = 1e-9 * (now.latency_ns - pad.latency_ns)
        rotation_rad = (matrix[1, 0] - matrix[0, 1]) / 2.0
        place = np.array((*offset_mm, rotation_rad, matrix[0, 0] - 1.0, matrix[1, 1] - 1.0, late_s, 0.0))
        sense = np.asarray(np.linalg.inv(self._readings), np.complex128)
        return Calibration(place, sense, Calibration.nominal(self._modes.M).waves)

    def _found(self, judged: Judged, seen: Touched) -> dict[str, Any]:
        matrix, offset_mm = judged.calibration.affine
        found = {
            "matrix": matrix.ravel().tolist(),
            "offset_mm": offset_mm.tolist(),
            "latency_s": float(judged.calibration.pad[LATENCY]),
        }
        if judged.waves is None or judged.map_sigma is None:
            return found
        known = {"map_sigma": judged.map_sigma.tolist(), "map_known": known_sentence(judged.map_sigma)}
        better = {"sensors_frac": self._header.config.uncertainty.sensors_frac} | known_better(seen, judged)
        return found | known | better | self._plate(judged)

    def _plate(self, judged: Judged) -> dict[str, Any]:
        """Return map and sensors, which are found together alone: without the map its errors pass for the sensors'."""
        readings = np.linalg.inv(judged.calibration.sense).ravel()
        data = mode_map(self._configured.modes, judged).shapes.astype("<f4").tobytes()
        changed = ModeShapes(self._modes.x_mm, self._modes.y_mm, shapes_of(data, self._modes))
        return {
            "d": readings.real.tolist(),
            "q": readings.imag.tolist(),
            "shapes": base64.b64encode(data).decode("ascii"),
            "steepest_1_mm": changed.steepest_1_mm(),
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
        if not accumulator.is_enough:
            continue
        verdict = None
        if spent_s() <= duty * (now_s() - t_start_s):
            verdict = accumulator.verdict()
        elif accumulator.is_full:
            verdict = accumulator.evidence()
        if verdict is not None:
            print(json.dumps(verdict), file=out, flush=True)


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
