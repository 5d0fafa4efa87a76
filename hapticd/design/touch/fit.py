"""Fit of pad, sensors and map: Gauss-Newton with the loads of all windows eliminated (variable projection).

The loads of a window meet no other window, so they leave by their Schur complement: O(T P^2) for T ticks and P
parameters.

Source: G. Golub and V. Pereyra, Inverse Problems 19 (2003) R1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...core.plate.mode_shapes import ModeShapes, ParasiticModes
from ...values import ComplexArray, FloatArray
from .model import FORCE_S, LOAD_PRIOR_FRAC, Calibration, FitState, Free, Model, stepped
from .normal import OUTLIER, Normal, covariance_of, normal_of, precision_of
from .observations import WINDOW_S, Windows
from .problem import TouchProblem, complex_of
from .waves import Waves

_START_LOAD_1_S = 200.0
_SETTLING_STEPS = 6
_LOOSE_STEPS = 2  # loads and spreads are products: until both are near, none of the loads is a prior
_MOST_STEPS = 12
_MOST_WITH_WAVES = 1  # they start near, and are linear: with more the map takes up errors of the model
_FAR = round(4.0 * FORCE_S / WINDOW_S)  # windows, beyond which loads say nothing of each other
_LEAST_GAIN = 3e-4  # of the cost: then it has converged


@dataclass(frozen=True, slots=True)
class Fit:
    """A fitted calibration with one sigma of each part, and the `covariance` (7, 7) of the pad's.

    `cost` (B,) of each window, in units of the noise (M,) of either part of the residual; `drift_hz` (M,) is how far
    each mode's frequency moved in a session. `waves_precision` (M K, M K) is the inverse of the waves' covariance.
    `apart_mm` (T, 2) is by how much the centroid of each touch differs from the mean; `settled` is what it began with.
    """

    calibration: Calibration
    sigma: Calibration
    covariance: FloatArray
    cost: FloatArray
    noise_um_s: FloatArray
    drift_hz: FloatArray
    loads: ComplexArray
    spread_mm2: FloatArray
    spread_sigma_mm2: FloatArray
    waves_precision: FloatArray
    apart_mm: FloatArray
    settled: Settled


def fit(
    windows: Windows,
    modes: ModeShapes,
    free: Free,
    start: Calibration,
    waves: Waves | None = None,
    near: Fit | None = None,
    *,
    parasitic_modes: ParasiticModes | None = None,
    are_points: bool = False,
) -> Fit:
    """Fit what is `free` from `start` on; everything else of it stays. Loads and rates are always free.

    With `are_points` fingers act where their centres are, not all over their contacts.
    `near` is a fit of the same windows, at whose start loads and rates are near, and whose noise there costs are in.
    """
    model = Model(windows, modes, start, waves, parasitic_modes, free.apart)
    problem = TouchProblem(model, free, are_points)
    state = FitState.start(start, model, problem.spread_mm2)
    found = settled = _settled(replace(problem, free=Free()), state, near.settled if near else None)
    sizes = [part.size for part in problem.parts(state)]
    lacking, pad = sizes[0], slice(sizes[0], sum(sizes[:2]))
    covariance, precision = np.zeros((sum(sizes), sum(sizes))), np.zeros((lacking, lacking))
    if any(free):
        found, normal = _descended(problem, found)
        covariance = covariance_of(normal, windows)
        precision = precision_of(normal, lacking)
    state, noise = found.state, found.noise
    own_hz = (model.splines @ state.own.T).imag / (2.0 * np.pi)
    return Fit(
        state.calibration,
        _sigma(problem, state, np.sqrt(np.diag(covariance))),
        covariance[pad, pad],
        _window_cost(model, state, near.settled.noise if near else noise),
        noise,
        np.max([np.ptp(own_hz[chosen], axis=(0, 1)) for chosen in windows.sessions], axis=0),
        state.loads,
        state.spread_mm2,
        problem.split(state, np.sqrt(np.diag(covariance)))[4],
        precision,
        np.asarray(model.contrasts @ state.apart_mm, np.float64),
        settled,
    )


class Settled(NamedTuple):
    """A state with the noise (M,) of its residual, and mean (B, N) and spread of its loads."""

    state: FitState
    noise: FloatArray
    mean: ComplexArray
    spread: float


def _settled(problem: TouchProblem, state: FitState, near: Settled | None) -> Settled:
    """Solve for loads and rates: linear, but for the outliers and what parasitic modes do."""
    found = near or Settled(state, _noise(problem.model, state), np.zeros_like(state.loads), _START_LOAD_1_S)
    found = found._replace(state=replace(found.state, calibration=state.calibration, apart_mm=state.apart_mm))
    for step in range(_LOOSE_STEPS if near else 0, _SETTLING_STEPS):
        problem.model.settle(found.state)
        found = _stepped(problem, found, normal_of(problem, *found), is_loose=step < _LOOSE_STEPS)
    return found


def _descended(problem: TouchProblem, found: Settled) -> tuple[Settled, Normal]:
    """Take Gauss-Newton steps, after each of which loads and rates settle, until they gain little; return also the
    normal equations of the last one, as good as those of where it ends."""
    linear = replace(problem, free=Free())
    for _ in range(_MOST_WITH_WAVES if problem.free.waves else _MOST_STEPS):
        normal = normal_of(problem, *found)
        after = _stepped(problem, found, normal)
        after = _stepped(linear, after, normal_of(linear, *after))
        gain = 1.0 - _cost(problem, after.state, *found[1:]) / _cost(problem, *found)
        found = after
        if abs(gain) < _LEAST_GAIN:
            break
    return found, normal


def _stepped(problem: TouchProblem, found: Settled, normal: Normal, *, is_loose: bool = False) -> Settled:
    scale = np.sqrt(np.diag(normal.matrix))
    step = np.linalg.solve(normal.matrix / np.outer(scale, scale), normal.right / scale) / scale
    parts = np.array_split(normal.load_from_step, max(1, len(normal.load_from_step) // 100))  # each in double precision
    loads = normal.load_from_right - np.concatenate([part @ step for part in parts])
    state = problem.stepped(found.state, step, complex_of(loads))
    known = found[2:] if is_loose else _load_prior(problem.model.windows, state, normal)
    return Settled(state, _noise(problem.model, state), *known)


def _noise(model: Model, state: FitState) -> FloatArray:
    """Return one sigma of either part of the residual (M,), by its median size."""
    size = (np.abs(model.residual(state)) / model.doubt)[model.windows.is_used]
    return np.asarray(np.median(size, axis=0) / np.sqrt(2.0 * np.log(2.0)) + 1e-9, np.float64)


def _window_cost(model: Model, state: FitState, noise: FloatArray) -> FloatArray:
    """Huber's cost of each window (B,)."""
    size = np.abs(model.residual(state)) / (noise * model.doubt)
    cost = np.where(size < OUTLIER, size**2, 2.0 * OUTLIER * size - OUTLIER**2)
    return np.asarray(cost.sum(axis=(1, 2)), np.float64)


