"""A recording as `calibrate touch` reads it: control ticks that the board reported, and the fingers' tracks."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .. import board_protocol as protocol
from ..board_protocol import BoardState
from ..board_values import BoardHello, BoardStatus, TelemetrySample
from ..design.touch.observations import Ticks, Track
from ..errors import CalibrationError
from ..files.recording.header import Header
from ..files.recording.kinds import Record
from ..files.recording.mcap_reader import open_recording
from ..values import ComplexArray, FloatArray
from ..wire.board_messages import BoardDecoder
from ..wire.framing import FrameSplitter

COLLECTED = ("board_bytes", "written", "pass")  # the kinds of records that are read
AFTER_START_S, _AFTER_FRAMES = 0.002, 0.4  # a frame starts with a step, followed in some ticks; a fast pad's is small
BEFORE_NEXT_S = 0.001
_NEAR_S = 3.5e-3  # of samples around one, in which the voltage is straight: 2 ms in a recording
_OUTPUT_DELAY_S = 50e-6  # from a tick to its voltage on the plate
_WRAP_US = 1 << 32
_FRAME_BYTES = 2048
_PAUSE_S = 0.05  # between two reports of one touch
_FEWEST_REPORTS = 10
_FEWEST_TICKS = 500  # of a second and a half: fewer decide nothing


class Frame(NamedTuple):
    """A reference that was sent: its start on the board's wrapped clock, knots (K,) after it, amplitudes (K, M)."""

    t_apply_us: int
    offset_s: FloatArray
    modal_um: ComplexArray


class Touched(NamedTuple):
    """Contents of a recording: its header, the board's hello, ticks, and the fingers' tracks."""

    header: Header
    drive_hz: float
    ticks: Ticks
    tracks: tuple[Track, ...]


@dataclass(slots=True)
class Collected:
    """Reader of a machine's records for `calibrate touch`."""

    board: tuple[float, int] | None = None  # its control rate and its boot, whose clock stamps samples
    control_hz: float = 0.0
    drive_hz: float = 0.0
    samples: list[TelemetrySample] = field(default_factory=list)
    drives: list[tuple[int, float]] = field(default_factory=list)
    frames: list[Frame] = field(default_factory=list)
    starts: list[tuple[int, int]] = field(default_factory=list)  # of frames, on the board's clock and the host's
    fingers: dict[int, list[tuple[int, float, float, float]]] = field(default_factory=dict)  # instant, place, axis
    _decoder: BoardDecoder = field(default_factory=BoardDecoder)
    _splitter: FrameSplitter = field(default_factory=lambda: FrameSplitter(_FRAME_BYTES))
    _t_pending_us: int | None = None
    _t_raw_ns: dict[int, int] = field(default_factory=dict)  # of each finger's newest sample, as the machine had it

    def take(self, record: Record) -> None:
        """Take one record, in their order."""
        if record.kind == "board_bytes":
            self._take_board(record.fields["data"])
        elif record.kind == "written":
            for message in self._splitter.feed(record.fields["line"]):
                self._take_written(message)
        elif record.kind == "pass":
            self._take_pass(record)

    def _take_board(self, data: bytes) -> None:
        for message in self._decoder.feed(data):
            match message:
                case TelemetrySample():
                    self.samples.append(message)
                case BoardStatus():
                    self.drives.append((message.t_board_us, message.drive_hz))
                case BoardHello():
                    before, self.board = self.board, (message.control_hz, message.boot_id)
                    self.control_hz, self.drive_hz = message.control_hz, message.drive_hz
                    if before not in (self.board, None):
                        raise CalibrationError("--recording: two boards took part, or one started again: record one.")

    def _take_written(self, message: bytes) -> None:
        if message[0] != protocol.MSG_REFERENCE:
            return
        _, t_apply_us, count, modes = protocol.REFERENCE.unpack_from(message, 1)
        knots = count & ~protocol.REFERENCE_PULSE
        knot = struct.Struct(f"<H{2 * modes}f")
        rows = [knot.unpack_from(message, 1 + protocol.REFERENCE.size + index * knot.size) for index in range(knots)]
        values = np.array(rows)
        modal_um = values[:, 1::2] + 1j * values[:, 2::2]
        self.frames.append(Frame(t_apply_us, values[:, 0] * protocol.KNOT_UNIT_NS * 1e-9, modal_um))
        self._t_pending_us = t_apply_us

    def _take_pass(self, record: Record) -> None:
        fields = record.fields
        if self._t_pending_us is not None and "t_apply_ns" in fields:
            self.starts.append((self._t_pending_us, fields["t_apply_ns"]))
        self._t_pending_us = None
        t_sample_ns = record.t_ns - fields["age_ns"]
        for finger in fields["fingers"]:
            finger_id = finger["finger_id"]
            if t_sample_ns > self._t_raw_ns.get(finger_id, -1):
                self._t_raw_ns[finger_id] = t_sample_ns
                self.fingers.setdefault(finger_id, []).append(
                    (t_sample_ns, finger["x_mm"], finger["y_mm"], _axis_mm(finger))
                )


