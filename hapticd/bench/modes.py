"""The mode matrix of two fingers: leak and run time of each interpolator.

The leak is that of the whole path if all else were perfect: two random positions, one finger at 1 um and one still,
the modes solved from the map, and the plate's true shapes under the still finger. Each interpolator reads the map that
was fitted to a scan (4.5 mm, 2 % of noise) on a grid of 1.4 mm and, for its own share of the error, a map of the same
grid without noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

from ..core.plate.mode_shapes import ModeShapes
from ..core.solver.public import solve_fast
from ..design import ModeShape, fit_cartography, free_plate_modes, sample_cartography
from ..sim.plate.ground_truth import DRIVEN_MODES, PlateSettings
from .interpolators import Evaluate, FloatArray, Interpolator, Points, interpolators
from .tables import Table, finite_rows
from .timing import REPEATS, compare, optional

W_LIMIT_UM = (4.0, 4.0)
HALF_SIZE_MM = 58.0  # the area that fingers reach
DEFAULT = "bicubic"


def run(*, pairs: int = 2000, seeds: Sequence[int] = (1, 2, 3), repeats: int = REPEATS, calls: int = 400) -> Table:
    """Compare interpolators on `pairs` random finger pairs over the scans of `seeds`; `calls` of them are timed."""
    interpolate = optional("scipy.interpolate")
    points_mm = random_pairs_mm(pairs)
    true_phi, true_slopes = _true_shapes(points_mm)
    maps = [_fitted(seed) for seed in seeds]
    x_mm, y_mm = maps[0].x_mm, maps[0].y_mm
    without_noise = ModeShapes.from_grid(x_mm, y_mm, np.stack([one.on_grid(x_mm, y_mm) for one in driven_shapes()]))
    of_maps = [interpolators(modes, interpolate) for modes in maps]
    of_truth = interpolators(without_noise, interpolate)
    timed = {name: _timed(one.shapes, points_mm, calls) for name, one in of_maps[0].items()}
    timed |= {f"{name} gradient": _timed(one.with_gradient, points_mm, calls) for name, one in of_maps[0].items()}
    times = compare(timed, repeats)
    rows = [
        (
            name,
            {
                **times[name].figures(),
                **times[f"{name} gradient"].figures("gradient_time"),
                **_errors([one[name] for one in of_maps], points_mm, true_phi, true_slopes),
                "interpolation_um_per_um": leak_um_per_um(_evaluated(of_truth[name].shapes, points_mm)[None], true_phi),
            },
        )
        for name in of_truth
    ]
    return Table(
        name="modes",
        title="modes: the mode matrix of 2 fingers and 2 modes; um leaked at the still finger per um at the other",
        default=DEFAULT,
        rows=finite_rows(rows),
        compared=("time_us", "gradient_time_us", "leak_um_per_um"),
        time="time_us",
        error="leak_um_per_um",
        skipped={} if interpolate else dict.fromkeys(("RectBivariateSpline", "quintic"), "scipy is not installed"),
        notes=("gradient time: shapes and gradients together; interpolation: the leak of a map without noise",),
    )


@lru_cache(maxsize=1)
def driven_shapes() -> tuple[ModeShape, ...]:
    """Return the theory's X and Y, the ground truth of this bench."""
    theory = {shape.name: shape for _, shape in free_plate_modes()}
    return tuple(theory[name] for name in DRIVEN_MODES)


def random_pairs_mm(pairs: int) -> FloatArray:
    """Positions (pairs, 2, 2) within the area that fingers reach; the same every time."""
    return np.random.default_rng(7).uniform(-HALF_SIZE_MM, HALF_SIZE_MM, (pairs, 2, 2))


def leak_um_per_um(phi: FloatArray, true_phi: FloatArray) -> float:
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


def _true_shapes(points_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shapes (pairs, 2, M) and gradients (pairs, 2, M, 2)."""
    flat = points_mm.reshape(-1, 2)
    phi = np.stack([shape.evaluate(flat) for shape in driven_shapes()], axis=-1)
    slopes = np.stack([shape.gradient(flat) for shape in driven_shapes()], axis=1)
    return phi.reshape(len(points_mm), 2, -1), slopes.reshape(len(points_mm), 2, -1, 2)


def _fitted(seed: int) -> ModeShapes:
    settings = PlateSettings()
    scan = sample_cartography(driven_shapes(), settings.map_step_mm, settings.map_noise_frac, seed=seed)
    return fit_cartography(*scan, normalise=False).modes


def _timed(evaluate: Evaluate, points_mm: FloatArray, calls: int) -> tuple[Callable[[], object], int]:
    pairs = [_tuples(pair) for pair in points_mm[:calls].tolist()]

    def all_pairs() -> None:
        for pair in pairs:
            evaluate(pair)

    return all_pairs, len(pairs)


def _tuples(pair: Sequence[Sequence[float]]) -> Points:
    return [(x, y) for x, y in pair]


def _evaluated(evaluate: Evaluate, points_mm: FloatArray) -> FloatArray:
    return np.array([np.asarray(evaluate(_tuples(pair))) for pair in points_mm.tolist()], np.float64)


def _errors(
    of_maps: Sequence[Interpolator], points_mm: FloatArray, true_phi: FloatArray, true_slopes: FloatArray
) -> dict[str, float]:
    """Over all maps: leak, and RMS errors of shapes and gradients as shares of their own RMS."""
    phi = np.stack([_evaluated(one.shapes, points_mm) for one in of_maps])
    slopes = np.stack([_evaluated(one.with_gradient, points_mm)[..., 1:] for one in of_maps])
    return {
        "leak_um_per_um": leak_um_per_um(phi, true_phi),
        "shape_error_frac": _share(phi - true_phi, true_phi),
        "slope_error_frac": _share(slopes - true_slopes, true_slopes),
    }


def _share(error: FloatArray, true: FloatArray) -> float:
    return float(np.sqrt(np.mean(error**2) / np.mean(true**2)))
