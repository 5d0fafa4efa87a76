"""The mode matrix at two fingers: how an interpolator's error leaks, and what it costs.

The measure is what the whole path would leak if all else were perfect: two random positions, one finger at 1 um and
one still, the modes solved from the map, and the plate's true shapes under the still finger. Each interpolator reads
the raw scan (4.5 mm, 2 % of noise), the map fitted to it (1.4 mm), and, for its own share of the error, a map of the
same step without noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from ..core.plate.mode_shapes import ModeShapes
from ..core.solver.public import solve_fast
from ..design import ModeShape, fit_cartography, free_plate_modes, sample_cartography
from ..design.free_fit import FreePlateModes
from ..sim.plate.ground_truth import DRIVEN_MODES, PlateSettings
from .modes_ways import Points, Shapes, Way, analytic, ways
from .tables import Table, finite_rows
from .timing import REPEATS, compare, optional

FloatArray = npt.NDArray[np.float64]

NO_SCIPY = "scipy is not installed"
W_LIMIT_UM = (4.0, 4.0)
HALF_SIZE_MM = 58.0  # where fingers are
DEFAULT = "bicubic at, fitted map"
_FITTED, _RAW = "fitted map", "raw scan"


def run(*, pairs: int = 2000, seeds: Sequence[int] = (1, 2, 3), repeats: int = REPEATS, calls: int = 400) -> Table:
    """Compare interpolators on `pairs` random finger pairs over the scans of `seeds`."""
    points_mm = random_pairs_mm(pairs)
    flat = points_mm.reshape(-1, 2)
    true_phi = np.stack([shape.evaluate(flat) for shape in driven_shapes()], axis=-1).reshape(pairs, 2, -1)
    slopes = np.stack([shape.gradient(flat) for shape in driven_shapes()], axis=1).reshape(pairs, 2, -1, 2)
    found, exact = _alternatives(seeds)
    timed = {name: _timed(of_scans[0].shapes, points_mm, calls) for name, of_scans in found.items()}
    timed |= {
        f"{name} and gradient": _timed(of_scans[0].with_gradient, points_mm, calls)
        for name, of_scans in found.items()
        if of_scans[0].with_gradient is not None
    }
    times = compare(timed, repeats)
    rows = []
    for name, of_scans in found.items():
        figures = {**times[name].figures(), **_errors(of_scans, points_mm, true_phi, slopes)}
        if (both := times.get(f"{name} and gradient")) is not None:
            figures |= both.figures("gradient_time")
        figures["interpolation_um_per_um"] = leak_um_per_um(_evaluate(exact[name].shapes, points_mm)[None], true_phi)
        rows.append((name, figures))
    return Table(
        name="modes",
        title="modes: the mode matrix of 2 fingers and 2 modes; um leaked at the still finger per um at the other",
        default=DEFAULT,
        rows=finite_rows(rows),
        compared=("time_us", "gradient_time_us", "leak_um_per_um"),
        time="time_us",
        error="leak_um_per_um",
        skipped={} if optional("scipy.interpolate") else dict.fromkeys(("RectBivariateSpline", "quintic"), NO_SCIPY),
        notes=("gradient time: shapes and gradients together; interpolation: the leak of a map without noise",),
    )


@lru_cache(maxsize=1)
def driven_shapes() -> tuple[ModeShape, ...]:
    """The theory's X and Y, the truth of this bench."""
    theory = {shape.name: shape for _, shape in free_plate_modes()}
    return tuple(theory[name] for name in DRIVEN_MODES)


def random_pairs_mm(pairs: int, least_apart_mm: float = 0.0) -> FloatArray:
    """Positions (pairs, 2, 2) where fingers are, at least so far from each other; the same every time."""
    random = np.random.default_rng(7)
    kept = np.empty((0, 2, 2))
    while len(kept) < pairs:
        drawn = random.uniform(-HALF_SIZE_MM, HALF_SIZE_MM, (pairs, 2, 2))
        apart_mm = np.hypot(*(drawn[:, 0] - drawn[:, 1]).T)
        kept = np.concatenate((kept, drawn[apart_mm >= least_apart_mm]))
    return kept[:pairs]


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