def _axis_mm(finger: Mapping[str, float]) -> float:
    """Return the axis of the disc of the ellipse that the pad reports, NaN where it reports none."""
    area_mm2 = finger.get("major_mm", 0.0) * finger.get("minor_mm", 0.0)
    return math.sqrt(area_mm2) if 0.0 < area_mm2 < math.inf else math.nan


def read(path: Path) -> Touched:
    """Read a recording. Raises HapticdError for one that cannot be calibrated by."""
    recording = open_recording(path)
    collected = Collected()
    for record in recording.records():
        collected.take(record)
    return touched(collected, recording.header, str(path))


def touched(collected: Collected, header: Header, source: str) -> Touched:
    """Return what the records of `source` show. Raises CalibrationError if that is too little."""
    if len(collected.samples) < _FEWEST_TICKS or not collected.control_hz:
        raise CalibrationError(
            f"{source}: holds {len(collected.samples)} control ticks of the board, {_FEWEST_TICKS} are needed: set "
            "record.telemetry_hz = 500, and record from the daemon's start on."
        )
    if len(collected.starts) < 2:
        raise CalibrationError(f"{source}: no reference was sent: touch the plate while a finger has a target.")
    tracks = tuple(_tracks(collected.fingers.values(), header.t_start_ns))
    return Touched(header, collected.drive_hz, _ticks(collected, header.t_start_ns), tracks)


def _tracks(fingers: Iterable[list[tuple[int, float, float, float]]], t_start_ns: int) -> Iterable[Track]:
    """Smooth the samples of each touch, in pieces without a pause."""
    for samples in fingers:
        t_s = np.array([1e-9 * (t_ns - t_start_ns) for t_ns, *_ in samples])
        places = np.array([place for _, *place in samples])
        for part in np.split(np.arange(len(t_s)), np.flatnonzero(np.diff(t_s) > _PAUSE_S) + 1):
            if len(part) >= _FEWEST_REPORTS:
                yield Track.of(t_s[part], places[part, :2], float(places[part, 2].mean()))


def _ticks(collected: Collected, t_start_ns: int) -> Ticks:
    """Return the ticks at which the plate follows a reference smoothly, or as far as the amplifiers reach."""
    samples = [one for one in collected.samples if one.state is BoardState.LIVE and not one.limited]
    if not samples:
        raise CalibrationError("--recording: the plate was never driven by a reference: touch it with targets set.")
    origin_us = collected.starts[0][0]
    t_board_s = _unwrapped_s([one.t_board_us for one in samples], origin_us)
    start_s = _unwrapped_s([frame.t_apply_us for frame in collected.frames], origin_us)
    frame = np.searchsorted(start_s, t_board_s, side="right") - 1
    since_s = t_board_s - start_s[np.maximum(frame, 0)]
    until_s = np.append(start_s, np.inf)[frame + 1] - t_board_s
    period_s = 1.0 / collected.control_hz
    middle_s = _OUTPUT_DELAY_S + period_s / 2.0  # of the hold that a tick's voltage begins
    measured_um, voltage_v, reference_um = _phasors(samples)
    slope = _slopes(collected.frames, np.maximum(frame, 0), since_s, period_s)
    behind_um_s = _without((measured_um - reference_um) / period_s, slope)
    saturated = np.array([one.saturated for one in samples])
    around = _around(t_board_s, measured_um)
    slope[saturated], behind_um_s[saturated] = around.slope_um_s[saturated], around.off_um[saturated] / period_s
    after_s = min(AFTER_START_S, _AFTER_FRAMES * float(np.median(np.diff(start_s))))
    is_smooth = (frame >= 0) & (since_s >= after_s) & (until_s >= BEFORE_NEXT_S)
    chosen = np.flatnonzero(is_smooth & (~saturated | around.is_known))
    slope = slope[chosen]
    return Ticks(
        t_s=_host_s(collected, t_board_s[chosen], origin_us, t_start_ns) + middle_s,
        measured_um=measured_um[chosen] + slope * (middle_s + period_s / 2.0),  # it is the mean over the tick before
        voltage_v=voltage_v[chosen],
        slope_um_s=slope,
        behind_um_s=behind_um_s[chosen],
        turning_rad_s=2.0 * np.pi * _drive_hz(collected, t_board_s[chosen], origin_us),
    )


