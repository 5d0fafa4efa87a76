"""The mode matrix of two fingers: what ways to interpolate a measured map cost, and what their errors leak.

The leak is that of the whole path if all else were perfect: two random positions, one finger at 1 um and one still,
modal amplitudes from the map, and the plate's true shapes under the still finger. Maps are fitted to noisy scans of the
reference plate; `interpolation` is the leak of a map without noise.

And the modes of plates, two bare ones and random ones with patches: how far frequencies and shapes are from those of
four degrees more along every interval, and what the solution takes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from time import perf_counter

import numpy as np
from scipy.interpolate import RectBivariateSpline

from ..core.plate.bicubic import POINT
from ..core.plate.mode_shapes import ModeShapes
from ..core.plate.splines import evaluate
from ..core.solver import solve_batch
from ..design import ModeShape
from ..design.glued_plate import GluedPlate, Patch
from ..design.materials import MATERIALS
from ..sim.plate.ground_truth import DRIVEN_MODES, GroundTruth
from ..sim.plate.shapes import theory
from ..values import FloatArray
from .tables import Table
from .timing import REPEATS, least_us

_Shapes = Callable[[float, float], Sequence[float]]  # of all modes at one position, in mm

W_LIMIT_UM = (4.0, 4.0)
HALF_SIZE_MM = 58.0  # the area that fingers reach
BAND_HZ, NEAR_HZ, ALIKE_HZ = (28900.0, 29100.0), 20.0, 3.0


def run(
    *, pairs: int = 1000, seeds: Sequence[int] = (1, 2, 3), repeats: int = REPEATS, timed: int = 200, plates: int = 10
) -> tuple[Table, Table]:
    """Compare interpolators on `pairs` of random positions over the maps of `seeds`; `timed` pairs are timed."""
    plate = GroundTruth()
    points_mm = np.random.default_rng(7).uniform(-HALF_SIZE_MM, HALF_SIZE_MM, (pairs, 2, 2))
    flat = [theory(name)[1].evaluate(points_mm.reshape(-1, 2)) for name in DRIVEN_MODES]
    true_phi = np.stack(flat, axis=-1).reshape(pairs, 2, -1)
    of_maps = [_ways(plate.measured_mode_map(seed)) for seed in seeds]
    of_truth = _ways(plate.true_mode_map())
    times_us = least_us(
        {name: (partial(_all, way, points_mm[:timed]), timed) for name, way in of_maps[0].items()}, repeats
    )
    rows = {
        name: {
            "time_us": times_us[name],
            "leak_um": _leak_um([_all(ways[name], points_mm) for ways in of_maps], true_phi),
            "interpolation_um": _leak_um([_all(of_truth[name], points_mm)], true_phi),
        }
        for name in of_truth
    }
    title = "modes: the mode matrix of 2 fingers and 2 modes; um leaked at the still finger per um at the other"
    return Table("modes", title, rows, ("interpolation: the leak of a map without noise",)), _converged(plates)


def _converged(count: int) -> Table:
    glass, random = MATERIALS["glass"], np.random.default_rng(5)
    plates = [GluedPlate((137.5, 137.5), 2.0, glass), GluedPlate((200.0, 200.0), 3.0, glass)]
    plates += [_random_plate(random) for _ in range(count)]
    rows = {}
    for plate in plates:
        name = "x".join(f"{mm:g}" for mm in (*plate.size_mm, plate.thickness_mm)) + f", {len(plate.patches)} patches"
        began = perf_counter()
        modes = plate.modes(BAND_HZ)
        took_s = perf_counter() - began
        finer = plate.modes((BAND_HZ[0] - NEAR_HZ, BAND_HZ[1] + NEAR_HZ), 4)
        rows[name] = {
            "modes_count": float(len(modes)),
            "error_hz": max((min(abs(hz - other_hz) for other_hz, _ in finer) for hz, _ in modes), default=0.0),
            "least_correlation": min((_correlation(shape, finer, hz) for hz, shape in modes), default=1.0),
            "time_s": took_s,
        }
    title = f"plates: modes at {BAND_HZ[0]:g} .. {BAND_HZ[1]:g} Hz against those of four degrees more"
    return Table("plates", title, rows, ("correlation: with all modes within 3 Hz, whose plane may turn",))


def _random_plate(random: np.random.Generator) -> GluedPlate:
    """Return any rectangle with any patches of half a millimetre, none over another."""
    width_mm, depth_mm = (round(float(mm), 1) for mm in random.uniform(100.0, 300.0, 2))
    patches: list[Patch] = []
    count = int(random.integers(2, 11))
    while len(patches) < count:
        x_mm, y_mm = (random.uniform(-0.5, 0.5, 2) * (width_mm - 20.0, depth_mm - 20.0)).round(1).tolist()
        size_mm = [(20.0, 10.0), (10.0, 20.0), (15.0, 15.0)][random.integers(3)]
        if all(max(abs(x_mm - other.x_mm), abs(y_mm - other.y_mm)) > 20.0 for other in patches):
            patches.append(Patch(x_mm, y_mm, size_mm, 0.5))
    thickness_mm = round(float(random.uniform(1.0, 4.0)), 2)
    return GluedPlate((width_mm, depth_mm), thickness_mm, MATERIALS["glass"], tuple(patches))


def _correlation(shape: ModeShape, finer: Sequence[tuple[float, ModeShape]], hz: float) -> float:
    axes_mm = [np.linspace(-edge_mm / 2.0, edge_mm / 2.0, 101) for edge_mm in shape.size_mm]
    near = np.stack([other.on_grid(*axes_mm).ravel() for at_hz, other in finer if abs(at_hz - hz) < ALIKE_HZ], axis=1)
    own = shape.on_grid(*axes_mm).ravel()
    held = near @ np.linalg.lstsq(near, own)[0]
    return float(np.sqrt((held @ held) / (own @ own)))


def _ways(modes: ModeShapes) -> dict[str, _Shapes]:
    surfaces = [RectBivariateSpline(modes.y_mm, modes.x_mm, shape) for shape in modes.shapes]
    return {
        "bicubic": partial(_bicubic, modes),
        "RectBivariateSpline": lambda x_mm, y_mm: [float(one.ev(y_mm, x_mm)) for one in surfaces],
    }


def _bicubic(modes: ModeShapes, x_mm: float, y_mm: float) -> Sequence[float]:
    """As the solver has it."""
    return memoryview(evaluate(modes.tables, POINT, [(x_mm, y_mm)], None, 0.0, False)).cast("d")


def _all(shapes: _Shapes, points_mm: FloatArray) -> FloatArray:
    """Return the mode matrices (pairs, 2, M)."""
    return np.array([[shapes(x_mm, y_mm) for x_mm, y_mm in pair] for pair in points_mm.tolist()])


def _leak_um(of_maps: Sequence[FloatArray], true_phi: FloatArray) -> float:
    """Return the RMS amplitude at the still finger over that at the other, by the true shapes."""
    modal_um = [solve_batch(phi, (1.0, 0.0), W_LIMIT_UM) for phi in of_maps]
    got_um = np.einsum("pnm,spm->spn", true_phi, np.array(modal_um))
    slipping_um, still_um = np.sqrt(np.mean(got_um**2, axis=(0, 1)))
    return float(still_um / slipping_um)
