"""Finger prediction: `make_predictor()` returns an object that takes samples and predicts positions.

A predictor is an intake and a motion model. The intake refuses what is no sample, drops the stale duplicates that
touchpads send, and filters the stamps (`core.touch.sensor_clock`; in the touch path one filter serves all fingers). The
model (`adaptive`) gets clean samples at true times and estimates the motion; `hapticd.bench.baselines` has others.

Every difference of instants is taken in integers before it becomes a float: the result does not depend on where time
starts, to the last bit.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from numbers import Real
from typing import Final

from ..touch.sensor_clock import GAP_PERIODS, SampleClock
from .adaptive import AdaptiveMotion, TouchPredictor, is_position
from .motion import MotionModel, checked
from .pad_memory import PadMemory

# The nominal period is that of a Magic Trackpad 2; the clock finds that of another pad within some samples.
_INTAKE_DEFAULTS: dict[str, float] = {"period_ms": 11.25, "period_error_ms": 1.0, "stamp_error_ms": 0.6}


class Predictor:
    """One touch's predictor with its own stamp filter, for use without a pad-wide one.

    As `TouchPredictor`; `update(t_ns, x_mm, y_mm)` takes the device's stamps, whose jitter is filtered out first.
    """

    def __init__(self, fresh_model: Callable[[], MotionModel], fresh_clock: Callable[[], SampleClock]) -> None:
        self._fresh_model = fresh_model
        self._fresh_clock = fresh_clock
        self.reset()

    def reset(self) -> None:
        """Drop all samples, and what was learned of the stamps; what was learned of the pad stays in its memory."""
        self._touch = TouchPredictor(self._fresh_model())
        self._clock = self._fresh_clock()
        self._t_stamp_ns: int | None = None

    def update(self, t_ns: int, x_mm: float, y_mm: float) -> None:
        """Take the sample stamped `t_ns`. Ignored: what is no position, and stamps that do not increase."""
        if not is_position(x_mm, y_mm):
            return
        if self._t_stamp_ns is not None:
            elapsed_s = (t_ns - self._t_stamp_ns) * 1e-9
            is_gap = elapsed_s > GAP_PERIODS * self._clock.period_s
            if elapsed_s <= 0.0 or (not is_gap and self._touch.is_stale(x_mm, y_mm)):
                return
        self._t_stamp_ns = t_ns
        t_filtered_ns = self._clock.filtered_ns(t_ns)
        self._touch.update(t_filtered_ns, t_filtered_ns, x_mm, y_mm, self._clock.period_s)

    def predict(self, t_ns: int) -> tuple[float, float]:
        """Return the position in mm at `t_ns`."""
        return self._touch.predict(t_ns)

    def velocity(self, t_ns: int) -> tuple[float, float]:
        """Return the velocity in mm/s at `t_ns`."""
        return self._touch.velocity(t_ns)

    def covariance(self, t_ns: int) -> tuple[float, float, float]:
        """Return xx, xy, yy in mm^2 of the predicted position's error at `t_ns`."""
        return self._touch.covariance(t_ns)


@dataclass(frozen=True, slots=True)
class PredictorFactory:
    """How predictors of one kind are made: call it with settings. `defaults` names them all, intake and model.

    With a `memory` what one predictor learns of the pad serves the others that have it; without, each begins with the
    prior.
    """

    model: Callable[..., MotionModel]
    model_settings: frozenset[str]
    defaults: dict[str, float]
    learns: bool

    @classmethod
    def of(cls, model: Callable[..., MotionModel]) -> PredictorFactory:
        """The recipe for a model: its settings are the keyword arguments of its constructor."""
        own = dict(inspect.signature(model).parameters)
        learns = own.pop("memory", None) is not None
        own_defaults = {name: setting.default for name, setting in own.items() if name not in _INTAKE_DEFAULTS}
        return cls(model, frozenset(own), _INTAKE_DEFAULTS | own_defaults, learns)

    def __call__(self, *, memory: PadMemory | None = None, **settings: object) -> Predictor:
        """Return a predictor for one touch; ValueError names the valid settings, or the bounds of a value."""
        chosen = self._checked(settings)
        clock_s = tuple([1e-3 * chosen[name] for name in ("period_ms", "period_error_ms", "stamp_error_ms")])
        return Predictor(self._model(chosen, memory), partial(SampleClock, *clock_s))

    def for_touch(self, *, memory: PadMemory | None = None, **settings: object) -> TouchPredictor:
        """Return a predictor without a stamp filter; settings and errors as above."""
        return TouchPredictor(self._model(self._checked(settings), memory)())

    def _model(self, chosen: dict[str, float], memory: PadMemory | None) -> Callable[[], MotionModel]:
        own: dict[str, object] = {name: chosen[name] for name in self.model_settings}
        return partial(self.model, **own, memory=memory) if self.learns else partial(self.model, **own)

    def _checked(self, settings: dict[str, object]) -> dict[str, float]:
        chosen = self.defaults.copy()
        for name, value in settings.items():
            if name not in chosen:
                raise ValueError(f"Unknown predictor setting {name!r}: choose from {', '.join(sorted(chosen))}.")
            if not isinstance(value, Real):
                raise ValueError(f"Predictor setting {name} is {value!r}: give a number from its range.")
            chosen[name] = float(value)
        checked("period_ms", chosen["period_ms"], 0.5, 50.0)
        checked("period_error_ms", chosen["period_error_ms"], 0.0, 10.0)
        checked("stamp_error_ms", chosen["stamp_error_ms"], 0.0, 10.0)
        return chosen


DEFAULT: Final = PredictorFactory.of(AdaptiveMotion)


def make_predictor(name: str = "default", **settings: float) -> Predictor:
    """Return a predictor for one touch; `DEFAULT.defaults` lists its settings. ValueError names what is valid.

    The pad: its nominal `period_ms` and how wrong that may be, `period_error_ms` (standard error); `stamp_error_ms`,
    the standard error of one time stamp, 0 to take stamps as they are; `noise_mm`, the standard error of one position
    on one axis: what it misses is learned. The first predictor of a (period, noise) takes some 0.1 s to compute gains:
    make one at start-up.
    """
    if name != "default":
        raise ValueError(f'Unknown predictor {name!r}: the core has "default"; hapticd.bench.baselines has the others.')
    return DEFAULT(memory=None, **settings)
