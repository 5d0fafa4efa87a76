"""Where a finger will be: `make_predictor()` gives an object that takes samples and foretells positions.

A predictor is an intake and a motion model. The intake is the same for all: it refuses what is no sample, drops the
stale duplicates that touchpads send, and finds from the stamps when each sample was really taken
(`prediction_clock`). The model (`prediction_bank` by default) sees clean samples at true times and estimates the
motion. The models that lost to it
are in `hapticd.bench.baselines`.

Every difference of instants is taken in integers before it becomes a float: the result does not depend on where time
starts, to the last bit.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from numbers import Real
from typing import Final

from ..touch.sample_clock import SampleClock
from .bank import ModelBank
from .motion import MotionModel, Sample, checked

LONGEST_HORIZON_S: Final = 0.050  # beyond, a prediction is a guess: the position stays where it would be then

_FARTHEST_MM: Final = 1e6  # a coordinate beyond is no position on any plate
_GAP_PERIODS: Final = 5.5  # after five lost samples the motion before them says nothing: the touch starts anew
_STALE_STEP_MM: Final = 0.3  # a finger that made such a step cannot be at exactly the same counts one sample later

# The nominal period is that of a Magic Trackpad 2; the clock finds that of another pad within some samples.
_INTAKE_DEFAULTS: dict[str, float] = {"period_ms": 11.25, "period_error_ms": 1.0, "stamp_error_ms": 0.6}


class Predictor:
    """One finger's predictor; make it with `make_predictor`, one for each touch.

    `update(t_ns, x_mm, y_mm)` takes a sample, `predict(t_ns)` gives the position (x_mm, y_mm) and `velocity(t_ns)` the
    velocity (mm/s) at an instant: NaN before the first sample, finite from then on. Instants up to the last sample
    give the filtered last position; horizons are cut at `LONGEST_HORIZON_S`.
    """

    __slots__ = ("_clock", "_fresh_clock", "_model", "_moved", "_t_ns", "_x_mm", "_y_mm")

    def __init__(self, model: MotionModel, fresh_clock: Callable[[], SampleClock]) -> None:
        self._model = model
        self._fresh_clock = fresh_clock
        self.reset()

    def reset(self) -> None:
        """Forget everything, as if newly made."""
        self._clock = self._fresh_clock()
        self._t_ns: int | None = None
        self._x_mm = self._y_mm = math.nan
        self._moved = False

    def update(self, t_ns: int, x_mm: float, y_mm: float) -> None:
        """Take the sample stamped `t_ns`. Ignored: what is no position, and stamps that do not increase."""
        if not (-_FARTHEST_MM <= x_mm <= _FARTHEST_MM and -_FARTHEST_MM <= y_mm <= _FARTHEST_MM):
            return
        if self._t_ns is None:
            self._start(t_ns, x_mm, y_mm)
            return
        elapsed_s = (t_ns - self._t_ns) * 1e-9
        if elapsed_s > _GAP_PERIODS * self._clock.period_s:
            self._start(t_ns, x_mm, y_mm)
            return
        if elapsed_s <= 0.0 or self._is_stale(x_mm, y_mm):
            return
        interval_s = self._clock.advance(elapsed_s)
        sample = Sample(interval_s, self._clock.period_s, x_mm, y_mm)
        self._model.step(sample)
        dx_mm, dy_mm = x_mm - self._x_mm, y_mm - self._y_mm
        self._moved = dx_mm * dx_mm + dy_mm * dy_mm > _STALE_STEP_MM * _STALE_STEP_MM
        self._t_ns, self._x_mm, self._y_mm = t_ns, x_mm, y_mm

    def predict(self, t_ns: int) -> tuple[float, float]:
        """Position in mm at `t_ns`."""
        return self._model.position(self._ahead_s(t_ns))

    def velocity(self, t_ns: int) -> tuple[float, float]:
        """Velocity in mm/s at `t_ns`."""
        return self._model.velocity(self._ahead_s(t_ns))

    def _start(self, t_ns: int, x_mm: float, y_mm: float) -> None:
        self._clock.restart()
        self._model.start(x_mm, y_mm)
        self._moved = False
        self._t_ns, self._x_mm, self._y_mm = t_ns, x_mm, y_mm

    def _is_stale(self, x_mm: float, y_mm: float) -> bool:
        """A moving finger's sample that repeats the last one exactly. One in a row: a second one means it stopped."""
        repeats = self._moved and x_mm == self._x_mm and y_mm == self._y_mm
        self._moved = self._moved and not repeats
        return repeats

    def _ahead_s(self, t_ns: int) -> float:
        if self._t_ns is None:
            return math.nan
        ahead_s = (t_ns - self._t_ns) * 1e-9 + self._clock.lag_s
        if ahead_s <= 0.0:
            return 0.0
        return ahead_s if ahead_s <= LONGEST_HORIZON_S else LONGEST_HORIZON_S


@dataclass(frozen=True, slots=True)
class PredictorFactory:
    """How predictors of one kind are made: call it with settings. `defaults` names them all, intake and model."""

    model: Callable[..., MotionModel]
    model_settings: frozenset[str]
    defaults: dict[str, float]

    @classmethod
    def of(cls, model: Callable[..., MotionModel]) -> PredictorFactory:
        """The recipe for a model: its settings are the keyword arguments of its constructor."""
        own = inspect.signature(model).parameters
        own_defaults = {name: setting.default for name, setting in own.items() if name not in _INTAKE_DEFAULTS}
        return cls(model, frozenset(own), _INTAKE_DEFAULTS | own_defaults)

    def __call__(self, **settings: object) -> Predictor:
        """A predictor for one touch; ValueError names the valid settings, or the bounds of a value."""
        chosen = self.defaults.copy()
        for name, value in settings.items():
            if name not in chosen:
                raise ValueError(f"Unknown predictor setting {name!r}: choose from {', '.join(sorted(chosen))}.")
            if not isinstance(value, Real):
                raise ValueError(f"Predictor setting {name} is {value!r}: give a number from its range.")
            chosen[name] = float(value)
        period_ms = checked("period_ms", chosen["period_ms"], 0.5, 50.0)
        period_error_ms = checked("period_error_ms", chosen["period_error_ms"], 0.0, 10.0)
        stamp_error_ms = checked("stamp_error_ms", chosen["stamp_error_ms"], 0.0, 10.0)
        model = self.model(**{name: chosen[name] for name in self.model_settings})
        return Predictor(model, partial(SampleClock, 1e-3 * period_ms, 1e-3 * period_error_ms, 1e-3 * stamp_error_ms))


DEFAULT: Final = PredictorFactory.of(ModelBank)


def make_predictor(name: str = "default", **settings: float) -> Predictor:
    """Return a predictor for one touch; `DEFAULT.defaults` lists its settings. ValueError names what is valid.

    The pad: its nominal `period_ms` and how wrong that may be, `period_error_ms` (standard error); `stamp_error_ms`,
    the standard error of one time stamp, 0 to take stamps as they are; `noise_mm`, the standard error of one position
    on one axis, which matters most: it is a first guess, and then measured. The first predictor of a (period, noise)
    takes some 0.2 s to compute gains: make one at start-up.
    """
    if name != "default":
        raise ValueError(f'Unknown predictor {name!r}: the core has "default"; hapticd.bench.baselines has the others.')
    return DEFAULT(**settings)
