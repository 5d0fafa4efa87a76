"""Normal equations of a fit to touches, after the elimination of the loads, and the covariance that they give."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ...values import ComplexArray, FloatArray
from .model import FitState
from .observations import Windows
from .problem import TouchProblem

OUTLIER = 4.0  # sigma of a part, beyond which a residual counts less (Huber)
CLUSTER_S = 0.2


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
    model, prior = problem.model, problem.priors(state)
    matrix, right = np.diag(0.5 * prior**-2.0), -np.concatenate(problem.parts(state)) / prior**2
    windows, fingers = state.loads.shape
    from_right, from_step = np.empty((windows, 2 * fingers)), np.zeros((windows, 2 * fingers, len(prior)), np.float32)
    weights, scores = np.empty((windows, fingers)), np.zeros((windows, len(prior)))
    for block in model.blocks:
        rows, point = block[0], model.at(state, block, problem.free)
        used, one_sigma = point.places, noise * model.doubt[block]
        weight = np.sqrt(np.minimum(1.0, OUTLIER / np.maximum(np.abs(point.residual) / one_sigma, 1e-12))) / one_sigma
        away = state.loads[rows] - mean[rows]
        gram = np.zeros((len(away), 2 * fingers + 1, 2 * fingers + 1))  # of loads and residual
        mixed, summed = np.zeros((*gram.shape[:2], len(used))), np.zeros((len(used), len(used)))
        for mode in range(len(noise)):
            own, parts = point.of_mode(mode, weight[..., mode])
            gram += own.transpose(0, 2, 1) @ own
            for place, left in parts:
                mixed[..., place] += own.transpose(0, 2, 1).astype(left.dtype) @ left
            _add_halves(summed, parts, 1.0)
        weights[rows] = np.einsum("bii->bi", gram)[:, :fingers]
        pull = -gram[:, :-1, -1] - np.concatenate((away.real, away.imag), axis=1) / spread**2
        root = np.linalg.inv(np.linalg.cholesky(gram[:, :-1, :-1] + np.eye(2 * fingers) / spread**2))
        half = root @ np.concatenate((mixed[:, :-1], pull[..., None]), axis=-1)
        back = root.transpose(0, 2, 1) @ half
        from_right[rows], from_step[np.ix_(rows, np.arange(2 * fingers), used)] = back[..., -1], back[..., :-1]
        _add_halves(summed, [(slice(len(used)), half[..., :-1])], -1.0)
        matrix[np.ix_(used, used)] += summed
        scores[np.ix_(rows, used)] = mixed[:, -1] + (mixed[:, :-1].transpose(0, 2, 1) @ back[..., -1:])[..., 0]
    return Normal(matrix + matrix.T, right - scores.sum(axis=0), from_right, from_step, weights, scores)


def _add_halves(summed: FloatArray, parts: list[tuple[slice, Any]], sign: float) -> None:
    """Add the products of rows' parts (B, R, U) by each other, in the first's precision, and half of their squares."""
    for index, (place, left) in enumerate(parts):
        flat = left.reshape(len(left) * left.shape[1], -1)
        summed[place, place] += 0.5 * sign * (flat.T @ flat)  # by itself: half of the time
        for other, right in parts[index + 1 :]:
            summed[place, other] += sign * (flat.T @ right.reshape(len(flat), -1).astype(left.dtype, copy=False))


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


def precision_of(normal: Normal, count: int) -> FloatArray:
    """Return the inverse of the covariance of the first parameters, whatever the others are (Schur complement)."""
    first, across, rest = normal.matrix[:count, :count], normal.matrix[count:, :count], normal.matrix[count:, count:]
    return np.asarray(first - across.T @ np.linalg.solve(rest, across), np.float64)
