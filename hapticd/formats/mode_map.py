"""Files of mode maps: NPZ and CSV, real maps on a grid and a vibrometer's scan of real or complex readings.

CSV has a header and one line per point, in any order: `x_mm,y_mm`, then for each mode k from 1 `phi_k`, or `re_k,im_k`,
or `abs_k,deg_k`, or `lowered_hz_k`, the shift of the mode's frequency by a mass at the point. An empty value or
`nan` is a missing one. Blank lines and lines that begin with # are skipped.
NPZ holds a grid, `x_mm` (nx,), `y_mm` (ny,), `shapes` (M, ny, nx), or `points_mm` (N, 2) and `readings` (N, M), and
may also hold the arrays of `SweptModes`.

A grid may lack points, which become NaN; positions within a micrometre of each other are one line of it. Files come
from outside: no bytes raise anything but ModesError, whose sentence `read_grid` and `read_scan` prefix with the path.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from ..errors import ModesError
from ..regular_file import csv_rows, lines_of, open_regular, opened
from ..values import FloatArray
from . import npz

Grid = tuple[FloatArray, FloatArray, FloatArray]
Arrays = Mapping[str, npt.NDArray[Any]]
Decoded = TypeVar("Decoded")
MapPath = str | Path

FORMATS = (".npz", ".csv")
MAX_BYTES = 1 << 24  # of a file, and of an array in it; 20 modes on 300 x 300 points have 14 million
MAX_LINES = 400  # of a grid along one axis: a third of a millimetre on the plate
MAX_POSITION_MM = 1e6  # from the plate's centre: a larger value is a damaged file, and could overflow

_GRID, _POINTS = ("x_mm", "y_mm", "shapes"), ("points_mm", "readings")
_SWEPT = ("frequency_hz", "q_factor", "gain_um_per_v_s")
_FORMS = (("phi",), ("re", "im"), ("abs", "deg"), ("lowered_hz",))
_SAME_LINE_MM = 1e-3  # a micrometre: far below any grid step, far above the rounding of a printed position
_BEYOND_MM = 5.0  # a map may be shifted, and reach this far beyond the plate
_LEAST_COVER_FRAC = 0.5  # of the plate's edge: beyond a map the shapes of its edge are used
_LEAST_PEAK = 1e-6  # of a mode; measured ones are about 1
_SAME_SHAPE = 0.999  # cosine between two modes: no pair of positions could be given two targets
_MIN_FILLED_FRAC = 0.5  # of a grid: with fewer points they are scattered


class SweptModes(NamedTuple):
    """A scan's modes by a sweep of each of A amplifiers: frequency and quality (M,), and what a volt does to
    a mode's largest amplitude, or to the unit of readings that keep their scale, (M, A), um/(V s), with the sign of the
    readings' real part."""

    frequency_hz: FloatArray
    q_factor: FloatArray
    gain_um_per_v_s: FloatArray


class Scan(NamedTuple):
    """`points_mm` (N, 2) and `readings` (N, M), real or complex, NaN where a reading is missing; `swept` if known."""

    points_mm: FloatArray
    readings: npt.NDArray[Any]
    swept: SweptModes | None = None


class LoweredScan(Scan):
    """Its readings are by how many Hz a small mass at the point lowers each mode."""

    __slots__ = ()


def read_grid(path: MapPath) -> Grid:
    """Read `x_mm` (nx,), `y_mm` (ny,) and real `shapes` (M, ny, nx), NaN where missing. Raises ModesError."""
    return _read(Path(path), decode_grid)


def read_scan(path: MapPath) -> Scan:
    """Read a scan of any form; the fit judges its values. Raises ModesError."""
    return _read(Path(path), decode_scan)


def write_grid(path: MapPath, grid: Grid) -> None:
    """Write a grid as NPZ or CSV, by the suffix; `read_grid` returns the same numbers. Raises HapticdError."""
    data = encode_grid(grid, _suffix(Path(path)))
    with opened(Path(path)) as file:
        file.write(data)


