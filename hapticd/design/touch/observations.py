"""Observations of the plate and its fingers by a recording, in short windows that share their finger loads."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ...values import ComplexArray, FloatArray

WINDOW_S = 0.02  # loads are constant within it: real ones change within 10 to 20 ms
FEWEST_IN_WINDOW = 4  # samples, for the loads of two fingers to be determined
MOST_FINGERS = 3  # down at once: loads of more take memory and time with each, and each tells less
_FEW_MODES, _TICKS_ON_FEW, _TICKS = 3, 3, 5  # that are averaged: all costs fall with their number
_SESSION_S = 1e5  # more than any recording lasts
_SMOOTHED = 3  # samples of a finger to either side of each, through which a cubic is fitted


@dataclass(frozen=True, slots=True)
class Track:
    """One touch: reported instants (n,), smoothed positions (n, 2) and velocities (n, 2), n at least 7; `axis_mm` is
    the mean axis of the ellipse that the pad reported, NaN without one; `session` counts from 0."""

    t_s: FloatArray
    xy_mm: FloatArray
    velocity_mm_s: FloatArray
    axis_mm: float = math.nan
    session: int = 0

    @classmethod
    def of(cls, t_s: FloatArray, xy_mm: FloatArray, axis_mm: float = math.nan) -> Track:
        """Smooth reported positions by a cubic through each sample and its six neighbours."""
        count, width = len(t_s), 2 * _SMOOTHED + 1
        if count < width:
            raise ValueError(f"a track has {count} samples: give at least {width}.")
        first = np.clip(np.arange(count) - _SMOOTHED, 0, count - width)
        near = first[:, None] + np.arange(width)
        scale_s = 1e-2  # keeps the powers near 1
        powers = ((t_s[near] - t_s[:, None]) / scale_s)[..., None] ** np.arange(4)
        cubic = np.linalg.pinv(powers)[:, :2] @ xy_mm[near]
        return cls(t_s, cubic[:, 0], cubic[:, 1] / scale_s, axis_mm)

    def at(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions (..., 2) and velocities (..., 2) by cubic Hermite interpolation; NaN outside the touch."""
        place = np.clip(np.searchsorted(self.t_s, t_s, side="right") - 1, 0, len(self.t_s) - 2)
        span_s = (self.t_s[place + 1] - self.t_s[place])[..., None]
        u = (t_s - self.t_s[place])[..., None] / span_s
        low, high = self.xy_mm[place], self.xy_mm[place + 1]
        low_slope, high_slope = self.velocity_mm_s[place] * span_s, self.velocity_mm_s[place + 1] * span_s
        square, cube = 3.0 * (high - low) - 2.0 * low_slope - high_slope, 2.0 * (low - high) + low_slope + high_slope
        position = ((cube * u + square) * u + low_slope) * u + low
        velocity = ((3.0 * cube * u + 2.0 * square) * u + low_slope) / span_s
        is_in = ((t_s >= self.t_s[0]) & (t_s <= self.t_s[-1]))[..., None]
        return np.where(is_in, position, np.nan), np.where(is_in, velocity, np.nan)


@dataclass(frozen=True, slots=True)
class Ticks:
    """T control ticks of the board, M modes and as many amplifiers.

    `t_s` (T,) is the middle of the tick whose mean amplitude moves by `slope_um_s` (T, M) under `voltage_v` (T, M);
    `measured_um` (T, M) is extrapolated to it. `behind_um_s` (T, M): measured less reference, per tick, which the
    control law takes back. `turning_rad_s` (T,): by how much the frame turns faster than at the start.
    """

    t_s: FloatArray
    measured_um: ComplexArray
    voltage_v: ComplexArray
    slope_um_s: ComplexArray
    behind_um_s: ComplexArray
    turning_rad_s: FloatArray


