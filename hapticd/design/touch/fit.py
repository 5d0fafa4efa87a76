"""Fit of pad, sensors and map: Gauss-Newton with the loads of all windows eliminated (variable projection).

Each step solves for everything at once; the loads of a window meet no other window, so they leave by their Schur
complement. It costs O(T P^2) for T ticks and P parameters.

Source: G. Golub and V. Pereyra, Inverse Problems 19 (2003) R1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...core.plate.mode_shapes import ModeShapes
from ...core.plate.parasitic_modes import ParasiticModes
from .model import (
    DRIFT_PRIOR_1_S,
    LOAD_PRIOR_FRAC,
    PAD_PRIOR,
    SENSE_PRIOR,
    TERMS,
    Calibration,
    Model,
    Point,
    State,
    stepped,
)
from .observations import ComplexArray, FloatArray, Windows
from .waves import Waves

MAP_PRIOR = 0.015  # RMS of what the map may lack, as a share of its peak: 4 % of its own RMS
CLUSTER_S = 0.2
_BLOCK = 256  # windows whose derivatives are in memory at once
_LOOSE = 1e6  # sigma of what has no prior
_START_LOAD_1_S = 200.0
_MOST_STEPS = 12
_MOST_DAMPING = 1e3
_MOST_WITH_WAVES = 3  # they start near, and are linear
_LEAST_GAIN = 3e-4  # of the cost: then it has converged
_OUTLIER = 4.0  # sigma of a part, beyond which a residual counts less (Huber)


class Free(NamedTuple):
    """Which parts of the calibration are sought."""

    pad: bool = False
    sense: bool = False
    waves: bool = False


@dataclass(frozen=True, slots=True)
class Fit:
    """A fitted calibration with one sigma of each part, and the `covariance` (7, 7) of the pad's.

    `cost` (B,) of each window, in units of the noise (M,) of either part of the residual.
    """

    calibration: Calibration
    sigma: Calibration
    covariance: FloatArray
    cost: FloatArray
    noise_um_s: FloatArray
    rates: ComplexArray
    loads: ComplexArray


@dataclass(frozen=True, slots=True)
class _Problem:
    model: Model
    free: Free
    start: Calibration

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """Real parameters: pad, sense, waves, rates."""
        modes, waves = self.start.waves.shape
        pad = len(PAD_PRIOR) if self.free.pad else 0
        sense = 2 * (modes * modes - 1) if self.free.sense else 0
        return pad, sense, modes * waves if self.free.waves else 0, 2 * modes * self.model.terms.shape[-1]

    def priors(self) -> FloatArray:
        """One sigma of each parameter."""
        modes = len(self.start.sense)
        terms = self.model.terms.shape[-1]
        rate = np.where(np.arange(terms) < TERMS * modes, _LOOSE, DRIFT_PRIOR_1_S)
        pad, sense, waves, _ = self.sizes
        lacking = np.zeros(0) if self.model.waves is None else MAP_PRIOR * np.tile(self.model.waves.prior, modes)
        return np.concatenate((PAD_PRIOR[:pad], np.full(sense, SENSE_PRIOR), lacking[:waves], np.tile(rate, 2 * modes)))

    def offsets(self, state: State) -> FloatArray:
        """Distance of each parameter from its prior's mean."""
        found = state.calibration
        modes = len(found.sense)
        sense = (found.sense - np.eye(modes)).ravel()[1:]
        parts = [
            found.pad if self.free.pad else np.zeros(0),
            np.concatenate((sense.real, sense.imag)) if self.free.sense else np.zeros(0),
            found.waves.ravel() if self.free.waves else np.zeros(0),
            state.rates.real.ravel(),
            state.rates.imag.ravel(),
        ]
        return np.concatenate(parts)

    def stepped(self, state: State, step: FloatArray, loads: ComplexArray) -> State:
        """Return the state after a step of all parameters (P,) and loads (B, N)."""
        pad, sense, waves, rates = np.split(step, np.cumsum(self.sizes)[:-1])
        found = stepped(
            state.calibration,
            pad if pad.size else np.zeros(len(PAD_PRIOR)),
            _complex(sense),
            waves,
        )
        return State(found, state.rates + _complex(rates).reshape(state.rates.shape), state.loads + loads)


class _Normal(NamedTuple):
    """Normal equations after the elimination of the loads, and what gives these back."""

    matrix: FloatArray
    right: FloatArray
    load_from_right: FloatArray  # (B, 2 N)
    load_from_step: FloatArray  # (B, 2 N, P)
    load_weight: FloatArray  # (B, N)
    scores: FloatArray  # (B, P), what each window adds to `right`, negative


