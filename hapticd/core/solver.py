"""Modal amplitudes that give each finger its own vibration: w = Phi W, |w_i| wanted, |W_k| limited (paper, eq. 1-3).

`keep_zero`, the default, is lexicographic. In this order: (1) |W_k| <= limit_k, always, to the last bit; (2) fingers
with target 0 get 0; (3) the others' sum (|w_i| - a_i)^2 is least, their signs being free, for friction knows only
|w_i|; (4) then sum |W_k|^2 is least; (5) of equals, the one nearest `previous_um`. A pair of fingers near a singular
position is therefore met by amplitudes that stay where they are, where the inverse of Phi flips from limit to limit.

`keep_ratio`     as `keep_zero` without limits, then all modes scaled into them: the fingers' ratios survive.
`least_squares`  a finger with target 0 counts like any other in (3): some leak there, less error elsewhere.
`paper`          the founding paper's scheme, as a baseline: the inverse of Phi, signs fixed, scaled into the limits
                 (section IV.B). It needs two fingers and two modes; otherwise it is `keep_zero` from scratch.

`effort` > 0 adds effort * |W|^2 to (3): amplitudes fade towards a singular position instead of riding the limit.
`hysteresis` > 0 lets (5) decide between sign patterns whose error and |W|^2 differ by no more than that share. Two
slipping fingers have two patterns; where their norms cross, (4) alone would jump between them with every wobble.
At an exactly singular position (4) gives W = 0, as coincident fingers want; only `effort` makes the way there smooth.

Cost: one and two modes, plain floats, O(n^2) for n slipping fingers. Three and more: see `core.solver_general`.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..values import Solution
from .solver_arithmetic import Row
from .solver_policies import Rows, named, solve_fast

__all__ = ["condition_number", "solve", "solve_batch", "solve_fast"]

FloatArray = npt.NDArray[np.float64]


def solve(
    phi: npt.ArrayLike,
    target_um: npt.ArrayLike,
    limit_um: npt.ArrayLike,
    *,
    policy: str = "keep_zero",
    effort: float = 0.0,
    previous_um: npt.ArrayLike | None = None,
    hysteresis: float = 0.0,
) -> Solution:
    """Modal amplitudes for one instant.

    phi (N, M): mode shapes at the fingers; target_um (N,); limit_um (M,) or one number; previous_um (M,) or None.
    Raises ValueError, in one sentence, for wrong shapes, numbers that are not finite, negative targets, effort or
    hysteresis, limits that are not positive, an unknown policy.
    """
    shapes = _finite("phi", phi, 2)
    targets = _not_negative("target_um", target_um, (len(shapes),))
    limits, previous = _modal_arguments(shapes.shape[1], limit_um, previous_um)
    _check_weights(effort, hysteresis)
    modal, limited = solve_fast(
        _row_tuples(shapes), tuple(targets.tolist()), limits, previous, policy, effort, hysteresis
    )
    modal_um = np.array(modal)
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        achieved_um = np.abs(shapes @ modal_um)
    return Solution(modal_um, achieved_um, limited, condition_number(shapes))


def solve_batch(
    phi: npt.ArrayLike,
    target_um: npt.ArrayLike,
    limit_um: npt.ArrayLike,
    *,
    policy: str = "keep_zero",
    effort: float = 0.0,
    previous_um: npt.ArrayLike | None = None,
    hysteresis: float = 0.0,
) -> FloatArray:
    """Modal amplitudes (K, M) for K instants in order; each is the next one's `previous_um`.

    phi (K, N, M); target_um (K, N), or (N,) for all instants; the rest as in `solve`.
    """
    shapes = _finite("phi", phi, 3)
    count, fingers, modes = shapes.shape
    single = np.ndim(target_um) == 1
    targets = _not_negative("target_um", target_um, (fingers,) if single else (count, fingers))
    limits, previous = _modal_arguments(modes, limit_um, previous_um)
    _check_weights(effort, hysteresis)
    named(policy)
    modal_um = np.zeros((count, modes))
    target = tuple(targets.tolist()) if single else ()
    for index in range(count):
        if not single:
            target = tuple(targets[index].tolist())
        previous, _ = solve_fast(_row_tuples(shapes[index]), target, limits, previous, policy, effort, hysteresis)
        modal_um[index] = previous
    return modal_um


def condition_number(phi: FloatArray) -> float:
    """The 2-norm condition number of phi (N, M), inf where it is singular to rounding, 1 where it is empty."""
    if phi.size == 0:
        return 1.0
    size = float(np.max(np.abs(phi)))
    if size == 0.0:
        return math.inf
    singular = np.linalg.svd(phi / size, compute_uv=False)
    largest, smallest = float(singular[0]), float(singular[-1])
    return largest / smallest if smallest > 0.0 else math.inf


# --- the public edge ----------------------------------------------------------------------------------------------


def _row_tuples(phi: FloatArray) -> Rows:
    return tuple([tuple(row) for row in phi.tolist()])


def _modal_arguments(modes: int, limit_um: npt.ArrayLike, previous_um: npt.ArrayLike | None) -> tuple[Row, Row | None]:
    if modes < 1:
        raise ValueError("phi: has no modes; its last axis must hold at least one.")
    limits = _finite("limit_um", limit_um, np.ndim(limit_um))
    if limits.ndim == 0:
        limits = np.full(modes, limits)
    _check_shape("limit_um", limits, (modes,))
    if not np.all(limits > 0.0):
        raise ValueError("limit_um: every limit must be greater than 0.")
    if previous_um is None:
        return tuple(limits.tolist()), None
    previous = _finite("previous_um", previous_um, 1)
    _check_shape("previous_um", previous, (modes,))
    return tuple(limits.tolist()), tuple(previous.tolist())


def _check_weights(effort: float, hysteresis: float) -> None:
    for name, value in (("effort", effort), ("hysteresis", hysteresis)):
        if not 0.0 <= value < math.inf:
            raise ValueError(f"{name}: {value!r} must be a finite number, 0 or more.")


def _not_negative(name: str, values: npt.ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    array = _finite(name, values, len(shape))
    _check_shape(name, array, shape)
    if not np.all(array >= 0.0):
        raise ValueError(f"{name}: amplitudes must be 0 or more; the sign is the solver's to choose.")
    return array


def _check_shape(name: str, array: FloatArray, shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise ValueError(f"{name}: has shape {array.shape}, but phi asks for {shape}.")


def _finite(name: str, values: npt.ArrayLike, dimensions: int) -> FloatArray:
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: must be an array of numbers, all rows of the same length.") from None
    if array.ndim != dimensions:
        raise ValueError(f"{name}: has {array.ndim} dimensions and needs {dimensions}.")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{name}: holds NaN or infinity; give finite numbers.")
    return array
