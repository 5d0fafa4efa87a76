"""Input checks of the public functions: arrays in, plain floats out, or a ValueError that names what is wrong."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ...values import FloatArray
from ..phasors import ModeRow, ModeRows


def checked_shapes(phi: npt.ArrayLike) -> tuple[ModeRows, int]:
    """phi (N, M) as rows, and M."""
    array = _array("phi", phi, 2)
    listed: list[list[float]] = array.tolist()
    rows: list[ModeRow] = []
    for row in listed:
        _check_finite("phi", row)
        rows.append(tuple(row))
    modes: int = len(rows[0]) if rows else array.shape[1]
    _check_modes(modes)
    return tuple(rows), modes


def checked_track(phi: npt.ArrayLike) -> FloatArray:
    """phi (K, N, M)."""
    array = _numbers("phi", phi, 3)
    _check_modes(array.shape[2])
    return array


def checked_targets(target_um: npt.ArrayLike, fingers: int) -> ModeRow:
    """target_um (N,)."""
    targets = _row("target_um", target_um, fingers)
    _check_targets(targets)
    return tuple(targets)


def checked_target_track(target_um: npt.ArrayLike, count: int, fingers: int) -> FloatArray:
    """target_um (K, N), or (N,) for all instants, as (K, N)."""
    is_constant = np.ndim(target_um) == 1
    array = _numbers("target_um", target_um, 1 if is_constant else 2)
    _check_shape("target_um", array, (fingers,) if is_constant else (count, fingers))
    _check_targets(array.ravel().tolist())
    return np.broadcast_to(array, (count, fingers))


def checked_limits(limit_um: npt.ArrayLike, modes: int) -> ModeRow:
    """limit_um (M,), or one number for all modes."""
    if isinstance(limit_um, (float, int)):  # a union would be built at each call
        limit_um = [limit_um] * modes
    limits = _row("limit_um", limit_um, modes)
    for limit in limits:
        if not limit > 0.0:
            raise ValueError("limit_um: every limit must be greater than 0.")
    return tuple(limits)


def checked_previous(previous_um: npt.ArrayLike | None, modes: int) -> ModeRow | None:
    """previous_um (M,), or None."""
    return None if previous_um is None else tuple(_row("previous_um", previous_um, modes))


def checked_grams(gram: npt.ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """gram, of this shape."""
    array = _numbers("gram", gram, len(shape))
    _check_shape("gram", array, shape)
    return array


def _row(name: str, values: npt.ArrayLike, count: int) -> list[float]:
    """Finite numbers, `count` of them. Plain floats stay out of arrays, which would take ten times as long."""
    row = _plain(values)
    if row is None:
        array = _array(name, values, 1)
        row = array.tolist()
    _check_finite(name, row)
    if len(row) != count:
        raise ValueError(_other_shape(name, (len(row),), (count,)))
    return row


def _plain(values: npt.ArrayLike) -> list[float] | None:
    """A list or a tuple of floats as a list; None for anything else."""
    if not isinstance(values, (list, tuple)):
        return None
    row: list[float] = []
    for value in values:
        if not isinstance(value, float):
            return None
        row.append(float(value))
    return row


def _numbers(name: str, values: npt.ArrayLike, dimensions: int) -> FloatArray:
    array = _array(name, values, dimensions)
    _check_finite(name, array.ravel().tolist())
    return array


def _array(name: str, values: npt.ArrayLike, dimensions: int) -> FloatArray:
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name}: must be an array of numbers, all rows of the same length.") from None
    if array.ndim != dimensions:
        raise ValueError(f"{name}: has {array.ndim} dimensions and needs {dimensions}.")
    return array


def _check_modes(modes: int) -> None:
    if modes < 1:
        raise ValueError("phi: has no modes; its last axis must hold at least one.")


def _check_targets(targets: list[float]) -> None:
    for target in targets:
        if target < 0.0:
            raise ValueError("target_um: amplitudes must be 0 or more; the solver chooses the sign.")


def _check_shape(name: str, array: npt.NDArray[np.generic], shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise ValueError(_other_shape(name, array.shape, shape))


def _other_shape(name: str, shape: tuple[int, ...], asked: tuple[int, ...]) -> str:
    return f"{name}: has shape {shape}, but phi asks for {asked}."


def _check_finite(name: str, values: list[float]) -> None:
    for value in values:
        if not -math.inf < value < math.inf:
            raise ValueError(f"{name}: holds NaN or infinity; give finite numbers.")