def read_swept(path: MapPath, modes: int | None = None) -> SweptModes:
    """Read what a sweep shows of its first modes, or of all. Raises ModesError, also if it shows fewer."""

    def decode(data: bytes, _: str) -> SweptModes:
        arrays = {name: np.atleast_1d(array) for name, array in _decode_npz(data, (_SWEPT,)).items()}
        shown_hz = arrays[_SWEPT[0]].ravel().tolist()
        count = len(shown_hz) if modes is None else modes
        if count > len(shown_hz):
            named = ", ".join(f"{hz:.0f}" for hz in shown_hz)
            raise ModesError(f"the scan has {modes} modes: scan those of the sweep, in its order, {named} Hz.")
        return _swept({name: array[:count] for name, array in arrays.items()}, count)

    return _read(Path(path), decode)


def write_swept(path: Path, swept: SweptModes) -> None:
    """Write what a sweep shows of modes as NPZ. Raises HapticdError."""
    with opened(path) as file:
        np.savez(file, **swept._asdict())


def require_usable(grid: Grid, size_mm: Sequence[float]) -> None:
    """Raise ModesError for a map that can be read but not used: off the plate, of zeros, or of one shape twice."""
    x_mm, y_mm, shapes = grid
    for name, axis_mm, edge_mm in (("x_mm", x_mm, size_mm[0]), ("y_mm", y_mm, size_mm[1])):
        low_mm, high_mm = float(axis_mm[0]), float(axis_mm[-1])
        is_on_plate = -edge_mm / 2.0 - _BEYOND_MM <= low_mm and high_mm <= edge_mm / 2.0 + _BEYOND_MM
        if not is_on_plate or high_mm - low_mm < _LEAST_COVER_FRAC * edge_mm:
            raise ModesError(
                f"{name} runs from {low_mm:g} to {high_mm:g} on a plate of {edge_mm:g} mm; "
                "give positions in mm from the plate's centre, and check plate.size_mm."
            )
    length = np.linalg.norm(shapes.reshape(len(shapes), -1), axis=1)
    for mode in range(len(shapes)):
        if not np.abs(shapes[mode]).max() > _LEAST_PEAK:
            raise ModesError(f"mode {mode + 1} is zero everywhere; measure it again.")
        for other in range(mode):
            alike = abs(float(np.sum(shapes[mode] * shapes[other]))) / float(length[mode] * length[other])
            if alike > _SAME_SHAPE:
                raise ModesError(f"modes {other + 1} and {mode + 1} have the same shape; measure one of them again.")


def decode_grid(data: bytes, suffix: str) -> Grid:
    """Decode a real map on a grid; the types are those of `read_grid`. Raises ModesError only."""
    if suffix == ".npz":
        arrays = _decode_npz(data, (_GRID,))
        if any(np.iscomplexobj(array) for array in arrays.values()):
            raise ModesError("holds complex shapes; fit them with `hapticd calibrate modes --scan`.")
        return _real(arrays["x_mm"]), _real(arrays["y_mm"]), _real(arrays["shapes"])
    form, numbers, table = _decode_csv(data)
    if form != ("phi",):
        what = "frequencies" if form == ("lowered_hz",) else "complex readings"
        raise ModesError(f"holds {what}; fit them with `hapticd calibrate modes --scan`.")
    return _lay_on_grid(numbers, table)


def decode_scan(data: bytes, suffix: str) -> Scan:
    """Decode points and readings in any form. Raises ModesError only."""
    if suffix == ".npz":
        arrays = _decode_npz(data, ((*_POINTS, *_SWEPT), _POINTS, _GRID))
        return _scattered(arrays) if "readings" in arrays else _points_of_grid(arrays)
    form, _, table = _decode_csv(data)
    parts = table[:, 2:].reshape(len(table), -1, len(form))
    if form == ("re", "im"):
        return Scan(table[:, :2], parts[..., 0] + 1j * parts[..., 1])
    if form == ("abs", "deg"):
        return Scan(table[:, :2], parts[..., 0] * np.exp(1j * np.radians(parts[..., 1])))
    return (LoweredScan if form == ("lowered_hz",) else Scan)(table[:, :2], parts[..., 0])


