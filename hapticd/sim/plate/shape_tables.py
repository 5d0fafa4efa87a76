"""Tables of the true mode shapes, with what disturbs them, and the mode map that a scan of them gives.

What disturbs them are functions that no fit of the daemon's contains: waves of other lengths than the plate's own in
random directions, and cusps. Each mode and each purpose has a random stream of its own.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from hapticd.core.plate.mode_shapes import BicubicSurfaces, ModeShapes
from hapticd.design import ModeShape, fit_scan, sample_cartography
from hapticd.design.cartography import map_axis
from hapticd.values import FloatArray

from ..world_errors import WorldErrors
from . import coupled_modes, stored
from .glasses import find_glass
from .shapes import theory

_TABLE_POINTS = 161  # per axis: the interpolated shapes are within 1e-4 of the theory's
_RMS_POINTS = 101
_KEPT = 6  # tables
GLUE, _CHANGE = 1, 2  # purposes: present at the scan, and since
_WAVES = 12
_LENGTHS_MM = (18.0, 50.0)  # the plates' own waves: 27 and 32 mm
_CUSPS = 3
_CUSP_MM = (6.0, 15.0)  # in which a cusp falls to 1/e
_NORM_POINTS = 101


class ModeScan(NamedTuple):
    """A scan of some modes: its grid, noise and seed, and the glue that it meets. `first` mode: each map has noise of
    its own."""

    step_mm: float
    noise_frac: float
    seed: int
    first: int
    glue_frac: float
    glue_seed: int


def _added(
    axes_mm: tuple[FloatArray, FloatArray], bare: tuple[ModeShape, ...], first: int, world: WorldErrors
) -> FloatArray:
    """Return what is added to the bare shapes, the first of which is mode `first`, on a grid: (modes, ny, nx)."""
    added = np.zeros((len(bare), len(axes_mm[1]), len(axes_mm[0])))
    for index, shape in enumerate(bare):
        for purpose, frac in ((GLUE, world.glue_frac), (_CHANGE, world.map_change.waves_frac)):
            if frac:
                stream = world.seed, purpose, first + index
                added[index] += frac * _rms(shape) * waves(*axes_mm, shape.size_mm, stream)
        if world.map_change.local_frac:
            stream = world.seed, _CHANGE, first + index
            added[index] += world.map_change.local_frac * _cusps(*axes_mm, shape.size_mm, stream)
    return added


def waves(x_mm: FloatArray, y_mm: FloatArray, size_mm: tuple[float, float], stream: tuple[int, int, int]) -> FloatArray:
    """Return other waves (ny, nx) with an RMS of 1 over the plate; `stream` is seed, purpose and mode."""
    random = np.random.default_rng([*stream, 0])
    wave_rad_mm = 2.0 * np.pi / random.uniform(*_LENGTHS_MM, _WAVES)
    turn_rad, phase_rad = random.uniform(0.0, 2.0 * np.pi, (2, _WAVES))
    kx, ky = wave_rad_mm * np.cos(turn_rad), wave_rad_mm * np.sin(turn_rad)

    def summed(x: FloatArray, y: FloatArray) -> FloatArray:
        along_x = np.exp(1j * (np.outer(kx, x) + phase_rad[:, None]))
        return np.asarray(np.einsum("wy,wx->yx", np.exp(1j * np.outer(ky, y)), along_x).real)

    edges = [np.linspace(-edge_mm / 2.0, edge_mm / 2.0, _NORM_POINTS) for edge_mm in size_mm]
    rms = float(np.sqrt(np.mean(summed(*edges) ** 2)))
    return summed(x_mm, y_mm) / rms


def _cusps(
    x_mm: FloatArray, y_mm: FloatArray, size_mm: tuple[float, float], stream: tuple[int, int, int]
) -> FloatArray:
    """Return some cusps (ny, nx) of height 1 and either sign at random places."""
    random = np.random.default_rng([*stream, 1])
    total = np.zeros((len(y_mm), len(x_mm)))
    for _ in range(_CUSPS):
        at_x_mm, at_y_mm = random.uniform(-0.5, 0.5, 2) * size_mm
        far_mm = np.hypot(x_mm - at_x_mm, (y_mm - at_y_mm)[:, None])
        total += random.choice((-1.0, 1.0)) * np.exp(-far_mm / random.uniform(*_CUSP_MM))
    return total


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
def true_grid(
    glass: str, names: tuple[str, ...], world: WorldErrors, frequency_hz: tuple[float, ...]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the axes of a grid, and on it the shapes of modes of these frequencies in a world of a plate's errors."""
    x_mm, y_mm, shapes = _bare_grid(glass, names)
    if world.couples_modes:
        shapes = np.einsum("nk,kyx->nyx", coupled(glass, names, world, frequency_hz)[0], shapes)
    return x_mm, y_mm, shapes + _added((x_mm, y_mm), _bare(glass, names), 0, world)


def coupled(
    glass: str, names: tuple[str, ...], world: WorldErrors, frequency_hz: tuple[float, ...]
) -> tuple[FloatArray, FloatArray]:
    """Return how the modes mix (P, P), new by old, and by how much their frequencies rise (P,)."""
    bare = _bare(glass, names)
    return coupled_modes.coupled(world, bare, np.array([_rms(shape) ** 2 for shape in bare]), np.array(frequency_hz))


@lru_cache(maxsize=_KEPT)
def true_surfaces(
    glass: str, names: tuple[str, ...], world: WorldErrors, frequency_hz: tuple[float, ...]
) -> BicubicSurfaces:
    return BicubicSurfaces(*true_grid(glass, names, world, frequency_hz))


@lru_cache(maxsize=16)
def mode_map(glass: str, names: tuple[str, ...], scan: ModeScan) -> ModeShapes:
    coefficients = stored.find(find_glass(glass), names, scan)
    if coefficients is None:
        return fitted(glass, names, scan)
    size_mm = find_glass(glass).size_mm
    axes_mm = map_axis(size_mm[0]), map_axis(size_mm[1])
    return ModeShapes.from_grid(*axes_mm, stored.series(coefficients, size_mm, *axes_mm))


def fitted(glass: str, names: tuple[str, ...], scan: ModeScan) -> ModeShapes:
    """Return the map that the fit of a scan gives."""
    bare = _bare(glass, names)
    seed = scan.seed if scan.first == 0 else (scan.seed, scan.first)
    x_mm, y_mm, shapes = sample_cartography(bare, step_mm=scan.step_mm, noise_frac=scan.noise_frac, seed=seed)
    shapes += _added((x_mm, y_mm), bare, scan.first, WorldErrors(glue_frac=scan.glue_frac, seed=scan.glue_seed))
    points_mm = np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)
    return fit_scan(points_mm, shapes.reshape(len(shapes), -1).T, size_mm=bare[0].size_mm, normalise=False).modes
