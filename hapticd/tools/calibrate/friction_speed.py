"""Speed dependence of the friction curve: how much more amplitude a sliding finger needs for the same friction.

    friction(a, v) = bare(v) F(a / (1 + v / v0)),    bare(v) proportional to v^n

A finger on a film of air feels the amplitude alone (v0 infinite; M. Wiertlewski et al., PNAS 113 (2016) 9210); in the
model of intermittent contact friction depends on the ratio of the glass's velocity to the finger's (v0 far below v;
E. Vezzoli et al., IEEE Trans. Haptics 10 (2017) 196, measured by T. Sednaoui et al., ibid. 208). One v0 covers both and
what is between. n is that of bare glass, by regression of logarithms. F is a polyline of as many knots for each v0, so
that the residuals of two v0 may be compared. A v0 is adopted only if it is far more likely than none (BIC).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...values import FloatArray

BARE_UM = 0.02  # up to here the glass counts as bare
LEAST_SPAN = 3.0  # of the speeds, ninth decile over first: less shows no dependence
LEAST_BARE = 4  # readings of bare glass, for its own dependence on speed
LEAST_LEVELS = 4  # amplitudes among the slow readings, and among the fast ones
LEAST_BIC = 10.0  # "very strong" evidence (Kass and Raftery, J. Am. Stat. Assoc. 90 (1995) 773)
KNOTS = 9  # of F
TRIED = 121  # v0, from a thirtieth of the slowest speed to thirty times the fastest
CLIP_SIGMA = 5.0  # a wrong reading counts no more than this
LEVELS = 24  # into which amplitudes are sorted once each reading has its own


class SpeedFit(NamedTuple):
    """`speed_mm_s` is v0, inf without a dependence, and `sentence` says why; `amplitude_um` and `friction` (N,) are the
    readings as they would have been at rest."""

    speed_mm_s: float
    sentence: str
    amplitude_um: FloatArray
    friction: FloatArray


def fit_speed(amplitude_um: FloatArray, friction: FloatArray, speed_mm_s: FloatArray | None) -> SpeedFit:
    """Fit v0 to readings (N,) whose speeds are known, or say why not."""
    missing = "The readings have no speed_mm_s" if speed_mm_s is None else _missing(amplitude_um, speed_mm_s)
    if speed_mm_s is None or missing:
        return SpeedFit(math.inf, f"{missing}: the curve is taken as that of all speeds.", amplitude_um, friction)
    relative = friction / _of_bare(amplitude_um, friction, speed_mm_s)
    slow, fast, count = float(speed_mm_s.min()), float(speed_mm_s.max()), len(amplitude_um)
    tried = [math.inf, *np.geomspace(slow / 30.0, fast * 30.0, TRIED).tolist()]
    residuals = np.abs([_residuals(amplitude_um / (1.0 + speed_mm_s / v0), relative) for v0 in tried])
    clip = CLIP_SIGMA * 1.4826 * float(np.median(residuals[0])) + 1e-9
    squares = np.maximum((np.minimum(residuals, clip) ** 2).sum(axis=1), 1e-30)
    v0 = tried[int(np.argmin(squares))]
    if count * math.log(squares[0] / squares.min()) - math.log(count) < LEAST_BIC:
        why = f"Speed changes nothing that the readings show, from {slow:.0f} to {fast:.0f} mm/s."
        return SpeedFit(math.inf, why, amplitude_um, friction)
    sentence = f"A finger at {v0:.0f} mm/s needs twice the amplitude of one at rest."
    return SpeedFit(v0, sentence, _sorted_um(amplitude_um / (1.0 + speed_mm_s / v0)), relative)


def _missing(amplitude_um: FloatArray, speed_mm_s: FloatArray) -> str:
    """Return what the readings lack for a fit; empty if nothing."""
    first, ninth = np.quantile(speed_mm_s, (0.1, 0.9))
    is_bare, is_fast = amplitude_um <= BARE_UM, speed_mm_s > np.median(speed_mm_s)
    if ninth < LEAST_SPAN * first:
        return f"The speeds span less than a factor of {LEAST_SPAN:g}"
    if is_bare.sum() < LEAST_BARE or np.ptp(speed_mm_s[is_bare]) == 0.0:
        return "Bare glass was not measured at several speeds"
    if min(len(np.unique(amplitude_um[half])) for half in (is_fast, ~is_fast)) < LEAST_LEVELS:
        return f"Slow and fast readings have fewer than {LEAST_LEVELS} amplitudes each"
    return ""


def _of_bare(amplitude_um: FloatArray, friction: FloatArray, speed_mm_s: FloatArray) -> FloatArray:
    """Return bare glass's friction at each reading's speed, relative to that at the median speed."""
    ratio = np.log(speed_mm_s / np.median(speed_mm_s))
    is_good = (amplitude_um <= BARE_UM) & (friction > 0.0)
    if is_good.sum() < LEAST_BARE:
        return np.ones(len(friction))
    slope = np.polynomial.Polynomial.fit(ratio[is_good], np.log(friction[is_good]), 1).deriv()(0.0)
    return np.asarray(np.exp(slope * ratio))


def _residuals(amplitude_um: FloatArray, friction: FloatArray) -> FloatArray:
    """Return what a polyline with KNOTS knots, at equal shares of the readings, leaves by least squares."""
    knots_um = np.quantile(amplitude_um, np.linspace(0.0, 1.0, KNOTS))
    hats = np.array([np.interp(amplitude_um, knots_um, unit) for unit in np.eye(KNOTS)]).T
    heights, *_ = np.linalg.lstsq(hats, friction, rcond=None)
    return np.asarray(friction - hats @ heights)


def _sorted_um(amplitude_um: FloatArray) -> FloatArray:
    """Return each amplitude as the mean of its neighbours, LEVELS groups in all; bare glass stays by itself."""
    levels_um = np.zeros(len(amplitude_um))
    order = np.argsort(amplitude_um, kind="stable")
    for group in np.array_split(order[amplitude_um[order] > BARE_UM], LEVELS):
        if group.size:
            levels_um[group] = amplitude_um[group].mean()
    return levels_um
