"""The default motion model: five fixed-gain Kalman filters, weighted by how well each foresaw the last samples.

One filter holds still (a random walk), four assume constant acceleration disturbed by white jerk of densities 38 times
apart, so that one of them always fits: rest, a slow straight slide, a curve, a stroke, a stop. Weights follow the
interacting-multiple-model recursion (Blom and Bar-Shalom, IEEE Trans. Automatic Control 33(8), 1988) with two
simplifications that save the matrix arithmetic and lose nothing on the bench: covariances are not mixed, so the gains
are those of the single filters and precomputed; both axes share gains and weights.

The arithmetic is written out on floats: at this size numpy would spend its time on calls, not on numbers.
"""

from __future__ import annotations

import math

from .prediction_gains import JERK_DENSITIES, Gain, bank_gains
from .prediction_motion import QuadraticMotion, Sample, checked

_MODELS = 1 + len(JERK_DENSITIES)
_STAY = 0.9914  # probability that the model that fits this sample fits the next
_SWITCH = (1.0 - _STAY) / (_MODELS - 1)  # to each of the others
_STAMP_VAR_S2 = 0.2e-3**2  # jitter left in the filtered stamps: at speed it excuses part of an innovation
_ACCELERATION_DAMPING = 0.54  # fingers do not accelerate for long: the best constant share to extrapolate

# Gains belong to an interval, not to a pad: with those of 11 ms, samples 22 ms apart (every other report lost) would
# make the fastest filter unstable. They are kept for intervals a quarter octave apart, from half a period to the
# longest gap; gains an eighth off their interval cost less than 1 % of accuracy.
_INTERVALS_PER_OCTAVE = 4
_SHORTEST_INDEX, _LONGEST_INDEX = -4, 10

_State = tuple[float, float, float, float, float, float]  # x, y in mm; vx, vy in mm/s; ax, ay in mm/s^2


class ModelBank(QuadraticMotion):
    """`period_ms` is the nominal sample period, `noise_mm` the standard error of one position on one axis.

    Making the first bank of a given (period, noise) computes its gain tables, some 10 ms; later ones share them.
    """

    __slots__ = ("_gains", "_mean", "_period_s", "_samples", "_states", "_weights")

    def __init__(self, *, period_ms: float, noise_mm: float = 0.053) -> None:
        super().__init__()
        noise_mm = checked("noise_mm", noise_mm, 1e-4, 10.0)
        self._period_s = 1e-3 * period_ms
        self._gains = [
            bank_gains(self._period_s * 2.0 ** (index / _INTERVALS_PER_OCTAVE), noise_mm)
            for index in range(_SHORTEST_INDEX, _LONGEST_INDEX + 1)
        ]

    def start(self, x_mm: float, y_mm: float) -> None:
        still = (x_mm, y_mm, 0.0, 0.0, 0.0, 0.0)
        self._samples = 1
        self._states: list[_State] = [still] * _MODELS
        self._weights = [1.0 / _MODELS] * _MODELS
        self._settle(still)

    def step(self, sample: Sample) -> None:
        gains = self._gains_after(sample.interval_s)
        self._samples += 1
        mean = self._mean
        states: list[_State] = []
        fits: list[float] = []
        misfits: list[float] = []
        for state, weight, gain in zip(self._states, self._weights, gains, strict=True):
            prior = _SWITCH + (_STAY - _SWITCH) * weight
            own_share = (_STAY - _SWITCH) * weight / prior
            follow = _slide if states else _rest
            state, misfit, spread = follow(state, mean, own_share, gain, sample)
            states.append(state)
            fits.append(prior / spread)
            misfits.append(misfit)

        self._states = states
        self._weights = _weigh(fits, misfits)
        self._settle(_weighted_mean(states, self._weights))

    def _gains_after(self, interval_s: float) -> tuple[Gain, ...]:
        index = round(_INTERVALS_PER_OCTAVE * math.log2(interval_s / self._period_s))
        rows = self._gains[min(max(index, _SHORTEST_INDEX), _LONGEST_INDEX) - _SHORTEST_INDEX]
        return rows[min(self._samples, len(rows)) - 1]

    def _settle(self, mean: _State) -> None:
        self._mean = mean
        x, y, vx, vy, ax, ay = mean
        self._move(x, y, vx, vy, _ACCELERATION_DAMPING * ax, _ACCELERATION_DAMPING * ay)


def _rest(state: _State, mean: _State, own_share: float, gain: Gain, sample: Sample) -> tuple[_State, float, float]:
    """One sample for the filter that holds still: its new state, the sample's misfit (chi^2 / 2) and spread (mm^2)."""
    _, _, x_mm, y_mm = sample
    x = mean[0] + own_share * (state[0] - mean[0])
    y = mean[1] + own_share * (state[1] - mean[1])
    ex = x_mm - x
    ey = y_mm - y
    k, _, _, spread = gain
    return (x + k * ex, y + k * ey, 0.0, 0.0, 0.0, 0.0), (ex * ex + ey * ey) / (2.0 * spread), spread


def _slide(state: _State, mean: _State, own_share: float, gain: Gain, sample: Sample) -> tuple[_State, float, float]:
    """The same for a filter of constant acceleration: mix in the bank's mean, predict, correct."""
    d, _, x_mm, y_mm = sample
    half_d = 0.5 * d
    x, y, vx, vy, ax, ay = state
    mean_x, mean_y, mean_vx, mean_vy, mean_ax, mean_ay = mean
    k_x, k_v, k_a, spread = gain

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
    corrected = (x + k_x * ex, y + k_x * ey, vx + k_v * ex, vy + k_v * ey, ax + k_a * ex, ay + k_a * ey)
    return corrected, (ex * ex + ey * ey) / (2.0 * spread), spread


def _weigh(fits: list[float], misfits: list[float]) -> list[float]:
    """Posterior weights: fit * exp(-misfit), normalised; the best misfit is taken out, so they cannot all underflow.

    One may: `_SWITCH` gives even a model of no weight its chance at the next sample.
    """
    best = min(misfits)
    weights = [fit * math.exp(best - misfit) for fit, misfit in zip(fits, misfits, strict=True)]
    total = sum(weights)
    return [weight / total for weight in weights]


def _weighted_mean(states: list[_State], weights: list[float]) -> _State:
    x = y = vx = vy = ax = ay = 0.0
    for state, weight in zip(states, weights, strict=True):
        x += weight * state[0]
        y += weight * state[1]
        vx += weight * state[2]
        vy += weight * state[3]
        ax += weight * state[4]
        ay += weight * state[5]
    return x, y, vx, vy, ax, ay
