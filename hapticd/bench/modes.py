"""The mode matrix at two fingers: how an interpolator's error leaks, and what it costs.

The measure is what the whole path would leak if all else were perfect: two random positions, one finger at 1 um and
one still, the modes solved from the map, and the plate's true shapes under the still finger. Each interpolator reads
the raw scan (4.5 mm, 2 % of noise) and the map fitted to it (1.4 mm).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ..core.modes import ModeShapes
from ..core.solver import solve_fast
from ..design import free_plate_modes, sample_cartography
from ..sim.plate import DRIVEN_MODES, PlateSettings, PlateTruth
from .tables import Table, finite_rows
from .timing import REPEATS, compare, optional

FloatArray = npt.NDArray[np.float64]
Shapes = Callable[[Sequence[tuple[float, float]]], Any]  # points -> (N, M), in whatever form it comes

W_LIMIT_UM = (4.0, 4.0)
HALF_SIZE_MM = 58.0  # where fingers are
DEFAULT = "bicubic at, fitted map"


def run(*, pairs: int = 2000, seeds: Sequence[int] = (1, 2, 3), repeats: int = REPEATS, calls: int = 400) -> Table:
    """Compare interpolators on `pairs` random finger pairs over the scans of `seeds`."""
    truth = PlateTruth()
    points_mm = np.random.default_rng(7).uniform(-HALF_SIZE_MM, HALF_SIZE_MM, (pairs, 2, 2))
    true_phi = truth.shapes(points_mm)[..., : len(DRIVEN_MODES)]
    scale = float(np.sqrt(np.mean(true_phi**2)))
    interpolate = optional("scipy.interpolate")

    ways: dict[str, list[Shapes]] = {}  # by name, one for each scan
    for source, maps in (("fitted map", [truth.cartography(seed) for seed in seeds]), ("raw scan", _scans(seeds))):
        for modes in maps:
            for name, way in _alternatives(modes, interpolate).items():
                ways.setdefault(f"{name}, {source}", []).append(way)
    times = compare({name: _timed(of_scans[0], points_mm, calls) for name, of_scans in ways.items()}, repeats)
    rows = []
    for name, of_scans in ways.items():
        phi = np.stack([_evaluate(way, points_mm) for way in of_scans])
        errors = {
            "leak_um_per_um": _leak_um_per_um(phi, true_phi),
            "shape_error_frac": float(np.sqrt(np.mean((phi - true_phi) ** 2))) / scale,
        }
        rows.append((name, {**times[name].figures(), **errors}))
    return Table(
        name="modes",
        title="modes: the mode matrix of 2 fingers and 2 modes; um leaked at the still finger per um at the other",
        default=DEFAULT,
        rows=finite_rows(rows),
        compared=("time_us", "leak_um_per_um"),
        time="time_us",
        error="leak_um_per_um",
        skipped={} if interpolate else {"RectBivariateSpline": "scipy is not installed"},
    )


def _scans(seeds: Sequence[int]) -> list[ModeShapes]:
    """The plate's scans as the fit gets them, unsmoothed."""
    theory = {shape.name: shape for _, shape in free_plate_modes()}
    settings = PlateSettings()
    return [
        ModeShapes.from_grid(
            *sample_cartography(
                [theory[name] for name in DRIVEN_MODES],
                step_mm=settings.cartography_step_mm,
                noise_frac=settings.cartography_noise_frac,
                seed=seed,
            )
        )
        for seed in seeds
    ]


def _alternatives(modes: ModeShapes, interpolate: Any | None) -> dict[str, Shapes]:
    at, evaluate = modes.at, modes.evaluate
    grid = _Grid(modes)
    ways: dict[str, Shapes] = {
        "nearest": lambda points: [grid.nearest(x, y) for x, y in points],
        "bilinear": lambda points: [grid.bilinear(x, y) for x, y in points],
        "bicubic at": lambda points: [at(x, y) for x, y in points],
        "bicubic evaluate": evaluate,
    }
    if interpolate is not None:
        splines = [interpolate.RectBivariateSpline(modes.y_mm, modes.x_mm, shape) for shape in modes.shapes]
        ways["RectBivariateSpline"] = lambda points: [
            [float(spline(y, x, grid=False)) for spline in splines] for x, y in points
        ]
    return ways


class _Grid:
    """The simple interpolators, written as `ModeShapes.at` is: plain floats, values looked up by cell."""

    def __init__(self, modes: ModeShapes) -> None:
        self._x, self._y = modes.x_mm.tolist(), modes.y_mm.tolist()
        self._values = [[tuple(point) for point in row] for row in np.moveaxis(modes.shapes, 0, -1).tolist()]

    def nearest(self, x_mm: float, y_mm: float) -> tuple[float, ...]:
        row, column, u, v = self._cell(x_mm, y_mm)
        return self._values[row + (v >= 0.5)][column + (u >= 0.5)]

    def bilinear(self, x_mm: float, y_mm: float) -> tuple[float, ...]:
        row, column, u, v = self._cell(x_mm, y_mm)
        low, high = self._values[row], self._values[row + 1]
        return tuple(
            [
                (a * (1 - u) + b * u) * (1 - v) + (c * (1 - u) + d * u) * v
                for a, b, c, d in zip(low[column], low[column + 1], high[column], high[column + 1], strict=True)
            ]
        )

    def _cell(self, x_mm: float, y_mm: float) -> tuple[int, int, float, float]:
        x, y = self._x, self._y
        column = bisect_right(x, x_mm, 1, len(x) - 1) - 1
        row = bisect_right(y, y_mm, 1, len(y) - 1) - 1
        return row, column, (x_mm - x[column]) / (x[column + 1] - x[column]), (y_mm - y[row]) / (y[row + 1] - y[row])


def _timed(way: Shapes, points_mm: FloatArray, calls: int) -> tuple[Callable[[], object], int]:
    pairs = [[(x, y) for x, y in pair] for pair in points_mm[:calls].tolist()]

    def all_pairs() -> None:
        for pair in pairs:
            way(pair)

    return all_pairs, len(pairs)


def _evaluate(way: Shapes, points_mm: FloatArray) -> FloatArray:
    return np.array([np.asarray(way([(x, y) for x, y in pair])) for pair in points_mm.tolist()], np.float64)


def _leak_um_per_um(phi: FloatArray, true_phi: FloatArray) -> float:
    """RMS amplitude at the still finger over that at the other, by the true shapes; `phi` (maps, pairs, 2, M)."""
    modal_um = np.array(
        [
            [solve_fast((tuple(rows[0]), tuple(rows[1])), (1.0, 0.0), W_LIMIT_UM)[0] for rows in pairs]
            for pairs in phi.tolist()
        ]
    )
    got_um = np.abs(np.einsum("pnm,spm->spn", true_phi, modal_um))
    slipping_um, still_um = np.sqrt(np.mean(got_um**2, axis=(0, 1)))
    return float(still_um / slipping_um)