@dataclass(frozen=True, slots=True)
class Windows(Ticks):
    """B windows of up to S ticks and N fingers: the fields of `Ticks` as (B, S) and (B, S, M).

    `is_used` (B, S) masks the padding. `track` (B, N) is the touch of each finger, -1 for none.
    """

    is_used: npt.NDArray[np.bool_]
    track: npt.NDArray[np.int64]
    tracks: tuple[Track, ...]

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def start_s(self) -> FloatArray:
        """The first instant of each window (B,)."""
        return self.t_s[:, 0]

    @property
    def sessions(self) -> list[npt.NDArray[np.bool_]]:
        """Windows (B,) of each session."""
        of_track = np.array([one.session for one in self.tracks], np.int64)
        session = of_track[self.track[:, 0]]
        return [session == one for one in np.unique(session)]

    def part(self, chosen: npt.NDArray[np.bool_] | npt.NDArray[np.int64] | slice) -> Windows:
        """Return the chosen windows, by a mask (B,) or their indices."""
        arrays = {one.name: getattr(self, one.name)[chosen] for one in fields(self) if one.name != "tracks"}
        return replace(self, **arrays)

    def fingers_mm(self, shift_s: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities (B, S, N, 2) as reported, `shift_s` later; NaN where there is no finger."""
        shape = (*self.t_s.shape, self.track.shape[1], 2)
        position, velocity = np.full(shape, np.nan), np.full(shape, np.nan)
        for index, track in enumerate(self.tracks):
            window, slot = np.nonzero(self.track == index)
            position[window, :, slot], velocity[window, :, slot] = track.at(self.t_s[window] + shift_s)
        return position, velocity


def in_sessions(sessions: Sequence[tuple[Ticks, Sequence[Track]]]) -> tuple[Ticks, tuple[Track, ...]]:
    """Return ticks and tracks of several sessions as one, each at a time of its own."""
    arrays: dict[str, Any] = {
        one.name: np.concatenate([getattr(ticks, one.name) for ticks, _ in sessions]) for one in fields(Ticks)
    }
    late_s = np.repeat(_SESSION_S * np.arange(len(sessions)), [len(ticks.t_s) for ticks, _ in sessions])
    tracks = tuple(
        replace(one, t_s=one.t_s + session * _SESSION_S, session=session)
        for session, (_, touches) in enumerate(sessions)
        for one in touches
    )
    return replace(Ticks(**arrays), t_s=arrays["t_s"] + late_s), tracks


def in_windows(ticks: Ticks, tracks: Sequence[Track], most_shift_s: float) -> Windows:
    """Group ticks into windows in which the same fingers are down, also `most_shift_s` earlier and later.

    Ticks without a finger or with more than MOST_FINGERS, and windows of too few, are left out. Ticks next to each
    other are averaged: a finger moves by a millimetre meanwhile.
    """
    ends_s = np.array([(one.t_s[0] + most_shift_s, one.t_s[-1] - most_shift_s) for one in tracks]).reshape(-1, 2, 1)
    is_down = (ticks.t_s > ends_s[:, 0]) & (ticks.t_s < ends_s[:, 1])
    cell = np.floor(ticks.t_s / WINDOW_S)
    is_new = (np.diff(cell) != 0) | (np.diff(is_down, axis=1) != 0).any(axis=0)
    groups = np.split(np.arange(len(ticks.t_s)), np.flatnonzero(is_new) + 1)
    count = is_down.sum(axis=0)
    kept = [one for one in groups if len(one) >= FEWEST_IN_WINDOW and 0 < count[one[0]] <= MOST_FINGERS]
    ticks_each = _TICKS_ON_FEW if ticks.measured_um.shape[1] <= _FEW_MODES else _TICKS
    edges = [_edges(group, ticks_each) for group in kept]
    most = max((len(one) - 1 for one in edges), default=1)
    fingers = max((int(is_down[:, group[0]].sum()) for group in kept), default=1)
    place, is_used = np.zeros((len(kept), most), np.int64), np.zeros((len(kept), most), bool)
    track = np.full((len(kept), fingers), -1, np.int64)
    done = 0
    for row, (group, one) in enumerate(zip(kept, edges, strict=True)):
        ticks_in = len(one) - 1
        place[row], is_used[row, :ticks_in] = np.resize(np.arange(done, done + ticks_in), most), True
        down = np.flatnonzero(is_down[:, group[0]])
        track[row, : len(down)] = down
        done += ticks_in
    none = [np.zeros(0, np.int64)]
    first, after = (np.concatenate(none + [one[part] for one in edges]) for part in (slice(-1), slice(1, None)))
    arrays: dict[str, Any] = {one.name: _means(getattr(ticks, one.name), first, after)[place] for one in fields(Ticks)}
    return Windows(**arrays, is_used=is_used, track=track, tracks=tuple(tracks))


def _edges(group: npt.NDArray[np.int64], averaged: int) -> npt.NDArray[np.int64]:
    """Divide a window's ticks into parts of about `averaged`, at least two, as the loads of two fingers need."""
    parts = max(2, round(len(group) / averaged))
    return np.asarray(group[0] + len(group) * np.arange(parts + 1) // parts)


def _means(values: Any, first: npt.NDArray[np.int64], after: npt.NDArray[np.int64]) -> Any:
    """Return the means of `values` (T, ..) from each first index to the one after."""
    summed = np.concatenate((np.zeros_like(values[:1]), np.cumsum(values, axis=0)))
    return (summed[after] - summed[first]) / (after - first).reshape(-1, *[1] * (values.ndim - 1))
