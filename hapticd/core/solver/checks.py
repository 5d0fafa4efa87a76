"""Input checks of the public functions: arrays in, plain floats out, or a ValueError that names what is wrong."""

from __future__ import annotations

import cmath
import math

import numpy as np
import numpy.typing as npt

from .points.arithmetic import Phasors, Row, Rows
from .points.sign_patterns import FloatArray


def checked_shapes(phi: npt.ArrayLike) -> Rows:
    """phi (N, M) as rows."""
    array = _numbers("phi", phi, 2)
    _check_modes(array)
    return tuple(map(tuple, array.tolist()))


def checked_track(phi: npt.ArrayLike) -> FloatArray:
    """phi (K, N, M)."""
    array = _numbers("phi", phi, 3)
    _check_modes(array)
    return array


def checked_targets(target_um: npt.ArrayLike, fingers: int) -> Row:
    """target_um (N,)."""
    array = _numbers("target_um", target_um, 1)
    _check_targets(array, (fingers,))
    return tuple(array.tolist())


def checked_target_track(target_um: npt.ArrayLike, count: int, fingers: int) -> FloatArray:
    """target_um (K, N), or (N,) for all instants, as (K, N)."""
    is_constant = np.ndim(target_um) == 1
    array = _numbers("target_um", target_um, 1 if is_constant else 2)
    _check_targets(array, (fingers,) if is_constant else (count, fingers))
    return np.broadcast_to(array, (count, fingers))


def checked_limits(limit_um: npt.ArrayLike, modes: int) -> Row:
    """limit_um (M,), or one number for all modes."""
    if isinstance(limit_um, float | int):
        limit_um = [limit_um] * modes
    array = _numbers("limit_um", limit_um, 1)
    _check_shape("limit_um", array, (modes,))
    limits: Row = tuple(array.tolist())
    if not min(limits) > 0.0:
        raise ValueError("limit_um: every limit must be greater than 0.")
    return limits


def checked_previous(previous_um: npt.ArrayLike | None, modes: int) -> Row | None:
    """previous_um (M,), or None."""
    if previous_um is None:
        return None
    array = _numbers("previous_um", previous_um, 1)
    _check_shape("previous_um", array, (modes,))
    return tuple(array.tolist())


def checked_phasors(previous_um: npt.ArrayLike | None, modes: int) -> Phasors | None:
    """previous_um (M,) complex, or None."""
    if previous_um is None:
        return None
    try:
        array = np.asarray(previous_um, dtype=np.complex128)
    except (TypeError, ValueError):
        raise ValueError("previous_um: must be an array of complex numbers.") from None
    _check_shape("previous_um", array, (modes,))
    _check_finite("previous_um", array)
    return tuple(array.tolist())


def checked_grams(gram: npt.ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """gram, of this shape."""
    array = _numbers("gram", gram, len(shape))
    _check_shape("gram", array, shape)
    return array


def check_turn(turn_rad: float) -> None:
    """turn_rad is a finite number, 0 or more."""
    if not 0.0 <= turn_rad < math.inf:
        raise ValueError(f"turn_rad: {turn_rad!r} must be a finite number, 0 or more.")


def _numbers(name: str, values: npt.ArrayLike, dimensions: int) -> FloatArray:
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name}: must be an array of numbers, all rows of the same length.") from None
    if array.ndim != dimensions:
        raise ValueError(f"{name}: has {array.ndim} dimensions and needs {dimensions}.")
    _check_finite(name, array)
    return array


def _check_modes(array: FloatArray) -> None:
    if array.shape[-1] < 1:
        raise ValueError("phi: has no modes; its last axis must hold at least one.")


def _check_targets(array: FloatArray, shape: tuple[int, ...]) -> None:
    _check_shape("target_um", array, shape)
    if min(array.ravel().tolist(), default=0.0) < 0.0:
        raise ValueError("target_um: amplitudes must be 0 or more; the solver chooses the sign.")


def _check_shape(name: str, array: npt.NDArray[np.generic], shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise ValueError(f"{name}: has shape {array.shape}, but phi asks for {shape}.")


def _check_finite(name: str, array: npt.NDArray[np.generic]) -> None:
    # By Python: at two fingers and two modes a reduction by numpy takes five times as long.
    if not all(map(cmath.isfinite, array.ravel().tolist())):
        raise ValueError(f"{name}: holds NaN or infinity; give finite numbers.")
