"""Tables of the true mode shapes, with what disturbs them, and the mode map that a scan of them gives."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from hapticd.core.plate.mode_shapes import BicubicSurfaces, ModeShapes
from hapticd.design import ModeShape, fit_cartography, sample_cartography
from hapticd.values import FloatArray

from . import coupled_modes, disturbances
from .coupled_modes import Coupling, Plain
from .shapes import theory

_TABLE_POINTS = 161  # per axis: the interpolated shapes are within 1e-4 of the theory's
_RMS_POINTS = 101
_KEPT = 6  # tables


class Disturbed(NamedTuple):
    """How the shapes differ from theory: the shares of `WorldErrors` and its seed, and what joins the modes, whose
    frequencies are `frequency_hz`."""

    glue_frac: float = 0.0
    waves_frac: float = 0.0
    local_frac: float = 0.0
    seed: int = 0
    coupling: Coupling = Coupling()
    frequency_hz: tuple[float, ...] = ()


class ModeScan(NamedTuple):
    """A scan of some modes: its grid, noise and seed. `first` mode: each map has noise of its own."""

    step_mm: float
    noise_frac: float
    seed: int
    first: int


def _added(
    axes_mm: tuple[FloatArray, FloatArray], bare: tuple[ModeShape, ...], first: int, how: Disturbed
) -> FloatArray:
    """Return what is added to the bare shapes, the first of which is mode `first`, on a grid: (modes, ny, nx)."""
    added = np.zeros((len(bare), len(axes_mm[1]), len(axes_mm[0])))
    for index, shape in enumerate(bare):
        rms = _rms(shape)
        for purpose, frac in ((disturbances.GLUE, how.glue_frac), (disturbances.CHANGE, how.waves_frac)):
            if frac:
                stream = how.seed, purpose, first + index
                added[index] += frac * rms * disturbances.waves(*axes_mm, shape.size_mm, stream)
        if how.local_frac:
            stream = how.seed, disturbances.CHANGE, first + index
            added[index] += how.local_frac * disturbances.cusps(*axes_mm, shape.size_mm, stream)
    return added


def _rms(shape: ModeShape) -> float:
    axes_mm = (np.linspace(-edge_mm / 2.0, edge_mm / 2.0, _RMS_POINTS) for edge_mm in shape.size_mm)
    return float(np.sqrt(np.mean(shape.on_grid(*axes_mm) ** 2)))


def _bare(glass: str, names: tuple[str, ...]) -> tuple[ModeShape, ...]:
    return tuple(theory(name, glass)[1] for name in names)


@lru_cache(maxsize=_KEPT)
def _bare_grid(glass: str, names: tuple[str, ...]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Tabulate the shapes: summing their Legendre series at every point takes several times as long."""
    shapes = _bare(glass, names)
    x_mm, y_mm = (np.linspace(-edge_mm / 2.0, edge_mm / 2.0, _TABLE_POINTS) for edge_mm in shapes[0].size_mm)
    return x_mm, y_mm, np.stack([shape.on_grid(x_mm, y_mm) for shape in shapes])


@lru_cache(maxsize=_KEPT)
def true_grid(glass: str, names: tuple[str, ...], disturbed: Disturbed) -> tuple[FloatArray, FloatArray, FloatArray]:
    x_mm, y_mm, shapes = _bare_grid(glass, names)
    if disturbed.coupling != Coupling():
        mix, _ = coupled(glass, names, disturbed.coupling, disturbed.frequency_hz)
        shapes = np.einsum("nk,kyx->nyx", mix, shapes)
    return x_mm, y_mm, shapes + _added((x_mm, y_mm), _bare(glass, names), 0, disturbed)


def coupled(
    glass: str, names: tuple[str, ...], how: Coupling, frequency_hz: tuple[float, ...]
) -> tuple[FloatArray, FloatArray]:
    """Return how the modes mix (P, P), new by old, and by how much their frequencies rise (P,)."""
    bare = _bare(glass, names)
    corner_mm, springs_mm = coupled_modes.places_mm(how, bare[0].size_mm)
    at_corner, at_springs = (
        np.stack([shape.evaluate(points_mm) for shape in bare], axis=-1) for points_mm in (corner_mm, springs_mm)
    )
    plain = Plain(np.array(frequency_hz), np.array([_rms(shape) ** 2 for shape in bare]), bare[0].size_mm)
    return coupled_modes.mixed(how, plain, at_corner, at_springs)


@lru_cache(maxsize=_KEPT)
def true_surfaces(glass: str, names: tuple[str, ...], disturbed: Disturbed) -> BicubicSurfaces:
    return BicubicSurfaces(*true_grid(glass, names, disturbed))


@lru_cache(maxsize=16)
def mode_map(glass: str, names: tuple[str, ...], scan: ModeScan, glued: Disturbed) -> ModeShapes:
    bare = _bare(glass, names)
    seed = scan.seed if scan.first == 0 else (scan.seed, scan.first)
    x_mm, y_mm, shapes = sample_cartography(bare, step_mm=scan.step_mm, noise_frac=scan.noise_frac, seed=seed)
    shapes += _added((x_mm, y_mm), bare, scan.first, glued)
    return fit_cartography(x_mm, y_mm, shapes, size_mm=bare[0].size_mm, normalise=False).modes
