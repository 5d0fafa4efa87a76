"""Adoption of what touches show, so that no finger feels a step.

The pad's place and latency move in small steps: no finger's position by more than STEP_MM at once. Mode map and sensors
are replaced together, as is a finger's load, while no finger is down and nothing is driven. Of what touches show, half
is adopted first; all, once touches that came after it are fitted better by it; and nothing stays where they are fitted
worse than by what is configured (`Trust`). Pure: what is adopted when is the caller's, and each step is an input of the
machine.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import astuple, dataclass
from enum import Enum
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ..config.sections import Config, UncertaintyConfig
from ..core.plate.mode_shapes import ModeShapes
from ..core.plate.parasitic_modes import ParasiticModes
from ..values import AffineMap
from .settings import plate_from_pad

STEP_MM = 0.002  # less than a pad resolves; as a filter's noise it moves a reference by 0.2 % of itself
STEP_NS = 20_000  # of latency: 2 um at 10 cm/s
LATENCY_NS = (0, 50_000_000)  # the bounds of trackpad.latency_ms
FARTHEST_MM, FARTHEST_NS = 3.0, 10_000_000  # from the configuration: beyond, something else is wrong
FARTHEST_READING = 0.2  # from sensors as they were calibrated
FARTHEST_MAP_FRAC = 0.3  # RMS of the change since the scan, as a share of that of the map
FARTHEST_PLACE_FRAC = 1.0  # the same at any one place, as a share of the map's largest value
FARTHEST_LOAD = 20.0  # times what is configured: ten times the damping is a heavy hand
FIRST_SHARE = 0.5  # of what touches show, before later ones confirm it
STEEPER = 1.5  # times as steep as at the scan, or as flat: beyond is no map of this plate
_CORNER_MM = 100.0  # of the largest plate


class AdoptedPad(NamedTuple):
    """Where the pad lies, and how late it reports."""

    plate_from_pad: AffineMap
    latency_ns: int

    def distance_mm(self, other: AdoptedPad) -> float:
        """Return the most by which a position on the plate differs."""
        corners = [(x_mm, y_mm) for x_mm in (-_CORNER_MM, _CORNER_MM) for y_mm in (-_CORNER_MM, _CORNER_MM)]
        return max(math.dist(self.plate_from_pad.apply(*one), other.plate_from_pad.apply(*one)) for one in corners)


def configured_pad(config: Config) -> AdoptedPad:
    """Return the pad as configured."""
    return AdoptedPad(plate_from_pad(config), round(config.trackpad.latency_ms * 1e6))


class Correction(NamedTuple):
    """What touches show: from where fingers were taken to be to where they are, and how much later they were there."""

    matrix: tuple[float, float, float, float]
    offset_mm: tuple[float, float]
    latency_s: float

    def part(self, share: float) -> Correction:
        """Return a share of it."""
        xx, xy, yx, yy = self.matrix
        x_mm, y_mm = self.offset_mm
        matrix = 1.0 + share * (xx - 1.0), share * xy, share * yx, 1.0 + share * (yy - 1.0)
        return Correction(matrix, (share * x_mm, share * y_mm), share * self.latency_s)

    def of(self, pad: AdoptedPad) -> AdoptedPad:
        """Return the corrected pad."""
        linear, before = AffineMap(*self.matrix), pad.plate_from_pad
        (xx, yx), (xy, yy) = linear.apply(before.xx, before.yx), linear.apply(before.xy, before.yy)
        place_mm = AffineMap(*self.matrix, *self.offset_mm).apply(before.offset_x_mm, before.offset_y_mm)
        after = AffineMap(xx, xy, yx, yy, *place_mm)
        low_ns, high_ns = LATENCY_NS
        return AdoptedPad(after, round(min(max(pad.latency_ns + 1e9 * self.latency_s, low_ns), high_ns)))


NOTHING: Final = Correction((1.0, 0.0, 0.0, 1.0), (0.0, 0.0), 0.0)


class Evidence(Enum):
    """How later touches are fitted by what was adopted, against what is configured."""

    NONE = ""
    BETTER = "better"
    WORSE = "worse"


@dataclass(slots=True)
class Trust:
    """How much of what touches show is adopted; by what was last found, and by what later touches say of it."""

    share: float = FIRST_SHARE
    correction: Correction = NOTHING
    change: PlateChange | None = None

    def take(self, evidence: Evidence, correction: Correction | None, change: PlateChange | None) -> bool:
        """Take a verdict, which may have found something; return whether there is something to move to."""
        if evidence is Evidence.WORSE:
            self.share, self.correction, self.change = FIRST_SHARE, NOTHING, None
            return True
        is_confirmed = evidence is Evidence.BETTER and self.share < 1.0
        if is_confirmed:
            self.share = 1.0
        if correction is not None:
            self.correction, self.change = correction, change or self.change
        return is_confirmed or correction is not None


@dataclass(slots=True)
class Adoption:
    """The way from the pad in force to the one that was found. `configured` is what it may not leave far."""

    configured: AdoptedPad
    now: AdoptedPad
    _start: AdoptedPad | None = None
    _target: AdoptedPad | None = None
    _done: int = 0
    _steps: int = 0

    @classmethod
    def of(cls, configured: AdoptedPad) -> Adoption:
        """Begin with the configured pad."""
        return cls(configured, configured)

    @property
    def is_moving(self) -> bool:
        """Steps are due."""
        return self._target is not None

    def allows(self, correction: Correction) -> bool:
        """Whether what a correction makes of the configured pad is near it."""
        if not abs(1e9 * correction.latency_s) <= FARTHEST_NS:
            return False
        target = correction.of(self.configured)
        is_finite = all(map(math.isfinite, astuple(target.plate_from_pad)))
        return is_finite and target.distance_mm(self.configured) <= FARTHEST_MM

    def request(self, correction: Correction) -> bool:
        """Begin to move to what a correction makes of the configured pad; False where that is too far."""
        if not self.allows(correction):
            return False
        target = correction.of(self.configured)
        late_ns = abs(target.latency_ns - self.now.latency_ns)
        self._steps = max(math.ceil(target.distance_mm(self.now) / STEP_MM), math.ceil(late_ns / STEP_NS))
        self._start, self._target, self._done = self.now, target if self._steps else None, 0
        return True

    def step(self) -> AdoptedPad | None:
        """Return the pad to take now; None where none is due."""
        if self._start is None or self._target is None:
            return None
        self._done += 1
        self.now = _between(self._start, self._target, self._done / self._steps)
        if self._done == self._steps:
            self._target = None
        return self.now


def _between(start: AdoptedPad, target: AdoptedPad, share: float) -> AdoptedPad:
    if share >= 1.0:
        return target
    parts = zip(astuple(start.plate_from_pad), astuple(target.plate_from_pad), strict=True)
    moved = AffineMap(*(before + share * (after - before) for before, after in parts))
    return AdoptedPad(moved, start.latency_ns + round(share * (target.latency_ns - start.latency_ns)))


class Unknown(NamedTuple):
    """One sigma of map, where it was touched, and sensors: arguments of `Machine.adopt_uncertainty`."""

    touched_map_frac: float
    touched_mm: tuple[float, ...]
    sensors_frac: float

    @classmethod
    def configured(cls, uncertainty: UncertaintyConfig) -> Unknown:
        """Return what is configured."""
        return cls(uncertainty.touched_map_frac, uncertainty.touched_mm, uncertainty.sensors_frac)

    def part(self, share: float, uncertainty: UncertaintyConfig) -> Unknown:
        """Return the same with a share of the change that was found: the rest is as unknown as is configured."""
        map_frac, sensors_frac = (
            math.hypot(share * found, (1.0 - share) * before)
            for found, before in (
                (self.touched_map_frac, uncertainty.map_frac),
                (self.sensors_frac, uncertainty.sensors_frac),
            )
        )
        return Unknown(map_frac, self.touched_mm, sensors_frac)


class PlateChange(NamedTuple):
    """Shapes and sensors, which were found together: arguments of `Machine.adopt_map` and `adopt_readings`; and what is
    not known of them."""

    shapes: bytes
    steepest_1_mm: float
    d: tuple[float, ...]
    q: tuple[float, ...]
    unknown: Unknown

    @classmethod
    def none(cls, scanned: ModeShapes, uncertainty: UncertaintyConfig) -> PlateChange:
        """Return the plate as it was scanned, with sensors as they were calibrated."""
        exact = np.eye(scanned.M).ravel()
        shapes = scanned.shapes.astype("<f4").tobytes()
        return cls(
            *(shapes, scanned.steepest_1_mm(), tuple(exact.tolist()), (0.0,) * len(exact)),
            Unknown.configured(uncertainty),
        )

    def part(self, share: float, scanned: ModeShapes, uncertainty: UncertaintyConfig) -> PlateChange:
        """Return the plate so far on the way from the scanned one; it is at most as steep as is said."""
        shapes = scanned.shapes + share * (shapes_of(self.shapes, scanned) - scanned.shapes)
        steepest_1_mm = scanned.steepest_1_mm() + share * (self.steepest_1_mm - scanned.steepest_1_mm())
        exact = np.eye(scanned.M)
        readings = (exact + share * (self.readings(scanned.M) - exact)).ravel()
        return PlateChange(
            *(shapes.astype("<f4").tobytes(), steepest_1_mm),
            *(tuple(readings.real.tolist()), tuple(readings.imag.tolist())),
            self.unknown.part(share, uncertainty),
        )

    def is_near(self, scanned: ModeShapes) -> bool:
        """Whether it can be the plate that was scanned. Raises ValueError for shapes on another grid, or readings of
        another number of sensors."""
        with np.errstate(over="ignore", invalid="ignore"):
            away = shapes_of(self.shapes, scanned) - scanned.shapes
            change_frac = float(np.sqrt(np.mean(away**2) / np.mean(scanned.shapes**2)))
            place_frac = float(np.abs(away).max() / np.abs(scanned.shapes).max())
            readings = np.abs(self.readings(scanned.M) - np.eye(scanned.M)).max()
        steeper = self.steepest_1_mm / scanned.steepest_1_mm()
        is_map = change_frac <= FARTHEST_MAP_FRAC and place_frac <= FARTHEST_PLACE_FRAC
        return bool(is_map and readings <= FARTHEST_READING and 1.0 / STEEPER <= steeper <= STEEPER)

    def readings(self, modes: int) -> npt.NDArray[np.complex128]:
        """Return what the sensors read of true amplitudes (M, M)."""
        return (np.array(self.d) + 1j * np.array(self.q)).reshape(modes, modes)


def is_load_near(load_1_s: complex, configured: ParasiticModes | None) -> bool:
    """Whether a finger can have this load on the plate whose parasitic modes are configured."""
    if configured is None or not cmath.isfinite(load_1_s):
        return False
    usual_1_s = abs(complex(configured.finger_decay_1_s, configured.finger_detuning_rad_s))
    return load_1_s.real > 0.0 and abs(load_1_s) <= FARTHEST_LOAD * usual_1_s


def shapes_of(data: bytes, modes: ModeShapes) -> npt.NDArray[Any]:
    """Return float32 shapes (M, ny, nx) on the grid of a map. Raises ValueError for another number of them."""
    return np.frombuffer(data, "<f4").reshape(modes.shapes.shape).astype(np.float64)
