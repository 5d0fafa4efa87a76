"""Ground truth of the simulated plate in a live recording: what its rig publishes, as records.

The rig knows where its fingers are and what they get, the daemon their targets: a true finger has the target of the
finger that a pass took to be nearest. Truths come a hundred times a second; the lock-step run has all 2000.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import msgpack
import zmq

from ...config.sections import SIMULATED
from ...files.recording.header import Header
from ...files.recording.kinds import KINDS, MAX_WHOLE, Fields, Record, fits

NEAR_MM = 15.0  # how far a finger may have moved since the pass; fingers are farther apart
MAX_PATHS = 64


class RigTruth:
    """Subscriber of the rig of the daemon that `header` describes, until `close`; idle where there is none."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], header: Header) -> None:
        self._modes = header.modes.M
        self._points: list[Fields] = []  # real fingers of the last pass
        self._socket: zmq.Socket[bytes] | None = None
        sim = header.config.sim
        if header.config.trackpad.source == SIMULATED and sim.rig_dir:
            self._socket = context.socket(zmq.SUB)
            self._socket.linger = 0
            self._socket.connect(f"ipc://{sim.rig_dir}/truth")
            self._socket.subscribe(b"")

    def note(self, record: Record) -> None:
        """Keep the targets of a pass."""
        if record.kind == "pass":
            self._points = [point for point in record.fields["points"] if "finger_id" in point]

    def records(self, seq: int) -> Iterator[Record]:
        """The truths that came since. Their number is that of the record before them, for they are not the daemon's:
        no number is missing with them or without."""
        while self._socket is not None and self._socket.poll(0):
            record = self._record(self._socket.recv(), seq)
            if record is not None:
                yield record

    def close(self) -> None:
        """Unsubscribe."""
        if self._socket is not None:
            self._socket.close()

    def _record(self, payload: bytes, seq: int) -> Record | None:
        """One message of the rig; None where it has another form."""
        try:
            message = msgpack.unpackb(payload)
            t_ns, fields = message["t_ns"], self._fields(message)
        except (ValueError, TypeError, LookupError, OverflowError, msgpack.UnpackException):
            return None
        is_sound = type(t_ns) is int and 0 <= t_ns <= MAX_WHOLE and fits(fields, KINDS["truth"].form)
        return Record("truth", seq, t_ns, fields) if is_sound else None

    def _fields(self, message: Any) -> Fields:
        fingers = []
        for path, (x_mm, y_mm), (d_um, q_um) in zip(
            message["path"], message["fingers"], message["truth_um"], strict=True
        ):
            if not path < message["paths"] <= MAX_PATHS:
                raise ValueError("path")
            finger = {"path": path + 1, "x_mm": x_mm, "y_mm": y_mm, "plate_d_um": d_um, "plate_q_um": q_um}
            fingers.append(finger | self._of_pass(x_mm, y_mm))
        d_um, q_um = zip(*message["modal_um"][: self._modes], strict=True)
        return {"fingers": fingers, "modal_um": {"d": list(d_um), "q": list(q_um)}}

    def _of_pass(self, x_mm: float, y_mm: float) -> Fields:
        """Id and target of the pass's finger that is nearest; empty if none is near."""
        distances_mm = [math.hypot(x_mm - point["x_mm"], y_mm - point["y_mm"]) for point in self._points]
        if not distances_mm or min(distances_mm) > NEAR_MM:
            return {}
        point = self._points[distances_mm.index(min(distances_mm))]
        return {name: point[name] for name in ("finger_id", "target_um")}
