"""Stamp filters on stamps that are off by up to 6 ms: what is left of it, and whether a filter locks to a wrong phase.

Four kinds of stamps: uniformly wrong; by the same amount too early or too late; batched, as a host that polls stamps
them; and uniformly wrong while the sampler's rate drifts. Stamps never go back. What is left is measured after two
seconds, against the mean of the stamps: a constant delay is not the filter's to find.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from itertools import product
from typing import NamedTuple, Protocol

import numpy as np

from ..core.touch.sample_clock import SampleClock, SlotFilter
from ..values import FloatArray
from .tables import Table, finite_rows
from .timing import REPEATS, compare

KINDS = ("uniform", "two-step", "batched", "drifting")
RATES_HZ, LOST_FRAC = (60.0, 88.9, 125.0, 240.0), (0.0, 0.05)
USUAL_S, WORST_S = 1e-3, 6e-3  # half widths of the stamps' errors
WRONG_S = 1.5e-3  # a mean error beyond is a wrong lock
DEFAULT = "default"

_SETTLED_S = 2.0
_DRIFT_FRAC, _DRIFT_S = 0.002, 2.5  # of the rate, up and down
_LEAST_APART_S = 50e-6
_PERIOD_S, _PERIOD_ERROR_S, _STAMP_ERROR_S = 0.01125, 0.0007, 0.6e-3  # as for the pad


class Filter(Protocol):
    """A filter of stamps."""

    @property
    def lag_s(self) -> float:
        """The last stamp less its sampling time, in s."""

    def advance(self, elapsed_s: float) -> object:
        """Take the next stamp, `elapsed_s` after the last."""


class Train(NamedTuple):
    """Stamps and true sampling times (n,), in s."""

    stamps_s: FloatArray
    sampled_s: FloatArray


class Left(NamedTuple):
    """What a filter leaves of the stamps' errors: mean and RMS, in s."""

    mean_s: float
    rms_s: float

    @property
    def is_wrong(self) -> bool:
        """Whether the filter has locked to a wrong phase."""
        return abs(self.mean_s) > WRONG_S


def train(kind: str, rate_hz: float, lost_frac: float, seed: int, error_s: float, seconds: float = 6.0) -> Train:
    """Return the stamps of a sampler, one of `KINDS`, off by up to `error_s`."""
    rng = np.random.default_rng([seed, int(rate_hz), int(1000 * lost_frac), KINDS.index(kind)])
    s = np.asarray((np.arange(int(seconds * rate_hz)) + rng.uniform()) / rate_hz, np.float64)
    if kind == "drifting":
        turn = 2.0 * math.pi / _DRIFT_S
        s = s + _DRIFT_FRAC / turn * np.sin(turn * s + rng.uniform(0.0, 2.0 * math.pi))
    s = s[rng.random(len(s)) >= lost_frac]
    if kind == "two-step":
        stamps = s + np.where(rng.random(len(s)) < 0.5, -error_s, error_s)
    elif kind == "batched":
        poll_s, first_s = 2.0 * error_s, rng.uniform(0.0, 2.0 * error_s)
        stamps = first_s + poll_s * np.ceil((s - first_s) / poll_s) - error_s
    else:
        stamps = s + rng.uniform(-error_s, error_s, len(s))
    order = _LEAST_APART_S * np.arange(len(s))
    return Train(np.maximum.accumulate(stamps - order) + order, s)


def left(make: Callable[[], Filter], one: Train) -> Left:
    """Return what a fresh filter leaves of a train's errors."""
    late_s = one.stamps_s - one.sampled_s
    is_settled = one.sampled_s > _SETTLED_S
    error_s = (late_s - _lags_s(make, one.stamps_s))[is_settled] - late_s[is_settled].mean()
    return Left(float(error_s.mean()), math.sqrt(float(np.mean(error_s**2))))


