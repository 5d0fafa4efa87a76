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
_BLOCK = 128  # windows whose derivatives are in memory at once, of which there are some copies


class Normal(NamedTuple):
    """Normal equations after the elimination of the loads, and what gives these back."""

    matrix: FloatArray
    right: FloatArray
    load_from_right: FloatArray  # (B, 2 N)
    load_from_step: npt.NDArray[np.float32]  # (B, 2 N, P): the largest array of all
    load_weight: FloatArray  # (B, N)
    scores: FloatArray  # (B, P), what each window adds to `right`, negative


def normal_of(problem: TouchProblem, state: FitState, noise: FloatArray, mean: ComplexArray, spread: float) -> Normal:
    """Add up the rows of one mode after another, as none meets the rates of other modes, and eliminate the loads."""
    prior = problem.priors(state)
    matrix, right = np.diag(prior**-2.0), -np.concatenate(problem.parts(state)) / prior**2
    windows, fingers = state.loads.shape
    from_right, from_step = np.empty((windows, 2 * fingers)), np.empty((windows, 2 * fingers, len(prior)), np.float32)
    weights, scores = np.empty((windows, fingers)), np.zeros((windows, len(prior)))
    for start in range(0, windows, _BLOCK):
        rows = slice(start, start + _BLOCK)
        point = problem.model.at(state, rows, problem.free)
        one_sigma = noise * problem.model.doubt[rows]
        weight = np.sqrt(np.minimum(1.0, OUTLIER / np.maximum(np.abs(point.residual) / one_sigma, 1e-12))) / one_sigma
        weight = problem.model.windows.is_used[rows][..., None] * weight
        by_loads = np.concatenate((point.by_loads, 1j * point.by_loads), axis=-1)
        away = state.loads[rows] - mean[rows]
        inner = np.tile(np.eye(2 * fingers) / spread**2, (len(away), 1, 1))
        pull = -np.concatenate((away.real, away.imag), axis=1) / spread**2
        mixed = np.zeros((len(away), 2 * fingers, len(prior)))
        for mode in range(len(noise)):
            columns, used = point.of_mode(mode)
            own, left, rest = (
                _stacked(part * weight[..., mode, None])
                for part in (by_loads[:, :, mode], columns, point.residual[:, :, mode, None])
            )
            across, flat = own.transpose(0, 2, 1), left.reshape(-1, len(used))
            inner += across @ own
            pull -= (across @ rest)[..., 0]
            mixed[..., used] += across @ left
            scores[rows, used] += (left.transpose(0, 2, 1) @ rest)[..., 0]
            matrix[np.ix_(used, used)] += flat.T @ flat  # of a matrix by itself: half of the products
        weights[rows] = np.einsum("bii->bi", inner)[:, :fingers] - spread**-2
        root = np.linalg.inv(np.linalg.cholesky(inner))
        half = root @ np.concatenate((mixed, pull[..., None]), axis=-1)
        back = root.transpose(0, 2, 1) @ half
        from_right[rows], from_step[rows] = back[..., -1], back[..., :-1]
        taken = half[..., :-1].reshape(-1, len(prior))
        matrix -= taken.T @ taken
        scores[rows] += (mixed.transpose(0, 2, 1) @ back[..., -1:])[..., 0]
    return Normal(matrix, right - scores.sum(axis=0), from_right, from_step, weights, scores)


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
    """Real rows of each window: (B, S, P) to (B, 2 S, P)."""
    return np.concatenate((columns.real, columns.imag), axis=1)
