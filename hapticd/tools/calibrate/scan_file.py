"""A vibrometer's scan as a file: points in any order, real or complex readings, gaps where nothing was read.

CSV has a header and one line per point: `x_mm,y_mm`, then for each mode `phi_k`, or `re_k,im_k`, or `abs_k,deg_k`, k
from 1. An empty value or `nan` is a reading lost. Lines that are blank or begin with # are skipped.
NPZ holds either a grid, `x_mm` (nx,), `y_mm` (ny,), `shapes` (M, ny, nx), or `points_mm` (N, 2) and `readings` (N, M);
shapes and readings may be complex.
"""

from __future__ import annotations

import csv
import io
import math
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ...errors import CalibrationError

MAX_BYTES = 1 << 24  # of a file, and of an array in it, as of a map's
MAX_MODES = 8
FORMS = (("phi",), ("re", "im"), ("abs", "deg"))
BESIDE = "x_mm,y_mm and for each mode phi_1 or re_1,im_1 or abs_1,deg_1"


class Scan(NamedTuple):
    """`points_mm` (N, 2) and `readings` (N, M), real or complex, NaN where a reading was lost."""

    points_mm: npt.NDArray[np.float64]
    readings: npt.NDArray[Any]


def read(path: Path) -> Scan:
    """Raises CalibrationError for a file that is no scan; what its numbers mean is the fit's to judge."""
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read ({error.strerror}): check --scan.") from None
    if len(data) > MAX_BYTES:
        raise CalibrationError(f"{path}: has more than {MAX_BYTES >> 20} MiB: measure on a coarser grid.")
    try:
        return _decode_npz(data) if path.suffix.lower() == ".npz" else _decode_csv(data)
    except ValueError as error:
        raise CalibrationError(f"{path}: {error}") from None


def _decode_npz(data: bytes) -> Scan:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            if max((entry.file_size for entry in archive.infolist()), default=0) > MAX_BYTES:
                raise ValueError("it claims more than any scan has")
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            found = {name: np.asarray(arrays[name]) for name in arrays.files}
    except Exception:  # a damaged archive fails in any of zipfile's, zlib's and numpy's ways
        raise ValueError("is not a readable NPZ archive: save it again with numpy.savez.") from None
    if any(array.dtype.kind not in "fiuc" for array in found.values()):
        raise ValueError("holds arrays that are not numbers: save them as float or complex.")
    if {"points_mm", "readings"} <= found.keys():
        return _scattered(found)
    if {"x_mm", "y_mm", "shapes"} <= found.keys():
        return _on_grid(found)
    raise ValueError("holds neither x_mm, y_mm, shapes nor points_mm, readings: save it with these names.")


def _scattered(found: Mapping[str, npt.NDArray[Any]]) -> Scan:
    points_mm, readings = found["points_mm"], found["readings"]
    if points_mm.ndim != 2 or points_mm.shape[1] != 2 or readings.ndim != 2 or len(points_mm) != len(readings):
        raise ValueError(
            f"points_mm and readings are {points_mm.shape} and {readings.shape}: give (N, 2) and (N, modes)."
        )
    return Scan(_real(points_mm), readings)


def _on_grid(found: Mapping[str, npt.NDArray[Any]]) -> Scan:
    x_mm, y_mm, shapes = (found[name] for name in ("x_mm", "y_mm", "shapes"))
    if x_mm.ndim != 1 or y_mm.ndim != 1 or shapes.ndim != 3 or shapes.shape[1:] != (y_mm.size, x_mm.size):
        raise ValueError(f"shapes is {shapes.shape} where the axes ask for (modes, {y_mm.size}, {x_mm.size}).")
    points_mm = np.stack(np.meshgrid(_real(x_mm), _real(y_mm)), axis=-1).reshape(-1, 2)
    return Scan(points_mm, shapes.reshape(len(shapes), -1).T)


def _real(array: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    if np.iscomplexobj(array):
        raise ValueError("gives complex positions: save them as float.")
    return array.astype(np.float64)


def _decode_csv(data: bytes) -> Scan:
    try:
        lines = data.decode("utf-8-sig").splitlines()
        kept = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
        rows = list(csv.reader((line for _, line in kept), strict=True))
    except (UnicodeDecodeError, csv.Error):
        raise ValueError("is not a readable CSV file: save it as text in UTF-8.") from None
    if not rows:
        raise ValueError(f"is empty: give the columns {BESIDE}.")
    form, modes = _form([cell.strip() for cell in rows[0]])
    columns = len(rows[0])
    table = np.array([_numbers(number, row, columns) for (number, _), row in zip(kept[1:], rows[1:], strict=True)])
    table = table.reshape(-1, columns)
    parts = table[:, 2:].reshape(len(table), modes, len(form))
    if form == ("re", "im"):
        return Scan(table[:, :2], parts[..., 0] + 1j * parts[..., 1])
    if form == ("abs", "deg"):
        return Scan(table[:, :2], parts[..., 0] * np.exp(1j * np.radians(parts[..., 1])))
    return Scan(table[:, :2], parts[..., 0])


def _form(header: Sequence[str]) -> tuple[tuple[str, ...], int]:
    """How the readings are written, and of how many modes."""
    for form in FORMS:
        modes = (len(header) - 2) // len(form)
        wanted = ["x_mm", "y_mm", *(f"{part}_{k}" for k in range(1, modes + 1) for part in form)]
        if 1 <= modes <= MAX_MODES and list(header) == wanted:
            return form, modes
    raise ValueError(f"does not begin with a header of {BESIDE}, with commas between: add it as the first line.")


def _numbers(number: int, cells: Sequence[str], columns: int) -> list[float]:
    if len(cells) != columns:
        raise ValueError(f"line {number} has {len(cells)} values where the header has {columns}: complete it.")
    try:
        return [float(cell) if cell.strip() else math.nan for cell in cells]
    except ValueError:
        raise ValueError(f"line {number} holds something that is not a number: correct or empty it.") from None