def fit(
    windows: Windows,
    modes: ModeShapes,
    free: Free,
    start: Calibration,
    waves: Waves | None = None,
    *,
    judged_by_um_s: FloatArray | None = None,
    parasitic_modes: ParasiticModes | None = None,
) -> Fit:
    """Fit what is `free` from `start` on; everything else of it stays. Loads and rates are always free.

    `judged_by_um_s` (M,) is the noise in units of which the result's cost is; without, its own.
    """
    problem = _Problem(Model(windows, modes, start, waves, parasitic_modes), free, start)
    state = State(
        start,
        np.zeros((len(start.sense), problem.model.terms.shape[-1]), np.complex128),
        np.zeros(windows.track.shape, np.complex128),
    )
    settled = _settled(replace(problem, free=Free()), state)
    state, noise, mean, spread = _descended(problem, settled) if any(free) else settled
    normal = _normal(problem, state, noise, mean, spread)
    covariance = _covariance(normal, windows)
    pad = problem.sizes[0]
    return Fit(
        state.calibration,
        _sigma(problem, np.sqrt(np.diag(covariance))),
        np.asarray(covariance[:pad, :pad], np.float64),
        _window_cost(problem.model, state, noise if judged_by_um_s is None else judged_by_um_s),
        noise,
        state.rates,
        state.loads,
    )


class _Settled(NamedTuple):
    """A state with the noise (M,) of its residual, and mean and spread of its loads."""

    state: State
    noise: FloatArray
    mean: complex
    spread: float


def _settled(problem: _Problem, state: State) -> _Settled:
    """Solve for loads and rates: linear, but for the outliers."""
    found = _Settled(state, _noise(problem.model, state), 0.0, _START_LOAD_1_S)
    for _ in range(4):
        problem.model.settle(state)
        state, normal = _step(problem, *found)
        found = _Settled(state, _noise(problem.model, state), *_load_prior(state, normal))
    return found


def _descended(problem: _Problem, found: _Settled) -> _Settled:
    """Take Gauss-Newton steps, damped after each that raises the cost (Levenberg-Marquardt), until they gain little."""
    left = _MOST_WITH_WAVES if problem.free.waves else _MOST_STEPS
    cost, damping = _cost(problem, *found), 0.0
    while left > 0 and damping < _MOST_DAMPING:
        state, normal = _step(problem, *found, damping)
        gain = 1.0 - _cost(problem, state, *found[1:]) / cost
        if gain < 0.0:
            damping = max(10.0 * damping, 1e-3)
            continue
        found = _Settled(state, _noise(problem.model, state), *_load_prior(state, normal))
        cost, left = _cost(problem, *found), left - 1
        if gain < _LEAST_GAIN and damping == 0.0:
            break
        damping = damping / 10.0 if damping > 1e-3 else 0.0
    return found


def _step(
    problem: _Problem, state: State, noise: FloatArray, mean: complex, spread: float, damping: float = 0.0
) -> tuple[State, _Normal]:
    normal = _normal(problem, state, noise, mean, spread)
    scale = np.sqrt(np.diag(normal.matrix))
    scaled = normal.matrix / np.outer(scale, scale) + damping * np.eye(len(scale))
    step = np.linalg.solve(scaled, normal.right / scale) / scale
    loads = normal.load_from_right - normal.load_from_step @ step
    return problem.stepped(state, step, _complex(loads)), normal


def _normal(problem: _Problem, state: State, noise: FloatArray, mean: complex, spread: float) -> _Normal:
    prior = problem.priors()
    matrix, right = np.diag(prior**-2.0), -problem.offsets(state) / prior**2
    fingers = state.loads.shape[1]
    from_right, from_step, weights, scores = [], [], [], []
    for start in range(0, len(state.loads), _BLOCK):
        rows = slice(start, start + _BLOCK)
        point = problem.model.at(state, rows, has_waves=problem.free.waves)
        weight = _weights(point.residual, problem.model.windows.is_used[rows], noise)
        columns = _columns(problem, point, rows) * weight[..., None]
        loads = point.by_loads * weight[..., None]
        left = _stacked(columns)
        own = _stacked(np.concatenate((loads, 1j * loads), axis=-1))
        rest = _stacked((point.residual * weight)[..., None])
        inner = own.transpose(0, 2, 1) @ own
        weights.append(np.einsum("bii->bi", inner)[:, :fingers])
        inner = inner + np.eye(2 * fingers) / spread**2
        away = state.loads[rows] - mean
        drag = np.concatenate((away.real, away.imag), axis=1) / spread**2
        mixed, pull = own.transpose(0, 2, 1) @ left, -(own.transpose(0, 2, 1) @ rest)[..., 0] - drag
        back = np.linalg.solve(inner, np.concatenate((mixed, pull[..., None]), axis=-1))
        flat = left.reshape(-1, left.shape[-1])
        matrix += flat.T @ flat - mixed.reshape(-1, mixed.shape[-1]).T @ back[..., :-1].reshape(-1, mixed.shape[-1])
        scores.append((left.transpose(0, 2, 1) @ rest + mixed.transpose(0, 2, 1) @ back[..., -1:])[..., 0])
        right -= scores[-1].sum(axis=0)
        from_right.append(back[..., -1])
        from_step.append(back[..., :-1])
    parts = (np.concatenate(part) for part in (from_right, from_step, weights, scores))
    return _Normal(matrix, right, *parts)


