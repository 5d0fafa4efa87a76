"""The solver's public edge: arrays in, plain floats out, or a ValueError that names what is wrong in one sentence.

Numbers are looked at one by one as Python floats: at the two fingers and two modes of nearly every call that takes a
third of what numpy's reductions would.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import chain
from math import isfinite
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from .arithmetic import Pair, Row

_ARRAY: Final = np.ndarray

FloatArray = npt.NDArray[np.float64]
Rows = tuple[Row, ...]


def plain_rows(values: Any) -> tuple[Any, Any]:
    """Two rows of an array, a list or a tuple; TypeError for all else, be it right or wrong."""
    rows = values.tolist() if type(values) is _ARRAY else values
    if not ((type(rows) is list or type(rows) is tuple) and len(rows) == 2):
        raise TypeError
    return rows[0], rows[1]


def plain_pair(values: Any) -> Pair:
    """Two floats of an array, a list or a tuple; TypeError for all else, be it right or wrong."""
    numbers = values.tolist() if type(values) is _ARRAY else values
    if not ((type(numbers) is list or type(numbers) is tuple) and len(numbers) == 2):
        raise TypeError
    one, other = numbers[0], numbers[1]
    if not type(one) is float is type(other):
        raise TypeError
    return one, other


def checked_shapes(phi: npt.ArrayLike) -> tuple[Rows, int]:
    """phi (N, M) as rows, and M."""
    array = _numbers("phi", phi, 2)
    rows = tuple(map(tuple, array.tolist()))
    _check_finite("phi", chain.from_iterable(rows))
    return rows, _modes(array)


def checked_track(phi: npt.ArrayLike) -> tuple[list[Rows], int, int]:
    """phi (K, N, M) as rows for each instant, N and M."""
    array = _numbers("phi", phi, 3)
    _check_all_finite("phi", array)
    return [tuple(map(tuple, rows)) for rows in array.tolist()], array.shape[1], _modes(array)


def checked_targets(target_um: npt.ArrayLike, fingers: int) -> Row:
    """target_um (N,)."""
    targets = _vector("target_um", target_um, fingers)
    if targets and not min(targets) >= 0.0:
        raise ValueError("target_um: amplitudes must be 0 or more; the sign is the solver's to choose.")
    return targets


def checked_target_track(target_um: npt.ArrayLike, count: int, fingers: int) -> list[Row]:
    """target_um (K, N), or (N,) for all instants."""
    if np.ndim(target_um) == 1:
        return [checked_targets(target_um, fingers)] * count
    array = _numbers("target_um", target_um, 2)
    _check_shape("target_um", array, (count, fingers))
    _check_all_finite("target_um", array)
    return [checked_targets(targets, fingers) for targets in array]


def checked_limits(limit_um: npt.ArrayLike, modes: int) -> Row:
    """limit_um (M,), or one number for all modes."""
    if isinstance(limit_um, float) and 0.0 < limit_um < math.inf:
        return (limit_um,) * modes
    limits = _vector("limit_um", np.full(modes, limit_um) if np.ndim(limit_um) == 0 else limit_um, modes)
    if not min(limits) > 0.0:
        raise ValueError("limit_um: every limit must be greater than 0.")
    return limits


def checked_previous(previous_um: npt.ArrayLike | None, modes: int) -> Row | None:
    """previous_um (M,), or None."""
    return None if previous_um is None else _vector("previous_um", previous_um, modes)


def checked_phasors(previous_um: npt.ArrayLike | None, modes: int) -> tuple[complex, ...] | None:
    """previous_um (M,) complex, or None."""
    if previous_um is None:
        return None
    try:
        array = np.asarray(previous_um, dtype=np.complex128)
    except (TypeError, ValueError):
        raise ValueError("previous_um: must be an array of complex numbers.") from None
    _check_shape("previous_um", array, (modes,))
    _check_finite("previous_um", chain(array.real.tolist(), array.imag.tolist()))
    return tuple(array.tolist())


def checked_grams(gram: npt.ArrayLike, fingers: int, modes: int) -> FloatArray:
    """gram (N, M, M)."""
    array = _numbers("gram", gram, 3)
    _check_shape("gram", array, (fingers, modes, modes))
    _check_all_finite("gram", array)
    return array


def checked_gram_track(gram: npt.ArrayLike, count: int, fingers: int, modes: int) -> FloatArray:
    """gram (K, N, M, M)."""
    array = _numbers("gram", gram, 4)
    _check_shape("gram", array, (count, fingers, modes, modes))
    _check_all_finite("gram", array)
    return array


def check_weight(name: str, value: float) -> None:
    """A weight is a finite number, 0 or more."""
    if not 0.0 <= value < math.inf:
        raise ValueError(f"{name}: {value!r} must be a finite number, 0 or more.")


def _vector(name: str, values: npt.ArrayLike, count: int) -> Row:
    array = _numbers(name, values, 1)
    if len(array) != count:
        _check_shape(name, array, (count,))
    numbers = tuple(array.tolist())
    _check_finite(name, numbers)
    return numbers


def _numbers(name: str, values: npt.ArrayLike, dimensions: int) -> FloatArray:
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name}: must be an array of numbers, all rows of the same length.") from None
    if array.ndim != dimensions:
        raise ValueError(f"{name}: has {array.ndim} dimensions and needs {dimensions}.")
    return array


def _modes(array: FloatArray) -> int:
    modes = int(array.shape[-1])
    if modes < 1:
        raise ValueError("phi: has no modes; its last axis must hold at least one.")
    return modes


def _check_shape(name: str, array: npt.NDArray[np.generic], shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise ValueError(f"{name}: has shape {array.shape}, but phi asks for {shape}.")


def _check_finite(name: str, numbers: Iterable[float]) -> None:
    if not all(map(isfinite, numbers)):
        raise ValueError(f"{name}: holds NaN or infinity; give finite numbers.")


def _check_all_finite(name: str, array: FloatArray) -> None:
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: holds NaN or infinity; give finite numbers.")
