"""Mode shapes of the simulated plate, and their normalisation.

    free plate       theory's, scaled to a peak of 1 over the whole plate. A free plate's peaks lie at its edges, so a
                     mode at W_LIM moves far less than that at the highest antinode that fingers reach.
    peak at fingers  the same shapes, in units of that antinode: a mode at W_LIM moves by as much there, and by more
                     at the edges.
    cosines          plane standing waves of the paper's wavelength, as if the plate had no edges.

Fingers reach to 10 mm from the edge. All modes have the same scale, given by X's antinode, so that friction is that of
the same plate for all.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from hapticd.design import ModeShape, legendre
from hapticd.design.free_plate import free_modes
from hapticd.design.materials import find_material
from hapticd.errors import SimulationError

from .glasses import REFERENCE, find_glass

FREE_PLATE, PEAK_AT_FINGERS, COSINES = KINDS = ("free plate", "peak at fingers", "cosines")
BEYOND_REACH_MM = 10.0  # from the edge
WAVELENGTH_MM = 27.0
_REFERENCE = "11x0"
_REACH_POINTS = 236
_DEGREE = 60  # of the Legendre series of five waves: their error is rounding


@lru_cache(maxsize=16)
def shapes(kind: str, names: tuple[str, ...], glass: str = REFERENCE) -> tuple[ModeShape, ...]:
    """Return a plate's modes with these nodal lines, such as "9x6", of a kind of KINDS; `glass` is a name or a file."""
    chosen = tuple(theory(name, glass)[1] for name in names)
    if kind == COSINES:
        return tuple(_cosine(shape) for shape in chosen)
    if kind == PEAK_AT_FINGERS:
        return tuple(replace(shape, coefficients=shape.coefficients / peak_at_fingers()) for shape in chosen)
    return chosen


def theory(name: str, glass: str = REFERENCE) -> tuple[float, ModeShape]:
    """Return frequency (Hz) and shape of a mode of the free plate. Raises SimulationError for an unknown name."""
    modes = _by_name(glass)
    if name not in modes:
        raise SimulationError(f"the {glass} plate has no mode {name!r} near its drive.")
    return modes[name]


def peak_at_fingers(name: str = _REFERENCE) -> float:
    """Return the highest antinode of a mode within reach of fingers, as a share of its peak over the plate."""
    shape = theory(name)[1]
    axes = [np.linspace(BEYOND_REACH_MM - mm / 2.0, mm / 2.0 - BEYOND_REACH_MM, _REACH_POINTS) for mm in shape.size_mm]
    return float(np.abs(shape.on_grid(*axes)).max())


def _cosine(shape: ModeShape) -> ModeShape:
    """Return the standing wave of the paper's wavelength with the nodal lines of `shape`, an antinode at the centre."""
    lines = math.hypot(*shape.nodal_lines)
    nodes, weights = np.polynomial.legendre.leggauss(2 * _DEGREE)
    at_nodes = legendre.values(nodes, _DEGREE)
    across = []
    for count, edge_mm in zip(shape.nodal_lines, shape.size_mm, strict=True):
        wave = np.cos(math.pi * edge_mm / WAVELENGTH_MM * count / lines * nodes)
        across.append(at_nodes.T @ (weights * wave))
    return replace(shape, coefficients=np.outer(*across))


@lru_cache(maxsize=4)
def _by_name(glass: str) -> dict[str, tuple[float, ModeShape]]:
    plate = find_glass(glass)
    try:
        modes = free_modes(plate.size_mm, plate.thickness_mm, find_material(plate.material), plate.band_hz)
    except ValueError as error:  # of a plate that a file describes
        raise SimulationError(f"the {glass} plate: {error}") from None
    return {shape.name: (frequency_hz, shape) for frequency_hz, shape in modes}
