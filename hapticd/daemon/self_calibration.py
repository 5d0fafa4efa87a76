"""Calibration while the plate is touched: the rim between the daemon's loop and the process that fits.

What the machine's observer is given goes to the process through a pipe, after the event in which it happened; a pipe
that is full loses records, never time. A verdict comes back as a line, and what it corrects is adopted in small steps
(`pad_adoption`), each an input of the machine. If the process ends, nothing more is adopted.
"""

from __future__ import annotations

import asyncio
import json
import logging
import math
import os
import subprocess
import sys
from collections import deque
from collections.abc import Sequence
from typing import Any

import msgpack

from ..config.sections import Config
from ..files.recording.header import Header, header_fields
from ..files.recording.kinds import Fields, record_of
from ..values import AffineMap
from .machine import Machine
from .pad_adoption import Adoption, Correction, Pad, configured_pad

log = logging.getLogger("hapticd")

PROCESS = "hapticd.tools.touch_process"
MOST_WAITING_BYTES = 1 << 20  # for the pipe: some 7 s of touching
STEP_EVERY_NS = 10_000_000
_LONGEST_LINE_BYTES = 1 << 12
_PIECE_BYTES = 1 << 16
_MOST_REFUSAL_CHARACTERS = 200
_PASS_FIELDS = ("age_ns", "fingers", "t_apply_ns")