def _alternatives(seeds: Sequence[int]) -> tuple[dict[str, list[Way]], dict[str, Way]]:
    """Every way on every source: by name one for each scan, and one that reads the truth."""
    interpolate = optional("scipy.interpolate")
    settings = PlateSettings()
    scans = [
        sample_cartography(driven_shapes(), settings.map_step_mm, settings.map_noise_frac, seed=seed) for seed in seeds
    ]
    raw = [ModeShapes.from_grid(*scan) for scan in scans]
    fits = [fit_cartography(*scan, normalise=False) for scan in scans]
    found: dict[str, list[Way]] = {}
    exact: dict[str, Way] = {}
    for source, maps in ((_FITTED, [fit.modes for fit in fits]), (_RAW, raw)):
        x_mm, y_mm = maps[0].x_mm, maps[0].y_mm
        true_map = ModeShapes.from_grid(x_mm, y_mm, np.stack([shape.on_grid(x_mm, y_mm) for shape in driven_shapes()]))
        exact |= {f"{name}, {source}": way for name, way in ways(true_map, interpolate).items()}
        for modes in maps:
            for name, way in ways(modes, interpolate).items():
                found.setdefault(f"{name}, {source}", []).append(way)
    half_mm = (driven_shapes()[0].size_mm[0] / 2.0, driven_shapes()[0].size_mm[1] / 2.0)
    found["analytic basis"] = [
        analytic(_free_coefficients(scan, fit.wavelength_mm), half_mm) for scan, fit in zip(scans, fits, strict=True)
    ]
    exact["analytic basis"] = analytic([shape.coefficients for shape in driven_shapes()], half_mm)
    return found, exact


def _free_coefficients(scan: tuple[FloatArray, FloatArray, FloatArray], wavelength_mm: float) -> list[FloatArray]:
    """Of X and Y as sums of free-plate modes, each one table of Legendre products."""
    x_mm, y_mm, shapes = scan
    basis = FreePlateModes(driven_shapes()[0].size_mm, 2.0 * math.pi / wavelength_mm)
    points = np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)
    coefficients = basis.fit(points, shapes.reshape(len(shapes), -1).T).fit.coefficients
    return list(np.tensordot(coefficients.T, basis.tables(), axes=1))


def _timed(way: Shapes, points_mm: FloatArray, calls: int) -> tuple[Callable[[], object], int]:
    pairs = [_tuples(pair) for pair in points_mm[:calls].tolist()]

    def all_pairs() -> None:
        for pair in pairs:
            way(pair)

    return all_pairs, len(pairs)


def _tuples(pair: Sequence[Sequence[float]]) -> Points:
    return [(x, y) for x, y in pair]


def _evaluate(way: Shapes, points_mm: FloatArray) -> FloatArray:
    return np.array([np.asarray(way(_tuples(pair))) for pair in points_mm.tolist()], np.float64)


def _errors(
    of_scans: Sequence[Way], points_mm: FloatArray, true_phi: FloatArray, true_slopes: FloatArray
) -> dict[str, float]:
    """Over all scans: leak, and RMS errors of shapes and gradients as shares of their own RMS."""
    phi = np.stack([_evaluate(way.shapes, points_mm) for way in of_scans])
    errors = {"leak_um_per_um": leak_um_per_um(phi, true_phi), "shape_error_frac": _share(phi - true_phi, true_phi)}
    with_gradient = [way.with_gradient for way in of_scans if way.with_gradient is not None]
    if with_gradient:
        slopes = np.stack([_evaluate(way, points_mm)[..., 1:] for way in with_gradient])
        errors["slope_error_frac"] = _share(slopes - true_slopes, true_slopes)
    return errors


def _share(error: FloatArray, true: FloatArray) -> float:
    return float(np.sqrt(np.mean(error**2) / np.mean(true**2)))