def _lags_s(make: Callable[[], Filter], stamps_s: FloatArray) -> FloatArray:
    clock, lags_s = make(), [0.0]
    for elapsed_s in np.diff(stamps_s).tolist():
        clock.advance(elapsed_s)
        lags_s.append(clock.lag_s)
    return np.array(lags_s)


class FixedGains:
    """A phase-locked loop: the share of each error that moves the phase, and of it the period, do not change."""

    __slots__ = ("lag_s", "period_s")
    _PHASE, _PERIOD = 0.1, 0.005

    def __init__(self) -> None:
        self.lag_s, self.period_s = 0.0, _PERIOD_S

    def advance(self, elapsed_s: float) -> None:
        since_s = elapsed_s + self.lag_s
        error_s = since_s - max(1, round(since_s / self.period_s)) * self.period_s
        self.lag_s = (1.0 - self._PHASE) * error_s
        self.period_s += self._PERIOD * error_s


class AsStamped:
    """No filter."""

    lag_s = 0.0

    def advance(self, elapsed_s: float) -> None:
        """Nothing is learned."""


def alternatives() -> dict[str, Callable[[], Filter]]:
    """Return a constructor for each filter, by name."""
    return {
        DEFAULT: partial(SampleClock, _PERIOD_S, _PERIOD_ERROR_S, _STAMP_ERROR_S),
        "good stamps only": partial(SlotFilter, _PERIOD_S, _PERIOD_ERROR_S, _STAMP_ERROR_S, 0.0),
        "bad stamps only": partial(SlotFilter, _PERIOD_S, _PERIOD_ERROR_S, 4.5e-3, 0.0),
        "fixed gains": FixedGains,
        "as stamped": AsStamped,
    }


def run(*, seeds: Sequence[int] = range(10), repeats: int = REPEATS) -> Table:
    """Compare the filters on trains of six seconds: each kind, rate and share of lost samples, for each seed."""
    filters = alternatives()
    timed = train("uniform", 88.9, 0.0, 0, USUAL_S).stamps_s
    calls = {name: (partial(_lags_s, make, timed), len(timed)) for name, make in filters.items()}
    times = compare(calls, repeats)
    rows = []
    for name, make in filters.items():
        usual = [left(make, train("uniform", hz, lost, seed, USUAL_S)) for hz, lost, seed in _cases(seeds)]
        worst = {
            kind: [left(make, train(kind, hz, lost, seed, WORST_S)) for hz, lost, seed in _cases(seeds)]
            for kind in KINDS
        }
        figures = times[name].figures() | {"usual_ms": _rms_ms(usual)}
        figures |= {f"{kind.replace('-', '_')}_ms": _rms_ms(found) for kind, found in worst.items()}
        every = [one for found in worst.values() for one in found]
        figures["farthest_ms"] = 1e3 * max(abs(one.mean_s) for one in every)
        figures["wrong_locks_count"] = sum(one.is_wrong for one in every)
        rows.append((name, figures))
    return Table(
        name="stamps",
        title="prediction/stamps: RMS of what a filter leaves of the stamps' errors",
        default=DEFAULT,
        rows=finite_rows(rows),
        compared=("time_us", "usual_ms"),
        time="time_us",
        error="usual_ms",
        notes=(
            "time: one stamp. Usual: uniform within 1 ms, others within 6 ms; 60, 88.9, 125 and 240 Hz, 0 and 5 % lost",
            f"farthest: the largest mean error of a run, after {_SETTLED_S:g} s; wrong locks: runs with more than "
            f"{1e3 * WRONG_S:g} ms, of {len(KINDS) * len(_cases(seeds))}",
        ),
    )


def _cases(seeds: Sequence[int]) -> list[tuple[float, float, int]]:
    return list(product(RATES_HZ, LOST_FRAC, seeds))


def _rms_ms(found: Sequence[Left]) -> float:
    return 1e3 * math.sqrt(sum(one.rms_s**2 for one in found) / len(found))