def _cost(problem: TouchProblem, state: FitState, noise: FloatArray, mean: ComplexArray, spread: float) -> float:
    data = float(_window_cost(problem.model, state, noise).sum())
    known = float(((np.concatenate(problem.parts(state)) / problem.priors(state)) ** 2).sum())
    return data + known + float((np.abs(state.loads - mean) ** 2).sum()) / spread**2


def _load_prior(windows: Windows, state: FitState, normal: Normal) -> tuple[ComplexArray, float]:
    """Return the loads' means (B, N), smooth in time, and spread, of those that the data determine."""
    weight = normal.load_weight
    usual = complex((state.loads * weight).sum() / max(float(weight.sum()), 1e-12))
    mean = np.full_like(state.loads, usual)
    spread = max(LOAD_PRIOR_FRAC * abs(usual), 1.0)
    cell = np.round((windows.start_s - windows.start_s.min()) / WINDOW_S).astype(np.int64)
    ahead = np.arange(-_FAR, _FAR + 1) * WINDOW_S / FORCE_S
    for track in np.unique(windows.track[windows.track >= 0]):
        at = np.nonzero(windows.track == track)
        since = cell[at[0]] - cell[at[0]].min()
        parts = (weight[at] * part for part in (np.ones(len(since)), state.loads[at].real, state.loads[at].imag))
        near, real, imag = (np.convolve(np.bincount(since, part), np.exp(-0.5 * ahead**2))[_FAR:] for part in parts)
        mean[at] = ((real + 1j * imag + usual * spread**-2) / (near + spread**-2))[since]
    return mean, spread


def _sigma(problem: TouchProblem, state: FitState, sigma: FloatArray) -> Calibration:
    waves, pad, sense, *_ = problem.split(state, sigma)
    found = state.calibration
    none = Calibration(np.zeros_like(found.pad), np.zeros_like(found.sense), np.zeros_like(found.waves))
    return stepped(none, pad, complex_of(sense), waves)
