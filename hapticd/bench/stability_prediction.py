"""How far the predictors' numbers can be trusted: digits of the gains, origins of time, extreme intervals, long runs.

Each row is a name and its figures, units at the end of the names; nothing here is timed. mpmath and scipy are
references that the bench can do without: `skipped` names the rows that are missing then.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..core.prediction.gains import MODELS, STEPS, kalman_gains, process_model
from ..core.prediction.predictor import Predictor
from .baselines import PREDICTORS, make_predictor
from .motions import MOTIONS, Touch, touch
from .timing import optional

Rows = list[tuple[str, Mapping[str, float]]]

ORIGINS_NS = (0, 10**9, 2**53, 2**62, -(2**40) - 1)
INTERVALS_NS = {"0 ns": 0, "1 us": 1_000, "10 s": 10_000_000_000}
LONG_RUN_SAMPLES = 200_000  # 37 minutes without lifting
_PERIOD_NS = 11_250_000
_AHEAD_NS = 15_000_000
_NOISE_MM = 0.053
_STRAY_MM = 0.1
_INTERVALS_S = (0.0005, 0.01125, 0.06)
_DIGITS = 50
_START_VARIANCES = (1e4, 1e5, 1e7)


def run() -> tuple[Rows, dict[str, str]]:
    """All rows, and why some are missing."""
    rows, skipped = [*origins(), *intervals(), *long_run()], {}
    mpmath, linalg = optional("mpmath"), optional("scipy.linalg")
    if mpmath is None:
        skipped["prediction gains against mpmath"] = "mpmath is not installed"
    else:
        rows += gain_digits(mpmath)
    if linalg is None:
        skipped["prediction gains against solve_discrete_are"] = "scipy is not installed"
    else:
        rows += steady_gains(linalg)
    return rows, skipped


def origins() -> Rows:
    """Predictions that change, be it by a bit, when time starts elsewhere: counted over all predictors."""
    played = touch(MOTIONS["slide"], 1)
    rows: Rows = []
    for origin_ns in ORIGINS_NS[1:]:
        changed = sum(
            _foretold(make_predictor(name), played, origin_ns) != _foretold(make_predictor(name), played, 0)
            for name in PREDICTORS
        )
        rows.append((f"prediction, origin {origin_ns} ns", {"changed_count": changed}))
    return rows


def intervals() -> Rows:
    """A sample that comes at once, a microsecond later or after ten seconds: how far the worst predictor is thrown.

    It strays by 0.1 mm, so that it is no stale duplicate. Measured against where the finger was said to be without
    that sample, or, after a pause, against the sample.
    """
    played = touch(MOTIONS["straight"], 1)
    t_ns, x_mm, y_mm = played.samples[-1]
    rows: Rows = []
    for name, interval_ns in INTERVALS_NS.items():
        thrown_mm = []
        for kind in PREDICTORS:
            predictor = make_predictor(kind)
            _foretold(predictor, played, 0)
            expected = predictor.predict(t_ns + _AHEAD_NS) if interval_ns < _PERIOD_NS else (x_mm, y_mm)
            predictor.update(t_ns + interval_ns, x_mm + _STRAY_MM * (interval_ns < _PERIOD_NS), y_mm)
            thrown_mm.append(math.dist(predictor.predict(t_ns + interval_ns + _AHEAD_NS), expected))
        rows.append((f"prediction, interval {name}", {"thrown_mm": max(thrown_mm)}))
    return rows


def long_run() -> Rows:
    """RMS error at the beginning and at the end of a touch of 200 000 samples on circles: no drift, no blow-up."""
    rng = np.random.default_rng(3)
    noise_mm = 0.05 * rng.standard_normal((LONG_RUN_SAMPLES, 2))
    predictor = make_predictor()
    missed_mm2 = []
    for k, (noise_x_mm, noise_y_mm) in enumerate(noise_mm.tolist()):
        t_ns = k * _PERIOD_NS
        x_mm, y_mm = _on_circle(t_ns)
        predictor.update(t_ns, x_mm + noise_x_mm, y_mm + noise_y_mm)
        missed_mm2.append(math.dist(predictor.predict(t_ns + _AHEAD_NS), _on_circle(t_ns + _AHEAD_NS)) ** 2)
    part = LONG_RUN_SAMPLES // 10
    early_mm, late_mm = (math.sqrt(np.mean(some)) for some in (missed_mm2[part // 10 : part], missed_mm2[-part:]))
    return [(f"prediction, {LONG_RUN_SAMPLES} samples", {"early_rms_mm": early_mm, "late_rms_mm": late_mm})]


def gain_digits(mpmath: Any) -> Rows:
    """Correct decimal digits of the gains, the fewest over a table's rows, against the recursion in 50 digits."""
    rows: Rows = []
    for order, density in MODELS:
        for interval_s in _INTERVALS_S:
            ours = kalman_gains([interval_s], [density], _NOISE_MM, order)[:, 0, 0, :order].tolist()
            exact = _exact_gains(mpmath, interval_s, order, density)
            digits = min(
                _correct_digits(mpmath, value, wanted)
                for gain, wanted_gain in zip(ours, exact, strict=True)
                for value, wanted in zip(gain, wanted_gain, strict=True)
            )
            name = f"prediction gains, order {order}, {density:g}, {1e3 * interval_s:g} ms"
            rows.append((name, {"digits_count": digits}))
    return rows


