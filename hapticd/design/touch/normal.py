"""Normal equations of a fit to touches, after the elimination of the loads, and the covariance that they give."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...values import ComplexArray, FloatArray
from .model import FitState
from .observations import Windows
from .problem import TouchProblem

OUTLIER = 4.0  # sigma of a part, beyond which a residual counts less (Huber)
CLUSTER_S = 0.2
_BLOCK_BYTES = 1 << 22  # of derivatives in memory at once, of which there are some copies


class Normal(NamedTuple):
    """Normal equations after the elimination of the loads, and what gives these back."""

    matrix: FloatArray
    right: FloatArray
    load_from_right: FloatArray  # (B, 2 N)
    load_from_step: npt.NDArray[np.float32]  # (B, 2 N, P): the largest array of all
    load_weight: FloatArray  # (B, N)
    scores: FloatArray  # (B, P), what each window adds to `right`, negative


def normal_of(problem: TouchProblem, state: FitState, noise: FloatArray, mean: ComplexArray, spread: float) -> Normal:
    prior = problem.priors(state)
    matrix, right = np.diag(prior**-2.0), -np.concatenate(problem.parts(state)) / prior**2
    fingers = state.loads.shape[1]
    windows = len(state.loads)
    from_right, from_step = np.empty((windows, 2 * fingers)), np.empty((windows, 2 * fingers, len(prior)), np.float32)
    weights, scores = np.empty((windows, fingers)), np.empty((windows, len(prior)))
    block = max(1, _BLOCK_BYTES // (16 * len(prior) * int(np.prod(problem.model.windows.measured_um.shape[1:]))))
    for start in range(0, windows, block):
        rows = slice(start, start + block)
        point = problem.model.at(state, rows, problem.free)
        one_sigma = noise * problem.model.doubt[rows]
        weight = np.sqrt(np.minimum(1.0, OUTLIER / np.maximum(np.abs(point.residual) / one_sigma, 1e-12))) / one_sigma
        weight = problem.model.windows.is_used[rows][..., None] * weight
        loads = point.by_loads * weight[..., None]
        left = _stacked(point.columns * weight[..., None])
        own = _stacked(np.concatenate((loads, 1j * loads), axis=-1))
        rest = _stacked((point.residual * weight)[..., None])
        inner = own.transpose(0, 2, 1) @ own
        weights[rows] = np.einsum("bii->bi", inner)[:, :fingers]
        inner = inner + np.eye(2 * fingers) / spread**2
        away = state.loads[rows] - mean[rows]
        drag = np.concatenate((away.real, away.imag), axis=1) / spread**2
        mixed, pull = own.transpose(0, 2, 1) @ left, -(own.transpose(0, 2, 1) @ rest)[..., 0] - drag
        root = np.linalg.inv(np.linalg.cholesky(inner))
        half = root @ np.concatenate((mixed, pull[..., None]), axis=-1)
        back = root.transpose(0, 2, 1) @ half
        from_right[rows], from_step[rows] = back[..., -1], back[..., :-1]
        flat, taken = left.reshape(-1, left.shape[-1]), half[..., :-1].reshape(-1, mixed.shape[-1])
        matrix += flat.T @ flat - taken.T @ taken  # of a matrix by itself: half of the products
        scores[rows] = (left.transpose(0, 2, 1) @ rest + mixed.transpose(0, 2, 1) @ back[..., -1:])[..., 0]
        right -= scores[rows].sum(axis=0)
    return Normal(matrix, right, from_right, from_step, weights, scores)


def covariance_of(normal: Normal, windows: Windows) -> FloatArray:
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


def precision_of(normal: Normal, part: slice) -> FloatArray:
    """Return the inverse of the covariance of some parameters, whatever the others are (Schur complement)."""
    if part.start == part.stop:
        return np.zeros((0, 0))
    matrix, rest = normal.matrix, np.delete(np.arange(len(normal.matrix)), part)
    across = matrix[rest, part]
    return np.asarray(matrix[part, part] - across.T @ np.linalg.solve(matrix[np.ix_(rest, rest)], across), np.float64)


def _stacked(columns: ComplexArray) -> FloatArray:
    """Real rows of each window: (B, S, M, P) to (B, 2 S M, P)."""
    flat = columns.reshape(len(columns), -1, columns.shape[-1])
    return np.concatenate((flat.real, flat.imag), axis=1)
