"""The motion models that others use, for comparison and for pads that suit them: a few lines each.

All see the same samples at the same filtered times as the default model; only the motion is estimated differently.
Constants were fitted to a bench of slides, reaches, stops and strokes at 100 Hz with 0.05 mm of noise.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from ...core.prediction.motion import Sample, checked
from .motion import QuadraticMotion


class Hold(QuadraticMotion):
    """The finger stays where it was last seen."""

    __slots__ = ()

    def start(self, x_mm: float, y_mm: float) -> None:
        self._move(x_mm, y_mm, 0.0, 0.0)

    def step(self, sample: Sample) -> None:
        self._move(sample.x_mm, sample.y_mm, 0.0, 0.0)


class Linear(QuadraticMotion):
    """A straight line through the last two samples."""

    __slots__ = ()

    def start(self, x_mm: float, y_mm: float) -> None:
        self._move(x_mm, y_mm, 0.0, 0.0)

    def step(self, sample: Sample) -> None:
        interval_s, _, x_mm, y_mm = sample
        self._move(x_mm, y_mm, (x_mm - self._x) / interval_s, (y_mm - self._y) / interval_s)


class AlphaBeta(QuadraticMotion):
    """The alpha-beta filter, critically damped: a least-squares line whose samples fade by `fading` each period.

    Source: Brookner, Tracking and Kalman Filtering Made Easy, 1998, section 1.2 (fading-memory g-h filter).
    """

    __slots__ = ("_alpha", "_beta")

    def __init__(self, *, fading: float = 0.118) -> None:
        super().__init__()
        fading = checked("fading", fading, 0.0, 0.999)
        self._alpha = 1.0 - fading * fading
        self._beta = (1.0 - fading) ** 2

    def start(self, x_mm: float, y_mm: float) -> None:
        self._move(x_mm, y_mm, 0.0, 0.0)

    def step(self, sample: Sample) -> None:
        x = self._x + sample.interval_s * self._vx
        y = self._y + sample.interval_s * self._vy
        ex, ey = sample.x_mm - x, sample.y_mm - y
        rate = self._beta / sample.interval_s
        self._move(x + self._alpha * ex, y + self._alpha * ey, self._vx + rate * ex, self._vy + rate * ey)


class AlphaBetaGamma(QuadraticMotion):
    """The alpha-beta-gamma filter: a least-squares parabola whose samples fade by `fading` each period.

    Source: as `AlphaBeta`, section 1.3 (fading-memory g-h-k filter).
    """

    __slots__ = ("_alpha", "_beta", "_gamma")

    def __init__(self, *, fading: float = 0.435) -> None:
        super().__init__()
        fading = checked("fading", fading, 0.0, 0.999)
        self._alpha = 1.0 - fading**3
        self._beta = 1.5 * (1.0 - fading) ** 2 * (1.0 + fading)
        self._gamma = (1.0 - fading) ** 3

    def start(self, x_mm: float, y_mm: float) -> None:
        self._move(x_mm, y_mm, 0.0, 0.0)

    def step(self, sample: Sample) -> None:
        d = sample.interval_s
        x, y = self.position(d)
        vx, vy = self.velocity(d)
        ex, ey = sample.x_mm - x, sample.y_mm - y
        to_v, to_a = self._beta / d, self._gamma / (d * d)
        self._move(
            x + self._alpha * ex,
            y + self._alpha * ey,
            vx + to_v * ex,
            vy + to_v * ey,
            self._ax + to_a * ex,
            self._ay + to_a * ey,
        )


class DoubleExponential(QuadraticMotion):
    """Exponential smoothing, applied twice; the distance between the two is the slope.

    Source: LaViola, Double Exponential Smoothing: An Alternative to Kalman Filter-Based Predictive Tracking, 2003. It
    assumes equal intervals: the slope is per period, whatever the interval was.
    """

    __slots__ = ("_once_x", "_once_y", "_smoothing", "_twice_x", "_twice_y")

    def __init__(self, *, smoothing: float = 0.884) -> None:
        super().__init__()
        self._smoothing = checked("smoothing", smoothing, 0.001, 0.999)

    def start(self, x_mm: float, y_mm: float) -> None:
        self._once_x = self._twice_x = x_mm
        self._once_y = self._twice_y = y_mm
        self._move(x_mm, y_mm, 0.0, 0.0)

    def step(self, sample: Sample) -> None:
        share = self._smoothing
        self._once_x += share * (sample.x_mm - self._once_x)
        self._once_y += share * (sample.y_mm - self._once_y)
        self._twice_x += share * (self._once_x - self._twice_x)
        self._twice_y += share * (self._once_y - self._twice_y)
        slope = share / ((1.0 - share) * sample.period_s)
        dx, dy = self._once_x - self._twice_x, self._once_y - self._twice_y
        self._move(self._once_x + dx, self._once_y + dy, slope * dx, slope * dy)


class OneEuroLinear(QuadraticMotion):
    """The 1-euro filter, extrapolated along its own smoothed derivative.

    Source: Casiez, Roussel, Vogel, 1-euro Filter, CHI 2012: a low-pass whose cut-off rises with the speed.
    """

    __slots__ = ("_cutoff_hz", "_cutoff_slope", "_derivative_hz", "_raw_x", "_raw_y")

    def __init__(
        self, *, cutoff_hz: float = 0.10, cutoff_hz_per_mm_s: float = 3.16, derivative_cutoff_hz: float = 40.0
    ) -> None:
        super().__init__()
        self._cutoff_hz = checked("cutoff_hz", cutoff_hz, 1e-3, 1e3)
        self._cutoff_slope = checked("cutoff_hz_per_mm_s", cutoff_hz_per_mm_s, 0.0, 1e3)
        self._derivative_hz = checked("derivative_cutoff_hz", derivative_cutoff_hz, 1e-3, 1e3)

    def start(self, x_mm: float, y_mm: float) -> None:
        self._raw_x, self._raw_y = x_mm, y_mm
        self._move(x_mm, y_mm, 0.0, 0.0)

    def step(self, sample: Sample) -> None:
        share = _low_pass_share(self._derivative_hz, sample.interval_s)
        vx = self._vx + share * ((sample.x_mm - self._raw_x) / sample.interval_s - self._vx)
        vy = self._vy + share * ((sample.y_mm - self._raw_y) / sample.interval_s - self._vy)
        self._raw_x, self._raw_y = sample.x_mm, sample.y_mm
        share_x = _low_pass_share(self._cutoff_hz + self._cutoff_slope * abs(vx), sample.interval_s)
        share_y = _low_pass_share(self._cutoff_hz + self._cutoff_slope * abs(vy), sample.interval_s)
        self._move(self._x + share_x * (sample.x_mm - self._x), self._y + share_y * (sample.y_mm - self._y), vx, vy)


def _low_pass_share(cutoff_hz: float, interval_s: float) -> float:
    return 1.0 / (1.0 + 1.0 / (2.0 * math.pi * cutoff_hz * interval_s))


class LeastSquares(QuadraticMotion):
    """A parabola through the last samples, each weighted by exp(-age / window).

    Fitted on polynomials made orthogonal over the very ages at hand (Forsythe, J. SIAM 5(2), 1957): no normal
    equations, so nothing is badly conditioned; a term with too few samples to fix it is left out.
    """

    __slots__ = ("_samples", "_window_s")

    def __init__(self, *, window_ms: float = 17.0) -> None:
        super().__init__()
        self._window_s = 1e-3 * checked("window_ms", window_ms, 1.0, 1000.0)
        self._samples: deque[tuple[float, float, float]] = deque(maxlen=8)

    def start(self, x_mm: float, y_mm: float) -> None:
        self._samples.clear()
        self._samples.append((0.0, x_mm, y_mm))
        self._move(x_mm, y_mm, 0.0, 0.0)

    def step(self, sample: Sample) -> None:
        aged = [(t - sample.interval_s, x, y) for t, x, y in self._samples]
        self._samples.clear()
        self._samples.extend([*aged, (0.0, sample.x_mm, sample.y_mm)])
        times, xs, ys = zip(*self._samples, strict=True)
        parabola = _Parabola(times, [math.exp(t / self._window_s) for t in times])
        x, vx, ax = parabola.fit(xs)
        y, vy, ay = parabola.fit(ys)
        self._move(x, y, vx, vy, ax, ay)


class _Parabola:
    """Polynomials 1, p = t - middle, (t - turn) p - drop: orthogonal over weighted times, of which the last is 0."""

    def __init__(self, times: Sequence[float], weights: list[float]) -> None:
        self._weights = weights
        self._total = sum(weights)
        self._middle = sum(w * t for w, t in zip(weights, times, strict=True)) / self._total
        self._line = [t - self._middle for t in times]
        self._line_norm = sum(w * p * p for w, p in zip(weights, self._line, strict=True))
        turn = sum(w * t * p * p for w, t, p in zip(weights, times, self._line, strict=True)) / self._line_norm
        drop = self._line_norm / self._total
        self._arc = [(t - turn) * p - drop for t, p in zip(times, self._line, strict=True)]
        self._arc_norm = sum(w * p * p for w, p in zip(weights, self._arc, strict=True))
        self._turn, self._drop = turn, drop

    def fit(self, values: Sequence[float]) -> tuple[float, float, float]:
        """Level, slope and second derivative at time 0."""
        weighted = [w * value for w, value in zip(self._weights, values, strict=True)]
        level = sum(weighted) / self._total
        slope = sum(v * p for v, p in zip(weighted, self._line, strict=True)) / self._line_norm
        bend = 0.0
        if len(values) >= 3:
            bend = sum(v * p for v, p in zip(weighted, self._arc, strict=True)) / self._arc_norm
        at_zero = level - slope * self._middle + bend * (self._turn * self._middle - self._drop)
        return at_zero, slope - bend * (self._middle + self._turn), 2.0 * bend
