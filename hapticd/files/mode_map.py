"""Map files as bytes: NPZ (arrays `x_mm`, `y_mm`, `shapes`) and CSV, the format a laboratory writes by hand.

CSV has the header `x_mm,y_mm,phi_1,...,phi_M` and one line per measured point, in any order. A point may be left
out, and an empty value or `nan` is a missing one: both become NaN. Lines that are blank or begin with # are
skipped. Positions within a micrometre of each other are one line of the grid.

Every ModesError says what is wrong and what to do; the caller knows the file's name and puts it in front.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from hapticd.errors import ModesError

Grid = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]

FORMATS = (".npz", ".csv")
MAX_BYTES = 1 << 24  # of a file, and of an array in it; 20 modes on 300 x 300 points have 14 million
MAX_LINES = 400  # of a grid along one axis: a third of a millimetre on the plate
MAX_POSITION_MM = 1e6  # from the plate's centre: wider is a damaged file, and could overflow

_SAME_LINE_MM = 1e-3  # a micrometre: far below any grid step, far above what printing a position loses
_MIN_FILLED_FRAC = 0.5  # below it the points are scattered, not on a grid


def decode_grid(data: bytes, suffix: str) -> Grid:
    """`x_mm` (nx,), `y_mm` (ny,), `shapes` (M, ny, nx) with NaN for what is missing. Raises ModesError only."""
    return _decode_npz(data) if suffix == ".npz" else _decode_csv(data)


def encode_grid(grid: Grid, suffix: str) -> bytes:
    """The file's bytes; `decode_grid` gives the same numbers to the last bit."""
    x_mm, y_mm, shapes = grid
    if suffix == ".npz":
        buffer = io.BytesIO()
        np.savez(buffer, x_mm=x_mm, y_mm=y_mm, shapes=shapes)
        return buffer.getvalue()
    lines = [",".join(_header(shapes.shape[0]))]
    for row, y in enumerate(y_mm.tolist()):
        for column, x in enumerate(x_mm.tolist()):
            lines.append(",".join(map(repr, (x, y, *shapes[:, row, column].tolist()))))
    return ("\n".join(lines) + "\n").encode()


def _decode_npz(data: bytes) -> Grid:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            x_mm, y_mm, shapes = (_member(archive, f"{name}.npy") for name in ("x_mm", "y_mm", "shapes"))
    except ModesError:
        raise
    except KeyError as error:
        raise ModesError("misses one of the arrays x_mm, y_mm, shapes; save it with these names.") from error
    except Exception as error:  # a damaged archive fails in any of zipfile's, zlib's and numpy's ways
        raise ModesError("is not a readable NPZ archive; save it again with numpy.savez.") from error
    if any(array.dtype.kind not in "fiu" for array in (x_mm, y_mm, shapes)):
        raise ModesError("holds arrays that are not real numbers; save x_mm, y_mm, shapes as float64.")
    with np.errstate(over="ignore", invalid="ignore"):  # a long double may become infinite or NaN, which is told there
        return x_mm.astype(np.float64), y_mm.astype(np.float64), shapes.astype(np.float64)


def _member(archive: zipfile.ZipFile, name: str) -> npt.NDArray[np.generic]:
    """One array. Neither a bomb of packed zeros nor a header that claims too much can take more than the bound."""
    if archive.getinfo(name).compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError("numpy packs in no other way, and these cannot be unpacked in pieces")
    with archive.open(name) as file:
        npy = file.read(MAX_BYTES + 1)
    if len(npy) > MAX_BYTES:
        raise ModesError(f"unpacks to an array of more than {MAX_BYTES >> 20} MiB; measure on a coarser grid.")
    head = io.BytesIO(npy)
    if np.lib.format.read_magic(head) != (1, 0):
        raise ValueError("an array of plain numbers has this version")
    shape, is_fortran, dtype = np.lib.format.read_array_header_1_0(head)
    values: npt.NDArray[np.generic] = np.frombuffer(npy, dtype, offset=head.tell())
    return values.reshape(shape, order="F" if is_fortran else "C")


def _decode_csv(data: bytes) -> Grid:
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ModesError("is not a text file; save the map as CSV in UTF-8.") from error
    lines = _rows(text)
    _, header = next(lines, (0, []))
    modes = len(header) - 2
    if modes < 1 or header != _header(modes):
        raise ModesError("does not begin with the header x_mm,y_mm,phi_1,...,phi_M; add it as the first line.")
    numbers: list[int] = []
    table: list[list[float]] = []
    for number, cells in lines:
        if len(table) == MAX_LINES**2:
            raise ModesError(f"has more than {MAX_LINES**2} points; measure on a coarser grid.")
        numbers.append(number)
        table.append(_parse_line(number, cells, len(header)))
    if not table:
        raise ModesError("holds a header and no points; add a line per measured point.")
    return _lay_on_grid(numbers, np.array(table))


def _rows(text: str) -> Iterator[tuple[int, list[str]]]:
    """Line number and stripped cells of every line that says something."""
    for number, line in enumerate(text.splitlines(), 1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield number, [cell.strip() for cell in line.split(",")]


def _header(modes: int) -> list[str]:
    return ["x_mm", "y_mm", *(f"phi_{k}" for k in range(1, modes + 1))]


def _parse_line(number: int, cells: Sequence[str], columns: int) -> list[float]:
    if len(cells) != columns:
        raise ModesError(f"line {number} has {len(cells)} values where the header has {columns}; complete it.")
    try:
        values = [float(cell) if cell else math.nan for cell in cells]
    except ValueError as error:
        raise ModesError(f"line {number} holds something that is not a number; correct or empty it.") from error
    if not all(abs(position_mm) <= MAX_POSITION_MM for position_mm in values[:2]):
        raise ModesError(f"line {number} does not say where its point lies; give x_mm and y_mm or delete it.")
    return values


def _lay_on_grid(numbers: Sequence[int], table: npt.NDArray[np.float64]) -> Grid:
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
        raise ModesError(f"line {double} gives a point of the grid a second time; delete one of the two.")
    shapes = np.full((table.shape[1] - 2, y_mm.size * x_mm.size), np.nan)
    shapes[:, node] = table[:, 2:].T
    return x_mm, y_mm, shapes.reshape(-1, y_mm.size, x_mm.size)


def _grid_lines(positions_mm: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.intp]]:
    """The distinct positions, and which of them each point is on."""
    order = np.argsort(positions_mm, kind="stable")
    ordered = positions_mm[order]
    starts = np.concatenate(([True], np.diff(ordered) > _SAME_LINE_MM))
    index = np.empty(positions_mm.size, np.intp)
    index[order] = np.cumsum(starts) - 1
    return ordered[starts], index