class SelfCalibration:
    """Feeds the process, and adopts what it finds."""

    def __init__(self, config: Config) -> None:
        self._adoption = Adoption.of(configured_pad(config))
        self._waiting: deque[tuple[str, int, Sequence[Any]]] = deque()
        self.process: subprocess.Popen[bytes] | None = None
        self._out = bytearray()
        self._line = b""
        self._has_gap = False
        self._t_stepped_ns = 0
        self._verdicts = self._adopted = self._dropped = self._steps = 0
        self._last = ""

    def start(self, loop: asyncio.AbstractEventLoop, header: Header) -> None:
        """Start the process; one that cannot be started is a warning."""
        self._loop = loop
        try:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-m", PROCESS],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                bufsize=0,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            )
        except OSError as error:
            log.warning("the self-calibration cannot start, the pad stays as it is: %s", error.strerror)
            return
        for pipe in (self.process.stdin, self.process.stdout):
            assert pipe is not None
            os.set_blocking(pipe.fileno(), False)
        loop.add_reader(self.process.stdout, self._read)  # type: ignore[arg-type]
        self._send(header_fields(header))

    def _read(self) -> None:
        assert self.process is not None
        assert self.process.stdout is not None
        try:
            data = os.read(self.process.stdout.fileno(), _LONGEST_LINE_BYTES)
        except BlockingIOError:
            return
        *lines, self._line = (self._line + data).split(b"\n")
        for line in lines:
            if not self.take_verdict(line):
                return
        if not data:
            self._lost()
        elif len(self._line) > _LONGEST_LINE_BYTES:
            self._refuse(self._line)

    def _lost(self) -> None:
        log.warning("the self-calibration's process has ended: the pad stays as it is")
        self.close()

    def _refuse(self, line: bytes) -> None:
        log.warning("the self-calibration's process sent no verdict, the pad stays as it is: %r", line[:80])
        self.close()

    def _write(self) -> None:
        """Write what the pipe takes, and the rest when it takes more."""
        if self.process is None or self.process.stdin is None:
            return
        pipe = self.process.stdin.fileno()
        try:
            while self._out:
                del self._out[: os.write(pipe, self._out[:_PIECE_BYTES])]
        except BlockingIOError:
            self._loop.add_writer(pipe, self._write)
            return
        except OSError:  # it reads no more
            self._lost()
            return
        self._loop.remove_writer(pipe)

    def put(self, kind: str, t_ns: int, *values: Any) -> None:
        """A machine's observer: encoded when the loop comes back from this event, so that no pass waits for it."""
        if self.process is None or kind not in ("board_bytes", "written", "pass", "adopt"):
            return
        if not self._waiting:
            self._loop.call_soon(self._flush)
        self._waiting.append((kind, t_ns, values))

    def _flush(self) -> None:
        while self._waiting:
            kind, t_ns, values = self._waiting.popleft()
            self._send([kind, t_ns, _fields(kind, t_ns, values)])

    def _send(self, message: object) -> None:
        if self.process is None:
            return
        if len(self._out) > MOST_WAITING_BYTES:
            self._dropped += 1
            self._has_gap = True
            return
        if self._has_gap:
            self._has_gap = False
            self._out += msgpack.packb(None)
        was_waiting = len(self._out) > 0
        self._out += msgpack.packb(message)
        if not was_waiting:
            self._write()

    def restart(self) -> None:
        """Another machine begins: what was seen of the one before does not belong to it. The pad stays where it is."""
        self._has_gap = True

    def take_verdict(self, line: bytes) -> bool:
        """Take one line of the process; one that is no verdict ends the process, and False is returned."""
        try:
            verdict = json.loads(line)
            refusal = str(verdict["refusal"])[:_MOST_REFUSAL_CHARACTERS]
            self._last = refusal if refusal else self._request(_correction(verdict))
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
            self._refuse(line)
            return False
        self._verdicts += 1
        return True

    def _request(self, correction: Correction) -> str:
        """Begin to adopt a correction, while no other is adopted; returns why it is refused."""
        if self._adoption.is_moving:
            return ""
        if not self._adoption.request(correction):
            return "The pad found is far from the configured one: run hapticd calibrate trackpad."
        self._adopted += 1
        log.info("the touches show the pad elsewhere by %s mm: adopting it", [round(mm, 3) for mm in correction[1]])
        return ""

    def step(self, machine: Machine, t_now_ns: int) -> None:
        """Take the next small step, if one is due."""
        if not self._adoption.is_moving or t_now_ns - self._t_stepped_ns < STEP_EVERY_NS:
            return
        self._t_stepped_ns = t_now_ns
        pad = self._adoption.step()
        if pad is not None:
            self._steps += 1
            adopt(machine, pad, t_now_ns)

    def resume(self, machine: Machine, t_now_ns: int) -> None:
        """Give a machine that begins the pad that the one before had."""
        if self._adoption.now != self._adoption.configured:
            adopt(machine, self._adoption.now, t_now_ns)

    def report(self) -> dict[str, object]:
        """For `status`."""
        now, configured = self._adoption.now, self._adoption.configured
        return {
            "running": self.process is not None,
            "moving": self._adoption.is_moving,
            "verdicts": self._verdicts,
            "adopted": self._adopted,
            "steps": self._steps,
            "dropped": self._dropped,
            "moved_mm": now.distance_mm(configured),
            "latency_ms": now.latency_ns * 1e-6,
            "last_refusal": self._last,
        }

    def close(self) -> None:
        """End the process."""
        process, self.process = self.process, None
        if process is None:
            return
        self._out.clear()
        process.kill()
        for pipe, remove in ((process.stdin, self._loop.remove_writer), (process.stdout, self._loop.remove_reader)):
            assert pipe is not None
            remove(pipe)
            pipe.close()
        process.wait()


def adopt(machine: Machine, pad: Pad, t_now_ns: int) -> None:
    """Give the machine a pad."""
    place: AffineMap = pad.plate_from_pad
    machine.adopt(
        (place.xx, place.xy, place.yx, place.yy, place.offset_x_mm, place.offset_y_mm), pad.latency_ns, t_now_ns
    )


def _fields(kind: str, t_ns: int, values: Sequence[Any]) -> Fields:
    fields = record_of(kind, 0, t_ns, tuple(values)).fields
    return {name: fields[name] for name in _PASS_FIELDS if name in fields} if kind == "pass" else fields


def _correction(verdict: Any) -> Correction:
    """Raise ValueError, KeyError or TypeError for what is no correction."""
    xx, xy, yx, yy = map(float, verdict["matrix"])
    x_mm, y_mm = map(float, verdict["offset_mm"])
    latency_s = float(verdict["latency_s"])
    if not all(map(math.isfinite, (xx, xy, yx, yy, x_mm, y_mm, latency_s))):
        raise ValueError("a correction is finite")
    return Correction((xx, xy, yx, yy), (x_mm, y_mm), latency_s)