def _columns(problem: _Problem, point: Point, rows: slice) -> ComplexArray:
    """Derivatives by all parameters (B, S, M, P), which are real."""
    free, terms = problem.free, problem.model.terms[rows]
    modes = terms.shape[2]
    parts = [point.by_pad] if free.pad else []
    if free.sense:
        parts += [point.by_sense, 1j * point.by_sense]
    if free.waves:
        parts += [point.by_waves]
    rates = np.zeros((*terms.shape[:3], modes, terms.shape[-1]), np.complex128)
    for mode in range(modes):
        rates[:, :, mode, mode] = terms[:, :, mode]
    flat = rates.reshape(*terms.shape[:3], -1)
    return np.concatenate((*parts, flat, 1j * flat), axis=-1)


def _weights(
    residual: ComplexArray, is_used: np.ndarray[tuple[int, ...], np.dtype[np.bool_]], noise: FloatArray
) -> FloatArray:
    size = np.abs(residual) / noise
    return is_used[..., None] * np.sqrt(np.minimum(1.0, _OUTLIER / np.maximum(size, 1e-12))) / noise


def _noise(model: Model, state: State) -> FloatArray:
    """Return one sigma of either part of the residual (M,), by its median size."""
    size = np.abs(model.residual(state))[model.windows.is_used]
    return np.asarray(np.median(size, axis=0) / np.sqrt(2.0 * np.log(2.0)) + 1e-9, np.float64)


def _window_cost(model: Model, state: State, noise: FloatArray) -> FloatArray:
    """Huber's cost of each window (B,)."""
    size = np.abs(model.residual(state)) / noise
    cost = np.where(size < _OUTLIER, size**2, 2.0 * _OUTLIER * size - _OUTLIER**2)
    return np.asarray((cost * model.windows.is_used[..., None]).sum(axis=(1, 2)), np.float64)


def _cost(problem: _Problem, state: State, noise: FloatArray, mean: complex, spread: float) -> float:
    data = float(_window_cost(problem.model, state, noise).sum())
    known = float(((problem.offsets(state) / problem.priors()) ** 2).sum())
    return data + known + float((np.abs(state.loads - mean) ** 2).sum()) / spread**2


def _load_prior(state: State, normal: _Normal) -> tuple[complex, float]:
    """Return the loads' mean and spread, of those that the data determine."""
    weight = normal.load_weight
    mean = complex((state.loads * weight).sum() / max(float(weight.sum()), 1e-12))
    return mean, max(LOAD_PRIOR_FRAC * abs(mean), 1.0)


def _covariance(normal: _Normal, windows: Windows) -> FloatArray:
    """Return the parameters' covariance (P, P), which holds although residuals near each other are alike.

    The errors of a finger's smoothed positions last for some reports: scores are summed over CLUSTER_S (a sandwich
    estimator), and where windows alone give a larger variance, that counts.
    """
    inverse = np.linalg.inv(normal.matrix)
    cluster = np.unique(np.floor(windows.start_s / CLUSTER_S), return_inverse=True)[1]
    summed = np.zeros((int(cluster.max()) + 1, len(inverse)))
    np.add.at(summed, cluster, normal.scores)
    moved = summed @ inverse
    robust = moved.T @ moved
    larger = np.sqrt(np.maximum(1.0, np.diag(inverse) / np.maximum(np.diag(robust), 1e-300)))
    return np.asarray(robust * np.outer(larger, larger), np.float64)


def _sigma(problem: _Problem, sigma: FloatArray) -> Calibration:
    pad, sense, waves, _ = np.split(sigma, np.cumsum(problem.sizes)[:-1])
    modes = len(problem.start.sense)
    flat = np.concatenate(((0.0,), _complex(sense))) if sense.size else np.zeros(modes * modes)
    return Calibration(
        pad if pad.size else np.zeros(len(PAD_PRIOR)),
        flat.reshape(modes, modes).astype(np.complex128),
        waves.reshape(problem.start.waves.shape) if waves.size else np.zeros_like(problem.start.waves),
    )


def _complex(parts: FloatArray) -> ComplexArray:
    """The real halves of the last axis, then the imaginary ones."""
    half = parts.shape[-1] // 2
    return np.asarray(parts[..., :half] + 1j * parts[..., half:], np.complex128)


def _stacked(columns: ComplexArray) -> FloatArray:
    """Real rows of each window: (B, S, M, P) to (B, 2 S M, P)."""
    flat = columns.reshape(len(columns), -1, columns.shape[-1])
    return np.concatenate((flat.real, flat.imag), axis=1)
