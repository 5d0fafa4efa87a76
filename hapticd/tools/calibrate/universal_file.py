"""Scans as vibrometers export them: a universal file (UFF) with nodes (15 or 2411), units (164), and functions (58).

Each driven mode is a reference of its own (record 6 of dataset 58: load case, reference node and direction), as when
one amplifier after the other drives; where a reference comes again at a point, as in exports that were joined to one
file, it is the next mode. A mode is read at the frequency where all its functions together are largest. Frequency
responses count, or where there are none the first other kind of `RESPONSES`, and only those normal to the plate: +Z, -Z
(whose sign is turned), or without a direction. Positions are metres without units.
"""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...errors import ModesError, missing_library
from ...formats.mode_map import MAX_LINES, MAX_POSITION_MM, Scan
from ...regular_file import read_bounded
from ...values import ComplexArray, FloatArray

SUFFIXES = (".uff", ".unv")
MAX_BYTES = 1 << 26  # a spectrum at each point, twice
MAX_SETS = 1 << 16
NODES, UNITS, FUNCTION = (15, 2411), 164, 58
RESPONSES = (4, 5, 3, 12, 0)  # FRF, transmissibility, cross spectrum, spectrum, unknown
KINDS = {1: "time response", 2: "auto spectrum", 3: "cross spectrum", 4: "FRF", 5: "transmissibility", 6: "coherence"}
KINDS |= {9: "power spectral density", 12: "spectrum", 18: "mode indicator", 26: "multiple coherence"}
PER_METRE = {"m": 1.0, "cm": 100.0, "mm": 1000.0, "in": 1.0 / 0.0254}
MOST_EXTENT_MM = 1500.0  # of a scan's points: plates have edges up to 1000
NORMAL = {0: 1.0, 3: 1.0, -3: -1.0}  # response direction: sign

_Set = Mapping[str, Any]


class UniversalScan(NamedTuple):
    """A scan, and how many functions of the file are not in it, by what they are."""

    scan: Scan
    left_out: Mapping[str, int]


_Reference = tuple[int, int, int, int]  # how often it was there, load case, node, direction


def read_universal(path: Path, unit: str | None = None) -> UniversalScan:
    """Read a scan from a UFF, whose positions are in `unit`, or as it says.

    Raises ModesError for bytes that are none, HapticdError without pyuff.
    """
    try:
        import pyuff
    except ModuleNotFoundError:
        raise missing_library("A universal file (UFF) needs pyuff", "uff") from None
    try:
        data = read_bounded(path, MAX_BYTES)
    except OSError as error:
        raise ModesError(f"{path}: cannot be read ({error.strerror}); check the path and its permissions.") from None
    with tempfile.NamedTemporaryFile(suffix=".uff") as copy:  # of a regular file within bounds: pyuff opens a name
        copy.write(data)
        copy.flush()
        try:
            file = pyuff.UFF(copy.name)
            known = [k for k, kind in enumerate(file.get_set_types()) if int(kind) in (*NODES, UNITS, FUNCTION)]
            return scan_of([file.read_sets(k) for k in known[:MAX_SETS]], unit)
        except ModesError as error:
            raise ModesError(f"{path}: {error}") from None
        except Exception as error:  # pyuff raises whatever Python does for a damaged file
            raise ModesError(f"{path}: is no readable universal file ({error}); export it again.") from None


def scan_of(sets: Sequence[_Set], unit: str | None = None) -> UniversalScan:
    """Return the scan that these datasets hold, as pyuff reads them. Raises ModesError."""
    positions_mm = _positions_mm(sets, unit)
    functions, left_out = _responses([one for one in sets if one["type"] == FUNCTION])
    own: dict[_Reference, dict[int, _Set]] = {}
    for one in functions:
        node, times = int(one["rsp_node"]), 0
        driven_by = int(one["load_case_id"]), int(one["ref_node"]), int(one["ref_dir"])
        while node in own.setdefault((times, *driven_by), {}):
            times += 1
        own[times, *driven_by][node] = one
    if not (positions_mm and functions):
        others = f" (but {', '.join(left_out)})" if left_out else ""
        raise ModesError(
            "holds no nodes (dataset 15 or 2411) or no frequency responses normal to the plate (58)"
            f"{others}; export both."
        )
    nodes = sorted({int(one["rsp_node"]) for one in functions})
    unknown = next((node for node in nodes if node not in positions_mm), None)
    if unknown is not None:
        raise ModesError(f"has no position of node {unknown}; export the geometry too.")
    if len(nodes) > MAX_LINES**2:
        raise ModesError(f"has more than {MAX_LINES**2} points; measure on a coarser grid.")
    readings = np.full((len(nodes), len(own)), np.nan, np.complex128)
    for mode, key in enumerate(sorted(own)):
        readings[np.searchsorted(nodes, [*own[key]]), mode] = _at_peak([*own[key].values()])
    is_real = not np.nan_to_num(readings.imag).any()
    points_mm = np.array([positions_mm[node] for node in nodes])
    extent_mm = np.ptp(points_mm, axis=0).max()
    if not extent_mm <= MOST_EXTENT_MM:
        raise ModesError(
            f"has points {extent_mm / 1e3:g} m apart by its unit (metres where it says none): "
            f"give --unit mm, or another one of {', '.join(PER_METRE)}."
        )
    return UniversalScan(Scan(points_mm, readings.real if is_real else readings), left_out)


def _responses(functions: Sequence[_Set]) -> tuple[list[_Set], Counter[str]]:
    """Return the functions that are a scan's, and how many others there are."""
    kinds = {int(one["func_type"]) for one in functions}
    chosen = next((kind for kind in RESPONSES if kind in kinds), RESPONSES[0])
    found, left_out = [], Counter[str]()
    for one in functions:
        kind = int(one["func_type"])
        if kind != chosen:
            left_out[KINDS.get(kind, f"function type {kind}")] += 1
        elif int(one["rsp_dir"]) not in NORMAL:
            left_out["response along the plate"] += 1
        else:
            found.append(one)
    return found, left_out


def _positions_mm(sets: Sequence[_Set], unit: str | None) -> dict[int, FloatArray]:
    """Return x and y of each node in mm. Raises ModesError."""
    said = next((float(one["length"]) for one in sets if one["type"] == UNITS), None)
    per_metre = PER_METRE["m" if unit is None else unit] if unit is not None or said is None else said
    if not (np.isfinite(per_metre) and per_metre > 0.0):
        raise ModesError("has no usable unit of length (dataset 164); export it in metres or millimetres.")
    found = {}
    for one in sets:
        if one["type"] in NODES:
            at_mm = np.column_stack([one["x"], one["y"]]).astype(np.float64) * 1e3 / per_metre
            found.update({int(number): position for number, position in zip(one["node_nums"], at_mm, strict=True)})
    if not all(np.abs(position).max() <= MAX_POSITION_MM for position in found.values()):
        raise ModesError("has a node without a usable position; export the geometry again.")
    return found


def _at_peak(functions: Sequence[_Set]) -> ComplexArray:
    """Return each function's value at the frequency where all of them together are largest. Raises ModesError."""
    lengths = {len(one["data"]) for one in functions}
    if len(lengths) != 1 or not min(lengths):
        raise ModesError("has functions of different lengths, or without values; export one band for all points.")
    values = np.array([NORMAL[int(one["rsp_dir"])] * np.asarray(one["data"], np.complex128) for one in functions])
    with np.errstate(over="ignore"):  # of damaged values: the fit judges them
        power = np.nansum(np.abs(values) ** 2, axis=0)
    return values[:, int(power.argmax())]
