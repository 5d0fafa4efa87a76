"""Touches as a pad reported them: one trace of samples a finger, from live reports or out of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.touch.fingers import Tracker
from ..errors import UsageError
from ..files.recording.kinds import pad_of
from ..files.recording.mcap_reader import open_recording
from ..values import FloatArray, TouchFrame
from ..wire.trackpad import Decoder

_BY_VENDOR = "hid"


class Trace(NamedTuple):
    """One touch: the device's name, stamps (n,) and positions (n, 2)."""

    device: str
    t_s: FloatArray
    xy_mm: FloatArray

    @property
    def kind(self) -> str:
        """The kind of device that it is reported under."""
        return self.device.partition("/")[0]

    @property
    def group(self) -> str:
        """The same, but the vendor where a kind has many."""
        kind, _, name = self.device.partition("/")
        return name.rsplit("_", 2)[0] if kind == _BY_VENDOR else kind

    @property
    def samples(self) -> list[tuple[int, float, float]]:
        """Stamp in ns, x and y in mm."""
        stamps_ns: list[int] = np.rint(self.t_s * 1e9).astype(np.int64).tolist()
        return [(t_ns, x, y) for t_ns, (x, y) in zip(stamps_ns, self.xy_mm.tolist(), strict=True)]


class RecordedTouches:
    """Samples of fingers, by their ids. `samples` counts them."""

    def __init__(self) -> None:
        self.samples = 0
        self._tracker = Tracker()
        self._samples: dict[int, list[tuple[int, float, float]]] = {}

    def lift_all(self) -> None:
        """Lift every finger: the pad was disconnected."""
        self._tracker.reset()

    def add(self, touched: TouchFrame) -> None:
        """Take a frame of the pad."""
        frame = self._tracker.update(touched)
        for finger in frame.fingers:
            samples = self._samples.setdefault(finger.finger_id, [])
            if not samples or frame.t_ns > samples[-1][0]:
                samples.append((frame.t_ns, finger.x_mm, finger.y_mm))
                self.samples += 1

    def traces(self, device: str) -> list[Trace]:
        """Return what each finger left, under the name of the device."""
        return [
            Trace(device, 1e-9 * np.array([t_ns - samples[0][0] for t_ns, _, _ in samples]), np.array(samples)[:, 1:])
            for samples in self._samples.values()
            if len(samples) > 1
        ]


def recorded(path: Path) -> list[Trace]:
    """Read the touches of a recording: one trace a finger, in the pad's own coordinates. Raises HapticdError."""
    recording = open_recording(path)
    decoder = Decoder(recording.header.pad)
    traces = RecordedTouches()
    for record in recording.records():
        if record.kind == "trackpad_link":
            decoder = Decoder(pad_of(record.fields) or decoder.pad)
            traces.lift_all()
        elif record.kind == "reports":
            for report in record.fields["reports"]:
                for frame in decoder.decode(report["data"], report["t_host_ns"]):
                    traces.add(frame)
    found = traces.traces(f"recording/{decoder.pad.model}")
    if not found:
        raise UsageError(f"--recording {path}: no finger touched the pad: record some strokes.")
    return found
