"""The simulated trackpad: finger paths to raw reports, with the errors of a real pad.

Reports have the layouts of `wire.trackpad`, positions rounded to the pad's units, and the device's 21-bit millisecond
stamp. A landing finger gets the lowest free contact id of 1..15. A contact ends as drivers describe (Magic Trackpad 2:
state 7, then 0, then a frame without it). Without touch the pad sends nothing. The ellipse is that of the true contact,
as a pad senses it (`pad_ellipse`); pressure and size are those of an index finger in public captures, where the finger
has none of its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count, takewhile
from typing import NamedTuple

import numpy as np

from ...values import AffineMap, FloatArray
from ...wire.trackpad import DEFAULT_PAD, MAX_RECORDS, RECORD, STAMP_WRAP_MS, Pad
from . import fingertip, pad_ellipse
from .pad_ellipse import EllipseSensor, PadEllipse, Reported
from .pad_noise import FILTERED_NOISE, Firmware, PadNoise
from .paths import Path
from .pressing import Tip

_TOUCHING, _OUT_OF_RANGE, _NONE = 4, 7, 0
_IS_USB = {"mt2-usb": True, "mt2-bt": False}  # by the layout of a pad's reports
BLOCK = 64  # frames whose positions are computed at once
_OFF_PAD_MM = 3.0  # a finger's centre may lie this far beyond the declared range and still be sensed
_MAX_RAW = 4095
_PRESSURE_RISE = (0.4, 0.7, 1.0)  # of the first frames of a contact
_MOST_PRESSURE = 253  # of the decoder's `pressure_frac`
_NOBODY: FloatArray = np.empty((BLOCK, 0))
_ELLIPSES = 11  # a stream of random numbers of its own: positions do not depend on ellipses


class PadRecord(NamedTuple):
    """One contact record of a Magic Trackpad 2 in raw units; `orientation` is 0..7."""

    contact_id: int
    x: int
    y: int
    state: int = _TOUCHING
    major: int = 98
    minor: int = 85
    size: int = 40
    pressure: int = 28
    orientation: int = 4
    finger: int = 2


class Report(NamedTuple):
    """A raw report with the times (s) of its sampling and of its arrival at the host."""

    t_sample_s: float
    t_arrive_s: float
    data: bytes


@dataclass(frozen=True, slots=True)
class SensorSettings:
    """The pad and its errors.

    `noise` is that of the positions, `ellipse` what is reported of contacts. `stamp_jitter_ms` is the half width of the
    stamp's uniform error before it is rounded to whole milliseconds. `plate_from_pad` is the pad's true placement: the
    decoder's value if that is calibrated. The device's clock wraps within the first ten seconds.
    """

    pad: Pad = DEFAULT_PAD
    period_s: float = DEFAULT_PAD.period_ns / 1e9
    latency_s: float = 0.010
    noise: PadNoise = FILTERED_NOISE
    ellipse: PadEllipse = pad_ellipse.USUAL
    stamp_jitter_ms: float = 1.0
    lost_frac: float = 0.0
    plate_from_pad: AffineMap = field(default_factory=AffineMap)


def encode_mt2(t_ms: int, records: Sequence[PadRecord], *, usb: bool) -> bytes:
    """Encode a Magic Trackpad 2 report, 0x02 or 0x31."""
    stamp_ms = t_ms % STAMP_WRAP_MS
    header = bytes((0x31, stamp_ms << 3 & 0xF8, stamp_ms >> 5 & 0xFF, stamp_ms >> 13))
    prefix = bytes((0x02, 0, 0, 0, 0, 0, 0, bool(records))) if usb else b""
    return prefix + header + b"".join(map(_record, records))


def _record(record: PadRecord) -> bytes:
    word = record.x & 0x1FFF | (record.y & 0x1FFF) << 13 | record.finger << 26 | record.state << 29
    last = record.contact_id | record.orientation << 5
    return RECORD.pack(word, record.major, record.minor, record.size, record.pressure, last)


class SensorModel:
    """Reports of one pad for the given finger paths (at most 15) and, where given, the fingertip of each. Same
    settings, seed, paths and fingertips: same bytes.

    `block` is the number of frames computed at once; the noise depends on it. Raises ValueError for a pad whose reports
    it cannot make, or a singular `plate_from_pad`.
    """

    def __init__(self, settings: SensorSettings | None = None, seed: int = 0, *, block: int = BLOCK) -> None:
        settings = SensorSettings() if settings is None else settings
        if settings.pad.layout not in _IS_USB:
            raise ValueError(f"{settings.pad.name} is not simulated: use a pad that reports as {', '.join(_IS_USB)}")
        self.settings = settings
        self.seed = seed
        self._block = block
        affine = settings.plate_from_pad
        self._pad_from_plate = np.linalg.inv(((affine.xx, affine.xy), (affine.yx, affine.yy)))  # or LinAlgError
        self._offset_mm = np.array((affine.offset_x_mm, affine.offset_y_mm))

    def reports(self, paths: Sequence[Path], t_end_s: float, fingertips: Sequence[Tip] | None = None) -> list[Report]:
        """Return all reports sampled before `t_end_s`, in order of arrival."""
        return list(self.until(paths, t_end_s, fingertips))

    def until(self, paths: Sequence[Path], t_end_s: float, fingertips: Sequence[Tip] | None = None) -> Iterator[Report]:
        """Return the same, computed as they are taken."""
        scans = takewhile(lambda scan: scan.t_sample_s < t_end_s, self.scans(paths, fingertips))
        return (scan for scan in scans if scan.data)

    def scans(self, paths: Sequence[Path], fingertips: Sequence[Tip] | None = None) -> Iterator[Report]:
        """Yield a report for each scan, without end; without touch, or when it is lost, its data are empty."""
        if len(paths) > MAX_RECORDS:
            raise ValueError(f"a pad senses at most {MAX_RECORDS} fingers, not {len(paths)}")
        tips: Sequence[Tip] = [fingertip.USUAL] * len(paths) if fingertips is None else fingertips
        rng = np.random.default_rng([self.seed, len(paths)])
        settings = self.settings
        usb = _IS_USB[settings.pad.layout]
        firmware = [Firmware(settings.noise) for _ in paths]
        ellipses = [
            EllipseSensor(settings.ellipse, settings.pad.geometry, np.random.default_rng([self.seed, index, _ELLIPSES]))
            for index in range(len(paths))
        ]
        contacts = _Contacts([_appearance(rng) for _ in paths])
        start_ms = STAMP_WRAP_MS - int(rng.integers(1, 10_000))
        first = rng.random()  # the phase of the pad's scans is independent of the run
        size = self._block
        for block in count(step=size):
            t_s: FloatArray = (first + np.arange(block, block + size, dtype=np.float64)) * np.float64(settings.period_s)
            stamps_ms = np.rint(start_ms + t_s * 1e3 + rng.uniform(-1, 1, size) * settings.stamp_jitter_ms)
            points = self._raw_points(paths, firmware, t_s, rng)
            is_lost, _ = rng.random((2, size)) < settings.lost_frac
            reported = [self._ellipses(*each, t_s) for each in zip(points, ellipses, tips, strict=True)]
            pressures_frac = np.stack([tip.pressure_frac(t_s) for tip in tips], axis=1) if tips else _NOBODY
            for i, t_sample_s in enumerate(t_s.tolist()):
                felt = [path_points[i] for path_points in points], [ellipse[i] for ellipse in reported]
                records = contacts.scan(*felt, pressures_frac[i].tolist())
                is_silent = records is None or is_lost[i]
                data = b"" if is_silent else encode_mt2(int(stamps_ms[i]), records or (), usb=usb)
                yield Report(t_sample_s, t_sample_s + settings.latency_s, data)

    def _raw_points(
        self, paths: Sequence[Path], firmware: Sequence[Firmware], t_s: FloatArray, rng: np.random.Generator
    ) -> list[list[tuple[int, int] | None]]:
        """Return by path and time the position in raw units, None where the pad senses no finger."""
        pad = self.settings.pad.geometry
        half_mm = np.array((pad.width_mm, pad.height_mm)) / 2 + _OFF_PAD_MM
        points: list[list[tuple[int, int] | None]] = []
        for path, filters in zip(paths, firmware, strict=True):
            pad_mm = (path.position_mm(filters.sensed_s(t_s, rng)) - self._offset_mm) @ self._pad_from_plate.T
            is_sensed = np.all(np.abs(pad_mm) <= half_mm, axis=1)  # False for NaN
            noise_mm = filters.correlated(rng.normal(0, 1, pad_mm.shape)) * self.settings.noise.noise_mm
            noisy_mm = filters.held_mm(np.nan_to_num(pad_mm) + noise_mm)
            raw = np.clip(np.rint(noisy_mm * pad.units_per_mm + pad.centre_raw), -_MAX_RAW, _MAX_RAW).astype(int)
            points.append([(x, y) if sensed else None for (x, y), sensed in zip(raw.tolist(), is_sensed, strict=True)])
        return points

    def _ellipses(
        self, points: Sequence[tuple[int, int] | None], sensor: EllipseSensor, tip: Tip, t_s: FloatArray
    ) -> Sequence[Reported | None]:
        """Return what is reported of a contact at each position in raw units."""
        if not any(points):
            return [None] * len(points)
        pad = self.settings.pad.geometry
        places_mm = (np.array([point or (0, 0) for point in points]) - pad.centre_raw) / pad.units_per_mm
        return sensor.reported(self._pad_from_plate @ tip.ellipses_mm(t_s), places_mm)


class _Contacts:
    """Contact table of the pad: id of each finger, start and end of each contact."""

    def __init__(self, appearances: Sequence[PadRecord]) -> None:
        self._appearances = appearances
        self._down: dict[int, tuple[int, PadRecord]] = {}  # by path: frames down and the last record
        self._ending: list[PadRecord] = []
        self._was_silent = True

    def scan(
        self,
        points: Sequence[tuple[int, int] | None],
        ellipses: Sequence[Reported | None],
        pressures_frac: Sequence[float],
    ) -> list[PadRecord] | None:
        """Return the records of the next frame for the fingers' raw positions, what is reported of their contacts, and
        their pressures, NaN for the pad's own draw; None if the pad sends nothing."""
        self._ending = [record._replace(state=_NONE) for record in self._ending if record.state == _OUT_OF_RANGE]
        lifted = [self._down.pop(path)[1] for path in tuple(self._down) if points[path] is None]
        self._ending += [record._replace(state=_OUT_OF_RANGE, pressure=0) for record in lifted]
        for path, (point, ellipse, press_frac) in enumerate(zip(points, ellipses, pressures_frac, strict=True)):
            if point is not None and ellipse is not None:
                self._touch(path, press_frac, *point, *ellipse)
        records = [record for _, record in self._down.values()] + self._ending
        is_silent, self._was_silent = self._was_silent and not records, not records
        return None if is_silent else records

    def _touch(self, path: int, press_frac: float, x: int, y: int, major: int, minor: int, orientation: int) -> None:
        age, record = self._down.get(path, (0, self._appearances[path]))
        if age == 0:
            taken = {other.contact_id for _, other in self._down.values()} | {r.contact_id for r in self._ending}
            contact_id = next((i for i in range(1, MAX_RECORDS + 1) if i not in taken), None)
            if contact_id is None:
                return  # every id is in use: the finger is sensed once one is free
            record = record._replace(contact_id=contact_id)
        usual = self._appearances[path].pressure if math.isnan(press_frac) else round(press_frac * _MOST_PRESSURE)
        pressure = round(usual * _PRESSURE_RISE[min(age, len(_PRESSURE_RISE) - 1)])
        record = record._replace(x=x, y=y, major=major, minor=minor, orientation=orientation, pressure=pressure)
        self._down[path] = age + 1, record._replace(state=_TOUCHING)


def _appearance(rng: np.random.Generator) -> PadRecord:
    """Draw an index finger's size and pressure."""
    for bounds in ((3, 6), (90, 107), (76, 90)):
        rng.integers(*bounds)  # an ellipse was drawn here: the noise of positions stays as it was
    size, pressure = int(rng.integers(34, 47)), int(rng.integers(20, 37))
    return PadRecord(1, 0, 0, size=size, pressure=pressure)