def encode_grid(grid: Grid, suffix: str) -> bytes:
    """Return the file's bytes; `decode_grid` gives the same numbers to the last bit."""
    x_mm, y_mm, shapes = grid
    if suffix == ".npz":
        buffer = io.BytesIO()
        np.savez(buffer, x_mm=x_mm, y_mm=y_mm, shapes=shapes)
        return buffer.getvalue()
    lines = [",".join(_header(("phi",), shapes.shape[0]))]
    for row, y in enumerate(y_mm.tolist()):
        for column, x in enumerate(x_mm.tolist()):
            lines.append(",".join(map(repr, (x, y, *shapes[:, row, column].tolist()))))
    return ("\n".join(lines) + "\n").encode()


def _read(path: Path, decode: Callable[[bytes, str], Decoded]) -> Decoded:
    suffix = _suffix(path)
    try:
        with open_regular(path) as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise ModesError(f"{path}: cannot be read ({error.strerror}); check the path and its permissions.") from error
    try:
        if len(data) > MAX_BYTES:
            raise ModesError(f"has more than {MAX_BYTES >> 20} MiB; measure on a coarser grid.")
        return decode(data, suffix)
    except ModesError as error:
        raise ModesError(f"{path}: {error}") from error


def _suffix(path: Path) -> str:
    if path.suffix.lower() not in FORMATS:
        raise ModesError(f"{path}: has no known suffix; name the file {' or '.join(FORMATS)}.")
    return path.suffix.lower()


# --- NPZ --------------------------------------------------------------------------------------------------------


def _decode_npz(data: bytes, choices: Sequence[Sequence[str]]) -> Arrays:
    """Return the arrays of the first of `choices`, sets of names, that the archive holds in full."""
    try:
        arrays = npz.arrays_of(data, choices, MAX_BYTES)
    except OverflowError:
        raise ModesError(
            f"unpacks to an array of more than {MAX_BYTES >> 20} MiB; measure on a coarser grid."
        ) from None
    except ValueError as error:
        raise ModesError("is not a readable NPZ archive; save it again with numpy.savez.") from error
    if not arrays:
        expected = " nor ".join(", ".join(names) for names in choices[-2:])
        raise ModesError(f"does not hold {expected}; save the arrays with these names.")
    if any(array.dtype.kind not in "fiuc" for array in arrays.values()):
        raise ModesError("holds arrays that are not numbers; save them as float64 or complex128.")
    return arrays


def _scattered(arrays: Arrays) -> Scan:
    points_mm, readings = arrays["points_mm"], arrays["readings"]
    if points_mm.ndim != 2 or points_mm.shape[1] != 2 or readings.ndim != 2 or len(points_mm) != len(readings):
        raise ModesError(
            f"points_mm and readings are {points_mm.shape} and {readings.shape}; give (N, 2) and (N, modes)."
        )
    swept = _swept(arrays, readings.shape[1]) if _SWEPT[0] in arrays else None
    return Scan(_real(points_mm), _numbers(readings), swept)


def _swept(arrays: Arrays, modes: int) -> SweptModes:
    swept = SweptModes(*(_real(arrays[name]) for name in _SWEPT))
    amplifiers = swept.gain_um_per_v_s.shape[-1] if swept.gain_um_per_v_s.ndim else 0
    is_whole = [one.shape for one in swept] == [(modes,), (modes,), (modes, amplifiers)] and 2 <= amplifiers <= modes
    if not is_whole or not all(np.isfinite(one).all() for one in swept) or not min(map(np.min, swept[:2])) > 0.0:
        raise ModesError(f"{', '.join(_SWEPT)}: give (modes,), (modes,) and (modes, 2 amplifiers or more), all finite.")
    return swept


def _points_of_grid(arrays: Arrays) -> Scan:
    x_mm, y_mm, shapes = (arrays[name] for name in _GRID)
    if x_mm.ndim != 1 or y_mm.ndim != 1 or shapes.ndim != 3 or shapes.shape[1:] != (y_mm.size, x_mm.size):
        raise ModesError(f"shapes is {shapes.shape}, the axes need (modes, {y_mm.size}, {x_mm.size}); transpose it.")
    points_mm = np.stack(np.meshgrid(_real(x_mm), _real(y_mm)), axis=-1).reshape(-1, 2)
    return Scan(points_mm, _numbers(shapes).reshape(len(shapes), -1).T)


def _real(array: npt.NDArray[Any]) -> FloatArray:
    if np.iscomplexobj(array):
        raise ModesError("holds complex positions; save them as float64.")
    return _numbers(array)