def steady_gains(linalg: Any) -> Rows:
    """How far the last row of each table is from the solution of the algebraic Riccati equation (scipy)."""
    rows: Rows = []
    for order, density in MODELS:
        transition, process = process_model(_INTERVALS_S[1], density, order)
        seen = np.eye(order)[:1]
        ahead = linalg.solve_discrete_are(transition.T, seen.T, process, np.array([[_NOISE_MM**2]]))
        wanted = ahead[:, 0] / (ahead[0, 0] + _NOISE_MM**2)
        last = kalman_gains([_INTERVALS_S[1]], [density], _NOISE_MM, order)[-1, 0, 0, :order]
        off = float(np.max(np.abs(last / wanted - 1.0)))
        rows.append((f"prediction gains, order {order}, {density:g}, sample {STEPS}", {"off_steady_frac": off}))
    return rows


def _foretold(predictor: Predictor, played: Touch, origin_ns: int) -> list[tuple[float, float]]:
    foretold = []
    for t_ns, x_mm, y_mm in played.samples:
        predictor.update(origin_ns + t_ns, x_mm, y_mm)
        foretold.append(predictor.predict(origin_ns + t_ns + _AHEAD_NS))
    return foretold


def _on_circle(t_ns: int) -> tuple[float, float]:
    """Radius 20 mm at 10 cm/s; the angle is reduced in integers, so that the truth itself does not drift."""
    turn_ns = 1_256_637_061  # 2 pi 20 mm / 10 cm/s
    angle_rad = 2.0 * math.pi * (t_ns % turn_ns) / turn_ns
    return 20.0 * math.cos(angle_rad), 20.0 * math.sin(angle_rad)


def _exact_gains(mpmath: Any, interval_s: float, order: int, density: float) -> Sequence[Sequence[Any]]:
    """The matrix Riccati recursion as written in the books."""
    with mpmath.workdps(_DIGITS):
        t, q, noise = (mpmath.mpf(value) for value in (interval_s, density, _NOISE_MM))
        f, process = mpmath.zeros(order), mpmath.zeros(order)
        for i in range(order):
            for j in range(order):
                power = 2 * order - 1 - i - j
                shares = power * mpmath.factorial(order - 1 - i) * mpmath.factorial(order - 1 - j)
                process[i, j] = q * t**power / shares
                f[i, j] = t ** (j - i) / mpmath.factorial(j - i) if j >= i else 0
        p, gains = mpmath.diag([noise**2, *_START_VARIANCES[: order - 1]]), []
        for _ in range(STEPS):
            p = f * p * f.T + process
            k = p[:, 0] / (p[0, 0] + noise**2)
            p = p - k * p[0, :]
            gains.append(list(k))
        return gains


def _correct_digits(mpmath: Any, value: float, wanted: Any) -> float:
    """-log10 of the relative error; 17 where a float has no more."""
    with mpmath.workdps(_DIGITS):
        error = abs(mpmath.mpf(value) / wanted - 1)
        return 17.0 if error == 0 else min(17.0, float(-mpmath.log10(error)))