class _Around(NamedTuple):
    """Neighbours of each sample: their slope (T, M), its distance from their mean, and whether both are near."""

    slope_um_s: ComplexArray
    off_um: ComplexArray
    is_known: npt.NDArray[np.bool_]


def _around(t_s: FloatArray, measured_um: ComplexArray) -> _Around:
    """Return the slope of measured amplitudes: at its voltage limit a plate does not follow the reference's."""
    slope, off = np.zeros_like(measured_um), np.zeros_like(measured_um)
    is_known = np.zeros(len(t_s), np.bool_)
    apart_s = np.diff(t_s)
    middle = np.flatnonzero((apart_s[:-1] < _NEAR_S) & (apart_s[1:] < _NEAR_S)) + 1
    before, after = measured_um[middle - 1], measured_um[middle + 1]
    is_known[middle] = True
    slope[middle] = (after - before) / (t_s[middle + 1] - t_s[middle - 1])[:, None]
    off[middle] = measured_um[middle] - (before + after) / 2.0
    return _Around(slope, off, is_known)


def _unwrapped_s(t_us: Iterable[int], origin_us: int) -> FloatArray:
    """Return seconds since `origin_us` of a wrapped clock that goes on steadily."""
    delta = (np.array(list(t_us), np.int64) - origin_us + _WRAP_US // 2) % _WRAP_US - _WRAP_US // 2
    steps = (np.diff(delta) + _WRAP_US // 2) % _WRAP_US - _WRAP_US // 2
    return np.asarray(1e-6 * (delta[0] + np.concatenate(((0,), np.cumsum(steps)))), np.float64)


def _slopes(frames: list[Frame], frame: Any, since_s: FloatArray, period_s: float) -> ComplexArray:
    """Return by how much each tick's reference rises in the next, in um/s."""
    slope = np.zeros((len(frame), frames[0].modal_um.shape[1]), np.complex128)
    for index in np.unique(frame):
        rows = np.flatnonzero(frame == index)
        for mode in range(slope.shape[1]):
            values = frames[index].modal_um[:, mode]
            now, then = (np.interp(since_s[rows] + ahead, frames[index].offset_s, values) for ahead in (0.0, period_s))
            slope[rows, mode] = (then - now) / period_s
    return slope


def _without(values: ComplexArray, slope: ComplexArray) -> ComplexArray:
    """Return what is left of each column (T, M) without its share of the slope: a law's lag, which corrects nothing."""
    share = (slope.conj() * values).sum(axis=0) / np.maximum((np.abs(slope) ** 2).sum(axis=0), 1e-12)
    return np.asarray(values - share * slope, np.complex128)


def _host_s(collected: Collected, t_board_s: FloatArray, origin_us: int, t_start_ns: int) -> FloatArray:
    """Return the host's time of instants on the board's clock, as the daemon knew it."""
    board_s = _unwrapped_s([t_us for t_us, _ in collected.starts], origin_us)
    host_s = 1e-9 * np.array([t_ns - t_start_ns for _, t_ns in collected.starts])
    return np.asarray(t_board_s + np.interp(t_board_s, board_s, host_s - board_s), np.float64)


def _drive_hz(collected: Collected, t_board_s: FloatArray, origin_us: int) -> FloatArray:
    """Return by how much the drive was above that of the hello."""
    known = [(t_us, drive_hz) for t_us, drive_hz in collected.drives if drive_hz > 0.0]
    if not known:
        return np.zeros(len(t_board_s))
    at_s = _unwrapped_s([t_us for t_us, _ in known], origin_us)
    return np.interp(t_board_s, at_s, [drive_hz - collected.drive_hz for _, drive_hz in known])


def _phasors(samples: list[TelemetrySample]) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Return measured amplitudes, voltages and references (T, M)."""
    values = np.array(
        [[(mode.measured_um, mode.voltage_v, mode.reference_um) for mode in sample.modes] for sample in samples],
        np.complex128,
    )
    return values[..., 0], values[..., 1], values[..., 2]
