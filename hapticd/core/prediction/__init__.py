"""Finger prediction: `make_predictor()` returns an object that takes samples and predicts positions.

In the touch path one clock serves all fingers, and each has a `motion.AdaptivePredictor`; `hapticd.bench.baselines` has
others. Every difference of instants is taken in integers before it becomes a float: the result does not depend on
where time starts, to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from numbers import Real

from ..touch.fingers import FingerPredictor, is_position
from ..touch.sensor_clock import GAP_PERIODS, SampleClock
from .motion import AdaptivePredictor
from .pad_memory import PadMemory

# The settings of a predictor with their bounds. The period is that of a Magic Trackpad 2; the clock finds that of
# another pad within some samples.
DEFAULTS = {"period_ms": 11.25, "period_error_ms": 1.0, "stamp_error_ms": 0.6, "noise_mm": 0.053}
_BOUNDS = {
    "period_ms": (0.5, 50.0),
    "period_error_ms": (0.0, 10.0),
    "stamp_error_ms": (0.0, 10.0),
    "noise_mm": (1e-4, 10.0),
}


class Predictor:
    """One touch's predictor with its own clock, for use without a pad-wide one: it takes the device's stamps, whose
    jitter is filtered out first."""

    def __init__(self, fresh: Callable[[], FingerPredictor], settings: dict[str, float] = DEFAULTS) -> None:
        self._fresh = fresh
        self._clock_s = [1e-3 * settings[name] for name in ("period_ms", "period_error_ms", "stamp_error_ms")]
        self.reset()

    def reset(self) -> None:
        """Drop all samples, and what was learned of the stamps; what was learned of the pad stays in its memory."""
        self._touch = self._fresh()
        self._clock = SampleClock(*self._clock_s)
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
        """Return the position in mm at `t_ns`: NaN before the first sample."""
        return self._touch.predict(t_ns)

    def covariance(self, t_ns: int) -> tuple[float, float, float]:
        """Return xx, xy, yy in mm^2 of the predicted position's error at `t_ns`."""
        return self._touch.covariance(t_ns)


def make_predictor(name: str = "default", *, memory: PadMemory | None = None, **settings: float) -> Predictor:
    """Return a predictor for one touch. ValueError names what is valid.

    The pad: its nominal `period_ms` and how wrong that may be, `period_error_ms` (standard error); `stamp_error_ms`,
    the standard error of one time stamp, 0 to take stamps as they are; `noise_mm`, the standard error of one position
    on one axis: what it misses is learned, and serves the other predictors with the same `memory`. The first predictor
    of a (period, noise) takes some 0.1 s to compute gains: make one at start-up.
    """
    if name != "default":
        raise ValueError(f'Unknown predictor {name!r}: the core has "default"; hapticd.bench.baselines has the others.')
    for setting, value in settings.items():
        low, high = _BOUNDS.get(setting, (0.0, 0.0))
        if setting not in _BOUNDS:
            raise ValueError(f"Unknown predictor setting {setting!r}: choose from {', '.join(sorted(_BOUNDS))}.")
        if not (isinstance(value, Real) and low <= value <= high):
            raise ValueError(f"Predictor setting {setting} is {value!r}: give a number from {low:g} to {high:g}.")
    chosen = DEFAULTS | settings
    model = partial(AdaptivePredictor, period_ms=chosen["period_ms"], noise_mm=chosen["noise_mm"], memory=memory)
    return Predictor(model, chosen)
