"""From a scan to a map: which fit errs least, on scans as laboratories have them.

A figure is the map's RMS error over the whole plate as a share of the scan's noise (2 % of the peak): 1 would be a map
no better than its readings. Every scan is told as points in no order. `clean`: noise alone; `lost`: 30 % of points
missing; `turned`: by 2 degrees and shifted by 1.8 mm; `dropouts`: 3 % read something random; `held`: of a plate that is
not free; `all`: the first four together, with 20 % lost, and a complex scale for each mode, taken out before every fit.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ..design import Pose, fit_scan, sample_scan
from ..design.readings import in_phase
from .modes import NO_SCIPY, driven_shapes
from .tables import Table, finite_rows
from .timing import compare, optional

FloatArray = npt.NDArray[np.float64]
Surfaces = Callable[[FloatArray], FloatArray]  # points (N, 2) -> (N, M)
Fit = Callable[[FloatArray, FloatArray], Surfaces]  # points and real readings of a scan -> what they are of

DEFAULT = "cross-validated choice"
NOISE_FRAC = 0.02
_TURNED = Pose(math.radians(2.0), 1.5, -1.0)
_SCALE = (740.0 * cmath.exp(1.1j), 0.3 * cmath.exp(-2.5j))
SCANS: dict[str, dict[str, Any]] = {
    "clean": {},
    "lost": {"missing_frac": 0.3},
    "turned": {"pose": _TURNED},
    "dropouts": {"dropout_frac": 0.03},
    "held": {},
    "all": {"missing_frac": 0.2, "pose": _TURNED, "dropout_frac": 0.03, "scale": _SCALE},
}
_WAVE_RAD_MM = 2.0 * math.pi / 26.2
_GRID = 93  # points per axis where maps are judged


def run(*, seeds: Sequence[int] = (1, 2), repeats: int = 3, kinds: Sequence[str] = tuple(SCANS)) -> Table:
    """Compare fits on the scans of `seeds`, of all `kinds` or some."""
    half_mm = np.array(driven_shapes()[0].size_mm) / 2.0
    axes = [np.linspace(-half, half, _GRID) for half in half_mm]
    judged = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    fits, skipped = _fits()
    points, readings = sample_scan(driven_shapes(), seed=seeds[0])
    times = compare({name: (_call(fit, points, readings.real), 1000) for name, fit in fits.items()}, repeats)
    rows = []
    for name, fit in fits.items():
        figures = {f"{figure}_ms": value for figure, value in zip(("time", "time_spread"), times[name], strict=True)}
        for kind in kinds:
            errors = [_error(fit, kind, seed, judged) for seed in seeds]
            figures[f"{kind}_frac"] = math.sqrt(float(np.mean(np.square(errors)))) / NOISE_FRAC
        rows.append((name, figures))
    return Table(
        name="map-fit",
        title="map fit: error of the map over the plate, as a share of the scan's noise",
        default=DEFAULT,
        rows=finite_rows(rows),
        compared=("time_ms", "clean_frac", "all_frac"),
        time="time_ms",
        error="clean_frac",
        skipped=skipped,
        notes=("scipy's thin plate has the smoothing that suits it best on the clean scan",),
    )


def _fits() -> tuple[dict[str, Fit], dict[str, str]]:
    fits = {DEFAULT: _ours("best"), "plate equation": _ours("plate_equation"), "free-plate modes": _ours("free_plate")}
    interpolate = optional("scipy.interpolate")
    outside: dict[str, Fit] = {
        "scipy, no fit": lambda points, values: _clough_tocher(interpolate, points, values),
        "scipy, thin-plate spline": lambda points, values: _thin_plate(interpolate, points, values),
    }
    if interpolate is None:
        return fits, dict.fromkeys(outside, NO_SCIPY)
    return fits | outside, {}


def _call(fit: Fit, points: FloatArray, values: FloatArray) -> Callable[[], object]:
    return lambda: fit(points, values)


def _held(points: FloatArray) -> FloatArray:
    """What a free plate cannot do: waves that run slantwise, and something heavy beside the right edge."""
    x, y = points.T
    waves = np.cos(_WAVE_RAD_MM * (0.8 * x + 0.6 * y)), np.cos(_WAVE_RAD_MM * (0.6 * x - 0.8 * y) + 1.0)
    edge = 0.3 * np.exp(-math.hypot(_WAVE_RAD_MM, 0.1) * (68.75 - x)) * np.cos(0.1 * y)
    return np.stack([0.5 * wave + edge for wave in waves], axis=-1)


def _free(points: FloatArray) -> FloatArray:
    return np.stack([shape.evaluate(points) for shape in driven_shapes()], axis=-1)


def _error(fit: Fit, kind: str, seed: int, judged: FloatArray) -> float:
    """RMS error in units of the shapes: the scale is known, but for the sign that a phase of pi is."""
    points, readings = sample_scan(driven_shapes(), seed=seed, **SCANS[kind])
    truth = _held if kind == "held" else _free
    values = in_phase(readings).values / np.abs(SCANS[kind].get("scale", (1.0, 1.0)))
    if kind == "held":
        values += _held(points) - _free(points)
    found, true = fit(points, values)(judged), truth(judged)
    sign = np.sign((found * true).sum(axis=0))
    return float(np.sqrt(np.mean((found * sign - true) ** 2)))


def _ours(by: str) -> Fit:
    return lambda points, values: fit_scan(points, values, normalise=False, by=by).modes.evaluate


def _clough_tocher(interpolate: Any, points: FloatArray, values: FloatArray) -> Surfaces:
    inside = interpolate.CloughTocher2DInterpolator(points, values)
    outside = interpolate.NearestNDInterpolator(points, values)

    def surfaces(judged: FloatArray) -> FloatArray:
        found = inside(judged)
        return np.asarray(np.where(np.isfinite(found), found, outside(judged)), np.float64)

    return surfaces


def _thin_plate(interpolate: Any, points: FloatArray, values: FloatArray) -> Surfaces:
    spline = interpolate.RBFInterpolator(points, values, kernel="thin_plate_spline", smoothing=1.0)
    return lambda judged: np.asarray(spline(judged), np.float64)
