"""Adoption of a corrected pad in small steps: no finger's position moves by more than STEP_MM at once.

Pure: what is adopted when is the caller's, and each step is an input of the machine.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, fields
from typing import NamedTuple

from ..config.sections import Config
from ..values import AffineMap
from .settings import plate_from_pad

STEP_MM = 0.002  # less than a pad resolves; as a filter's noise it moves a reference by 0.2 % of itself
STEP_NS = 20_000  # of latency: 2 um at 10 cm/s
LATENCY_NS = (0, 50_000_000)  # the bounds of trackpad.latency_ms
FARTHEST_MM, FARTHEST_NS = 3.0, 10_000_000  # from the configuration: beyond, something else is wrong
_CORNER_MM = 100.0  # of the largest plate


class Pad(NamedTuple):
    """Where the pad lies, and how late it reports."""

    plate_from_pad: AffineMap
    latency_ns: int

    def distance_mm(self, other: Pad) -> float:
        """Return the most by which a position on the plate differs."""
        corners = [(x_mm, y_mm) for x_mm in (-_CORNER_MM, _CORNER_MM) for y_mm in (-_CORNER_MM, _CORNER_MM)]
        return max(math.dist(self.plate_from_pad.apply(*one), other.plate_from_pad.apply(*one)) for one in corners)


def configured_pad(config: Config) -> Pad:
    """Return the pad as configured."""
    return Pad(plate_from_pad(config), round(config.trackpad.latency_ms * 1e6))


class Correction(NamedTuple):
    """What touches show: from where fingers were taken to be to where they are, and how much later they were there."""

    matrix: tuple[float, float, float, float]
    offset_mm: tuple[float, float]
    latency_s: float

    def of(self, pad: Pad) -> Pad:
        """Return the corrected pad."""
        xx, xy, yx, yy = self.matrix
        before = pad.plate_from_pad
        after = AffineMap(
            xx * before.xx + xy * before.yx,
            xx * before.xy + xy * before.yy,
            yx * before.xx + yy * before.yx,
            yx * before.xy + yy * before.yy,
            xx * before.offset_x_mm + xy * before.offset_y_mm + self.offset_mm[0],
            yx * before.offset_x_mm + yy * before.offset_y_mm + self.offset_mm[1],
        )
        low_ns, high_ns = LATENCY_NS
        return Pad(after, round(min(max(pad.latency_ns + 1e9 * self.latency_s, low_ns), high_ns)))


@dataclass(slots=True)
class Adoption:
    """The way from the pad in force to a corrected one. `configured` is what it may not leave far."""

    configured: Pad
    now: Pad
    _start: Pad | None = None
    _target: Pad | None = None
    _done: int = 0
    _steps: int = 0

    @classmethod
    def of(cls, configured: Pad) -> Adoption:
        """Begin with the configured pad."""
        return cls(configured, configured)

    @property
    def is_moving(self) -> bool:
        """Steps are due."""
        return self._target is not None

    def request(self, correction: Correction) -> bool:
        """Begin to move to the pad that a correction makes of the present one; False where that is too far."""
        if not abs(1e9 * correction.latency_s) <= FARTHEST_NS:
            return False
        target = correction.of(self.now)
        is_finite = all(map(math.isfinite, astuple(target.plate_from_pad)))
        if not is_finite or not target.distance_mm(self.configured) <= FARTHEST_MM:
            return False
        if abs(target.latency_ns - self.configured.latency_ns) > FARTHEST_NS:
            return False
        late_ns = abs(target.latency_ns - self.now.latency_ns)
        self._steps = max(math.ceil(target.distance_mm(self.now) / STEP_MM), math.ceil(late_ns / STEP_NS))
        self._start, self._target, self._done = self.now, target if self._steps else None, 0
        return True

    def step(self) -> Pad | None:
        """Return the pad to take now; None where none is due."""
        if self._start is None or self._target is None:
            return None
        self._done += 1
        self.now = _between(self._start, self._target, self._done / self._steps)
        if self._done == self._steps:
            self._target = None
        return self.now


def _between(start: Pad, target: Pad, share: float) -> Pad:
    if share >= 1.0:
        return target
    names = [one.name for one in fields(AffineMap)]
    parts = ((getattr(start.plate_from_pad, name), getattr(target.plate_from_pad, name)) for name in names)
    moved = AffineMap(*(before + share * (after - before) for before, after in parts))
    return Pad(moved, start.latency_ns + round(share * (target.latency_ns - start.latency_ns)))
