"""The simulated plate's truth beside a recording of the daemon that drives it: what its rig tells, as records.

The rig knows where its fingers are and what they get, the daemon what they should get: a true finger has the target of
the finger that a pass took to be nearest. Truths come a hundred times a second; the lock-step run has all 2000.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import msgpack
import zmq

from ...config.sections import SIMULATED
from ...errors import RecordingError
from ...files.recording.framing import RawRecord, frame
from ...files.recording.header import Header
from ...files.recording.records import KINDS, body_of, record_of

NEAR_MM = 15.0  # what a finger may have gone on in since the pass, and fingers are farther apart
MAX_PATHS = 64

Pair = Sequence[float]


class TruthEar:
    """Hears the rig of the daemon that `header` tells of until `close`; nothing where there is none."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], header: Header) -> None:
        self._modes = header.modes.M
        self._wanted: list[tuple[float, float, float]] = []  # x_mm, y_mm, target_um as the last pass took them
        self._socket: zmq.Socket[bytes] | None = None
        sim = header.config.sim
        if header.config.trackpad.source == SIMULATED and sim.rig_dir:
            self._socket = context.socket(zmq.SUB)
            self._socket.linger = 0
            self._socket.connect(f"ipc://{sim.rig_dir}/truth")
            self._socket.subscribe(b"")

    def hear(self, raw: RawRecord) -> None:
        """A record of the daemon's: a pass tells what its fingers should get."""
        if self._socket is None or raw.kind != KINDS["pass"].number:
            return
        record = record_of(raw.kind, raw.seq, raw.body)
        assert record is not None
        self._wanted = [(x_mm, y_mm, um) for key, x_mm, y_mm, um, *_ in record.fields[6] if isinstance(key, int)]

    def records(self, seq: int) -> bytes:
        """The truths that came since, framed. Their number is that of the record before them, for they are not the
        daemon's: nothing is missing where they are, or are not."""
        framed = b""
        while self._socket is not None and self._socket.poll(0):
            framed += self._framed(self._socket.recv(), seq)
        return framed

    def close(self) -> None:
        """Hear no more."""
        if self._socket is not None:
            self._socket.close()

    def _framed(self, payload: bytes, seq: int) -> bytes:
        """One message of the rig's; nothing where it is none."""
        kind = KINDS["truth"].number
        try:
            body = self._body(msgpack.unpackb(payload))
            record_of(kind, seq, body)
            return frame(kind, seq, body)
        except (ValueError, TypeError, LookupError, OverflowError, msgpack.UnpackException, RecordingError):
            return b""

    def _body(self, told: Any) -> bytes:
        if told["paths"] > MAX_PATHS:
            raise ValueError("paths")
        finger_mm: list[Pair | None] = [None] * told["paths"]
        truth_um: list[Pair | None] = [None] * told["paths"]
        for path, place, felt_um in zip(told["path"], told["fingers"], told["truth_um"], strict=True):
            finger_mm[path], truth_um[path] = place, felt_um
        target_um = [None if place is None else self._target_um(*place) for place in finger_mm]
        return body_of("truth", told["t_ns"], (finger_mm, target_um, told["modal_um"][: self._modes], truth_um))

    def _target_um(self, x_mm: float, y_mm: float) -> float | None:
        near = [(math.hypot(x_mm - x, y_mm - y), target_um) for x, y, target_um in self._wanted]
        distance_mm, target_um = min(near, default=(math.inf, None))
        return target_um if distance_mm <= NEAR_MM else None
