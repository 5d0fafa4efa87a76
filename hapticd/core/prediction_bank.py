"""The default motion model: seven fixed-gain Kalman filters, weighted by how well each foresaw the last samples.

One filter holds still (a random walk), three assume constant acceleration disturbed by white jerk, three constant jerk
disturbed by white snap; their densities (`prediction_gains.MODELS`) lie so far apart that one of them always fits:
rest, a straight slide, a change of speed, a stop, and, which is what the jerk is for, arcs and sines. Weights follow
the interacting-multiple-model recursion (Blom and Bar-Shalom, IEEE Trans. Automatic Control 33(8), 1988) with two
simplifications that save the matrix arithmetic and lose nothing on the bench: covariances are not mixed, so the gains
are those of the single filters and precomputed; both axes share gains and weights.

How noisy the pad is decides how far the filters trust a sample. It is measured while the finger moves
(`prediction_noise`), and the gains of the nearest of a few noises are used.

The arithmetic is written out on floats: at this size numpy would spend its time on calls, not on numbers.
"""

from __future__ import annotations

import math

from .prediction_gains import MODELS, Gain, bank_gains
from .prediction_motion import QuadraticMotion, Sample, checked
from .prediction_noise import NoiseMeter

_STAY = 0.994  # probability that the model that fits this sample fits the next
_SWITCH = (1.0 - _STAY) / (len(MODELS) - 1)  # to each of the others
_STAMP_VAR_S2 = 0.2e-3**2  # jitter left in the filtered stamps: at speed it excuses part of an innovation
_ACCELERATION_DAMPING = 0.58  # fingers do not accelerate for long: the best constant share to extrapolate

# On an arc and in a sine the jerk opposes the velocity: j = -omega^2 v. A jerk along the velocity begins a motion or
# ends it and is soon over; believed, it would carry the prediction 0.15 mm beyond the end of a reach, not 0.10.
_JERK_KEPT_ALONG = 0.3  # from sample to sample

# Gains belong to an interval, not to a pad: with those of 11 ms, samples 22 ms apart (every other report lost) would
# make the fastest filter unstable. They are kept for intervals a quarter octave apart, from half a period to the
# longest gap; gains an eighth off their interval cost less than 1 % of accuracy.
_INTERVALS_PER_OCTAVE = 4
_SHORTEST_INDEX, _LONGEST_INDEX = -4, 10

# And to a noise: kept for half octaves about the one expected. Trusting a noise a quarter octave off costs 2 %.
_LEVELS_PER_OCTAVE = 2
_QUIETEST_LEVEL, _LOUDEST_LEVEL = -4, 2
_SAMPLES_PER_CHOICE = 8
_LEAST_CHANGE = 1.0  # levels: more than a measurement strays by chance, and gains do not change to and fro

_State = tuple[float, float, float, float, float, float, float, float]  # x, y in mm, then velocity, acceleration, jerk