def _numbers(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    with np.errstate(over="ignore", invalid="ignore"):  # a long double may become infinite or NaN: checked later
        return array.astype(np.complex128 if np.iscomplexobj(array) else np.float64)


# --- CSV --------------------------------------------------------------------------------------------------------


def _decode_csv(data: bytes) -> tuple[tuple[str, ...], list[int], FloatArray]:
    """Return the form of the readings, each point's line number, and the table (N, columns)."""
    numbers: list[int] = []
    table: list[FloatArray] = []  # a list of numbers would take four times as much
    try:
        lines = csv_rows(lines_of(io.BytesIO(data), Path(), 2 * MAX_LINES**2))
        _, header = next(lines, (0, []))
        form = _form(header)
        for number, cells in lines:
            if len(table) == MAX_LINES**2:
                raise ModesError(f"has more than {MAX_LINES**2} points; measure on a coarser grid.")
            numbers.append(number)
            table.append(np.array(_parse_line(number, cells, len(header))))
    except UnicodeDecodeError as error:
        raise ModesError("is not a text file; save the map as CSV in UTF-8.") from error
    except ValueError as error:
        raise ModesError(str(error)) from None
    except OSError as error:
        raise ModesError(f"is no such table ({error.strerror}); give one line per measured point.") from None
    if not table:
        raise ModesError("holds a header and no points; add a line per measured point.")
    return form, numbers, np.array(table)


def _form(header: Sequence[str]) -> tuple[str, ...]:
    """Return the form of the readings that the header names."""
    for form in _FORMS:
        modes = (len(header) - 2) // len(form)
        if modes >= 1 and header == _header(form, modes):
            return form
    raise ModesError(
        "does not begin with the header x_mm,y_mm and for each mode phi_1 or re_1,im_1 or abs_1,deg_1 or lowered_hz_1; "
        "add it, with commas between cells and points in numbers."
    )


def _header(form: Sequence[str], modes: int) -> list[str]:
    return ["x_mm", "y_mm", *(f"{part}_{k}" for k in range(1, modes + 1) for part in form)]


def _parse_line(number: int, cells: Sequence[str], columns: int) -> list[float]:
    if len(cells) != columns:
        raise ModesError(f"line {number} has {len(cells)} values, the header {columns}; complete it.")
    try:
        values = [float(cell or "nan") for cell in cells]
    except ValueError as error:
        raise ModesError(f"line {number} holds something that is not a number; correct or empty it.") from error
    if not all(abs(position_mm) <= MAX_POSITION_MM for position_mm in values[:2]):
        raise ModesError(f"line {number} has no usable position; give x_mm and y_mm or delete it.")
    return values


def _lay_on_grid(numbers: Sequence[int], table: FloatArray) -> Grid:
    x_mm, column = _grid_lines(table[:, 0])
    y_mm, row = _grid_lines(table[:, 1])
    if len(table) < _MIN_FILLED_FRAC * x_mm.size * y_mm.size:
        raise ModesError(
            f"has {len(table)} points for {x_mm.size} positions in x and {y_mm.size} in y; "
            "measure on a rectangular grid of lines parallel to the plate's edges."
        )
    node = row * x_mm.size + column
    _, first = np.unique(node, return_index=True)
    if first.size < len(table):
        double = numbers[int(np.setdiff1d(np.arange(len(table)), first)[0])]
        raise ModesError(f"line {double} repeats a point of the grid; delete one of the two.")
    shapes = np.full((table.shape[1] - 2, y_mm.size * x_mm.size), np.nan)
    shapes[:, node] = table[:, 2:].T
    return x_mm, y_mm, shapes.reshape(-1, y_mm.size, x_mm.size)


def _grid_lines(positions_mm: FloatArray) -> tuple[FloatArray, npt.NDArray[np.intp]]:
    """Return the distinct positions, and the index of each point's position among them."""
    order = np.argsort(positions_mm, kind="stable")
    ordered = positions_mm[order]
    starts = np.concatenate(([True], np.diff(ordered) > _SAME_LINE_MM))
    index = np.empty(positions_mm.size, np.intp)
    index[order] = np.cumsum(starts) - 1
    return ordered[starts], index