class ModelBank(QuadraticMotion):
    """`period_ms` is the nominal sample period, `noise_mm` the standard error of one position on one axis.

    That noise holds until enough of the touch was seen; then the last `noise_samples` samples tell it, from a
    quarter to twice of what was expected; 0 keeps it. Making the first bank of a given (period, noise) computes its
    gain tables, some 0.2 s; later ones share them.
    """

    __slots__ = ("_level", "_mean", "_meter", "_noise_mm", "_period_s", "_samples", "_states", "_tables", "_weights")

    def __init__(self, *, period_ms: float, noise_mm: float = 0.053, noise_samples: float = 128.0) -> None:
        super().__init__()
        self._noise_mm = checked("noise_mm", noise_mm, 1e-4, 10.0)
        samples = round(checked("noise_samples", noise_samples, 0.0, 1e4))
        self._meter = NoiseMeter(samples) if samples > 0 else None
        self._period_s = 1e-3 * period_ms
        intervals_s = tuple(
            self._period_s * 2.0 ** (index / _INTERVALS_PER_OCTAVE)
            for index in range(_SHORTEST_INDEX, _LONGEST_INDEX + 1)
        )
        levels = range(_QUIETEST_LEVEL, _LOUDEST_LEVEL + 1) if samples > 0 else (0,)
        self._level = 0
        self._tables = {
            level: bank_gains(intervals_s, self._noise_mm * 2.0 ** (level / _LEVELS_PER_OCTAVE)) for level in levels
        }

    def start(self, x_mm: float, y_mm: float) -> None:
        still = (x_mm, y_mm, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        self._samples = 1
        self._states: list[_State] = [still] * len(MODELS)
        self._weights = [1.0 / len(MODELS)] * len(MODELS)
        if self._meter is not None:
            self._meter.restart()
            self._meter.update(x_mm, y_mm, 1.0)
        self._settle(still)

    def step(self, sample: Sample) -> None:
        gains = self._gains_after(sample.interval_s)
        self._samples += 1
        mean = self._mean
        states: list[_State] = []
        fits: list[float] = []
        misfits: list[float] = []
        for follow, state, weight, gain in zip(_FOLLOW, self._states, self._weights, gains, strict=True):
            prior = _SWITCH + (_STAY - _SWITCH) * weight
            own_share = (_STAY - _SWITCH) * weight / prior
            state, misfit, spread = follow(state, mean, own_share, gain, sample)
            states.append(state)
            fits.append(prior / spread)
            misfits.append(misfit)

        self._states = states
        self._weights = _weigh(fits, misfits)
        self._settle(_weighted_mean(states, self._weights))
        if self._meter is not None:
            self._meter.update(sample.x_mm, sample.y_mm, sample.interval_s / sample.period_s)
            if self._samples % _SAMPLES_PER_CHOICE == 0:
                self._choose_level(self._meter.noise_mm(self._noise_mm))

    def _gains_after(self, interval_s: float) -> tuple[Gain, ...]:
        index = round(_INTERVALS_PER_OCTAVE * math.log2(interval_s / self._period_s))
        rows = self._tables[self._level][min(max(index, _SHORTEST_INDEX), _LONGEST_INDEX) - _SHORTEST_INDEX]
        return rows[min(self._samples, len(rows)) - 1]

    def _choose_level(self, noise_mm: float) -> None:
        level = _LEVELS_PER_OCTAVE * math.log2(max(noise_mm / self._noise_mm, 1e-3))
        if abs(level - self._level) > _LEAST_CHANGE:
            self._level = min(max(round(level), _QUIETEST_LEVEL), _LOUDEST_LEVEL)

    def _settle(self, mean: _State) -> None:
        self._mean = mean
        x, y, vx, vy, ax, ay, _, _ = mean
        self._move(x, y, vx, vy, _ACCELERATION_DAMPING * ax, _ACCELERATION_DAMPING * ay)


def _rest(state: _State, mean: _State, own_share: float, gain: Gain, sample: Sample) -> tuple[_State, float, float]:
    """One sample for the filter that holds still: its new state, the sample's misfit (chi^2 / 2) and spread (mm^2)."""
    _, _, x_mm, y_mm = sample
    x = mean[0] + own_share * (state[0] - mean[0])
    y = mean[1] + own_share * (state[1] - mean[1])
    ex = x_mm - x
    ey = y_mm - y
    k, _, _, _, spread = gain
    return (x + k * ex, y + k * ey, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (ex * ex + ey * ey) / (2.0 * spread), spread


def _slide(state: _State, mean: _State, own_share: float, gain: Gain, sample: Sample) -> tuple[_State, float, float]:
    """The same for a filter of constant acceleration: mix in the bank's mean, predict, correct."""
    d, _, x_mm, y_mm = sample
    half_d = 0.5 * d
    x, y, vx, vy, ax, ay, _, _ = state
    mean_x, mean_y, mean_vx, mean_vy, mean_ax, mean_ay, _, _ = mean
    k_x, k_v, k_a, _, spread = gain

    ax = mean_ax + own_share * (ax - mean_ax)
    ay = mean_ay + own_share * (ay - mean_ay)
    vx = mean_vx + own_share * (vx - mean_vx)
    vy = mean_vy + own_share * (vy - mean_vy)
    x = mean_x + own_share * (x - mean_x) + d * (vx + half_d * ax)
    y = mean_y + own_share * (y - mean_y) + d * (vy + half_d * ay)
    vx += d * ax
    vy += d * ay

    ex = x_mm - x
    ey = y_mm - y
    spread += 0.5 * _STAMP_VAR_S2 * (vx * vx + vy * vy)
    corrected = (x + k_x * ex, y + k_x * ey, vx + k_v * ex, vy + k_v * ey, ax + k_a * ex, ay + k_a * ey, 0.0, 0.0)
    return corrected, (ex * ex + ey * ey) / (2.0 * spread), spread


def _bend(state: _State, mean: _State, own_share: float, gain: Gain, sample: Sample) -> tuple[_State, float, float]:
    """The same for a filter of constant jerk."""
    d, _, x_mm, y_mm = sample
    half_d, third_d = 0.5 * d, d / 3.0
    x, y, vx, vy, ax, ay, jx, jy = state
    mean_x, mean_y, mean_vx, mean_vy, mean_ax, mean_ay, mean_jx, mean_jy = mean
    k_x, k_v, k_a, k_j, spread = gain

    jx = mean_jx + own_share * (jx - mean_jx)
    jy = mean_jy + own_share * (jy - mean_jy)
    ax = mean_ax + own_share * (ax - mean_ax)
    ay = mean_ay + own_share * (ay - mean_ay)
    vx = mean_vx + own_share * (vx - mean_vx)
    vy = mean_vy + own_share * (vy - mean_vy)
    if jx * vx + jy * vy > 0.0:
        jx *= _JERK_KEPT_ALONG
        jy *= _JERK_KEPT_ALONG
    x = mean_x + own_share * (x - mean_x) + d * (vx + half_d * (ax + third_d * jx))
    y = mean_y + own_share * (y - mean_y) + d * (vy + half_d * (ay + third_d * jy))
    vx += d * (ax + half_d * jx)
    vy += d * (ay + half_d * jy)
    ax += d * jx
    ay += d * jy

    ex = x_mm - x
    ey = y_mm - y
    spread += 0.5 * _STAMP_VAR_S2 * (vx * vx + vy * vy)
    corrected = (
        *(x + k_x * ex, y + k_x * ey, vx + k_v * ex, vy + k_v * ey),
        *(ax + k_a * ex, ay + k_a * ey, jx + k_j * ex, jy + k_j * ey),
    )
    return corrected, (ex * ex + ey * ey) / (2.0 * spread), spread


_FOLLOW = tuple({1: _rest, 3: _slide, 4: _bend}[order] for order, _ in MODELS)


def _weigh(fits: list[float], misfits: list[float]) -> list[float]:
    """Posterior weights: fit * exp(-misfit), normalised; the best misfit is taken out, so they cannot all underflow.

    One may: `_SWITCH` gives even a model of no weight its chance at the next sample.
    """
    best = min(misfits)
    weights = [fit * math.exp(best - misfit) for fit, misfit in zip(fits, misfits, strict=True)]
    total = sum(weights)
    return [weight / total for weight in weights]


def _weighted_mean(states: list[_State], weights: list[float]) -> _State:
    x = y = vx = vy = ax = ay = jx = jy = 0.0
    for state, weight in zip(states, weights, strict=True):
        state_x, state_y, state_vx, state_vy, state_ax, state_ay, state_jx, state_jy = state
        x += weight * state_x
        y += weight * state_y
        vx += weight * state_vx
        vy += weight * state_vy
        ax += weight * state_ax
        ay += weight * state_ay
        jx += weight * state_jx
        jy += weight * state_jy
    return x, y, vx, vy, ax, ay, jx, jy
