"""Fit of a vibrometer's scan: a denoised mode map with gaps filled, extrapolated to the plate's edges.

Any shape of a plate at one frequency obeys, away from edges, supports and glued parts, the plate equation
lap lap w = k^4 w with one wave number k. The fit minimises, per mode, the misfit at the measured points plus a weight
times the mean of (lap lap w - k^4 w)^2 over the plate. The edges are not constrained: a free plate is not assumed. A
small penalty on squared third derivatives keeps out waves that decay within a millimetre of an edge: these obey the
plate equation as well, and would fit noise.

k comes from the data: a first, smoothed fit is regressed on its own Laplacian. The weight minimises the generalised
cross validation, so it falls where a plate does not obey the equation.

The alternative is a fit by a dozen free-plate modes (`free_fit`), which also finds the rotation and shift of the scan
on the plate. It has less noise on a plate that follows theory. Where a plate does not, as glued actuators add mass and
stiffness, what the modes lack is added to it. The fit with the smaller cross-validated error is taken for
all modes. Points that it misses by far more than the noise are removed as outliers, and the rest is fitted again.

Source of the equation: A. W. Leissa, Vibration of Plates (NASA SP-160), ch. 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.errors import ModesError
from hapticd.values import FloatArray

from .free_fit import NOMINAL, FreeFit, FreePlateModes, Pose
from .readings import MIN_LINES, InPhase, Readings, in_phase, outliers, require_scan
from .smoothing import PlateBasis, ScatteredData, Smoothed, third_derivatives
from .wave_number import plate_wave, scattered, start, wave_number

REFERENCE_SIZE_MM = (137.5, 137.5)
FITS = ("best", "plate_equation", "free_plate")

_MOST_THEORY_RAD = (
    66.0  # k times the longer edge, twice the reference plate's: theory's run time grows as its 6th power
)
_STEP_MM = 1.375
_MOST_VALUES = 250_000  # of a map, as in `core.plate.mode_shapes`
_FINER = 4  # the peak is searched in steps this much smaller than the map's: 0.1 % at worst
_MORE_THAN_NOISE = 1.01
_MOST_ROUNDS = 5  # of outlier removal; two usually suffice
_LEAST_FALL = 2e-3  # of the prediction error: less is what noise gives


@dataclass(frozen=True, slots=True)
class CartographyFit:
    """A fitted map and its errors; arrays are per mode (M,), in units of the map's own shapes.

    `residual_rms`: data minus map at the measured points. `noise_rms`: the data's noise, estimated from the residual
    and the `freedom`, the number of parameters that the data determine. `prediction_rms`: the expected error at a new
    measurement (square root of the generalised cross validation). `map_error_rms`: the map's own share of it.
    `wavelength_mm`: of the plate wave, one for all modes.

    `scale` (M,) complex: a reading is the shape times this. `across_rms`: the quadrature of complex readings to the
    mode's phase; more than the noise means that more than one mode was measured. `by`: one of `FITS`. `pose`: of the
    scan on the plate, as far as free-plate modes determine it. `left_out`: the number of outliers. `free_plate_rms`:
    the residual by free-plate modes alone, where what they lack was added to them; NaN elsewhere.
    """

    modes: ModeShapes
    residual_rms: FloatArray
    noise_rms: FloatArray
    prediction_rms: FloatArray
    map_error_rms: FloatArray
    freedom: FloatArray
    wavelength_mm: float
    scale: npt.NDArray[np.complex128]
    across_rms: FloatArray
    by: str
    pose: Pose
    left_out: int
    free_plate_rms: FloatArray


def fit_scan(
    points_mm: npt.ArrayLike,
    readings: npt.ArrayLike,
    *,
    size_mm: tuple[float, float] = REFERENCE_SIZE_MM,
    normalise: bool = True,
    by: str = "best",
) -> CartographyFit:
    """Fit `readings` (N, M), real or complex, at `points_mm` (N, 2) anywhere on the plate, in any order; NaN is a lost
    one: a point lost in one mode is left out in all.

    Needs at least 64 points, three to a wavelength in either direction. The map covers the whole plate of `size_mm` in
    steps of _STEP_MM at most, longer for many modes. `normalise` scales every shape to a peak of 1. It lies at an edge
    or a corner, where noise is averaged least: give False for readings that were divided by the modal amplitude
    measured during the scan. `by` selects one of `FITS`; "best" has the smaller cross-validated error.
    Raises ModesError for data that does not describe mode shapes on this plate, ValueError for an invalid size or an
    unknown fit.
    """
    points, given = np.asarray(points_mm, np.float64), np.asarray(readings)
    data: Readings = given.astype(np.complex128) if np.iscomplexobj(given) else given.astype(np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or data.ndim != 2 or len(points) != len(data):
        raise ModesError(
            f"points and readings are {points.shape} and {data.shape}; give (N, 2) and (N, modes), a row per point."
        )
    if not all(0.0 < edge_mm < math.inf for edge_mm in size_mm):
        raise ValueError(f"size_mm is {size_mm}; give the plate's width and depth in mm.")
    lines = [round(math.sqrt(len(points) * edge / other)) for edge, other in (size_mm, size_mm[::-1])]
    if by not in FITS:
        raise ValueError(f"there is no fit by {by!r}; give one of {', '.join(FITS)}.")
    require_scan(points, data, (lines[0], lines[1]), size_mm)
    whole = np.isfinite(data).all(axis=1)
    begin = start(points[whole], data[whole], (lines[0], lines[1]), size_mm)
    kept, best = _without_outliers(*begin, points[whole], data[whole], by)
    fit = best.fit

    step_mm = _STEP_MM
    while data.shape[1] * math.prod(len(map_axis(edge_mm, step_mm)) for edge_mm in size_mm) > _MOST_VALUES:
        step_mm *= 1.05
    map_x_mm, map_y_mm = (map_axis(edge_mm, step_mm) for edge_mm in size_mm)
    peak = np.ones(data.shape[1])
    if normalise:
        fine_x_mm, fine_y_mm = (map_axis(edge_mm, _STEP_MM / _FINER) for edge_mm in size_mm)
        peak = np.abs(best.on_grid(fit.coefficients, fine_x_mm, fine_y_mm)).max(axis=(1, 2))
        if not (peak > 0.0).all():
            raise ModesError("a fitted shape is zero everywhere; spread the points over the plate.")
    shapes = best.on_grid(fit.coefficients / peak, map_x_mm, map_y_mm)
    return CartographyFit(
        modes=ModeShapes.from_grid(map_x_mm, map_y_mm, shapes),
        residual_rms=fit.residual_rms / peak,
        noise_rms=fit.noise_rms / peak,
        prediction_rms=fit.prediction_rms / peak,
        map_error_rms=np.sqrt(fit.prediction_rms**2 - fit.noise_rms**2) / peak,
        freedom=fit.freedom,
        wavelength_mm=2.0 * math.pi / best.wave_rad_mm,
        scale=peak * np.exp(1j * kept.phase_rad),
        across_rms=kept.across_rms / peak,
        by=best.by,
        pose=best.pose,
        left_out=int(whole.sum()) - len(kept.values),
        free_plate_rms=best.free_plate_rms / peak,
    )


class _Best(NamedTuple):
    """The selected fit and what it is by, its surfaces (M, ny, nx) on a grid, the wave number, the scan's pose, and the
    residual (M,) before what free-plate modes lack was added, NaN where nothing was."""

    by: str
    on_grid: Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
    fit: Smoothed
    wave_rad_mm: float
    pose: Pose
    free_plate_rms: FloatArray


def _without_outliers(
    basis: PlateBasis, known_rad_mm: float | None, points_mm: FloatArray, readings: Readings, by: str
) -> tuple[InPhase, _Best]:
    """Return the readings without outliers, and their fit."""
    for _ in range(_MOST_ROUNDS):
        aligned = in_phase(readings)
        best = _fit(basis, known_rad_mm, points_mm, aligned.values, by)
        lost = outliers(aligned.values, best.fit.residual)
        if not lost.any():
            break
        points_mm, readings = points_mm[~lost], readings[~lost]
        if len(readings) < MIN_LINES**2:
            raise ModesError("too few points agree with their neighbours; check the order of the readings.")
    return aligned, best


def _fit(basis: PlateBasis, known_rad_mm: float | None, points_mm: FloatArray, values: FloatArray, by: str) -> _Best:
    """Return the fit named `by`; "best" is the one with the smaller prediction error."""
    scan = scattered(basis, points_mm, values)
    wave_rad_mm = wave_number(basis, scan) if known_rad_mm is None else known_rad_mm
    found, noise_rms, nothing = [], None, np.full(values.shape[1], math.nan)
    if by != "free_plate":
        smooth = scan.smooth(plate_wave(basis, wave_rad_mm))
        found.append(_Best("plate_equation", basis.on_grid, smooth, wave_rad_mm, NOMINAL, nothing))
        noise_rms = smooth.noise_rms
    if by != "plate_equation" and (free := _free_plate_modes(basis, wave_rad_mm, len(values))) is not None:
        fit = free.fit(points_mm, values)
        found.append(_Best("free_plate", free.on_grid, fit.fit, wave_rad_mm, fit.pose, nothing))
        may_lack = noise_rms is None or (fit.fit.noise_rms**2).sum() > _MORE_THAN_NOISE**2 * (noise_rms**2).sum()
        if may_lack and (more := _corrected(basis, wave_rad_mm, free, fit, points_mm)) is not None:
            found.append(_Best("free_plate", *more, wave_rad_mm, fit.pose, fit.fit.residual_rms))
    if not found:
        raise ModesError("theory has no usable free-plate modes for this scan; fit it by the plate equation.")
    return min(found, key=lambda one: float((one.fit.prediction_rms**2).sum()))


def _corrected(
    basis: PlateBasis, wave_rad_mm: float, modes: FreePlateModes, found: FreeFit, points_mm: FloatArray
) -> tuple[Callable[[FloatArray, FloatArray, FloatArray], FloatArray], Smoothed] | None:
    """Return surfaces and fit with what the free-plate modes lack at `points_mm` (N, 2); None if cross validation finds
    nothing.

    Glue, patches and supports add waves that a free plate has not. The residual is smoothed by polynomials over the
    plate, with a penalty on their mean square and on third derivatives in units of the plate's own wave number: waves
    of about its length are what mass and stiffness at some places excite. Cross validation weighs it for each mode
    alone, and takes nothing where there is only noise. The correction of each mode has the parameters that its data
    determine, in addition to those of the free plate.
    """
    penalty = basis.energy((0, 0), (0, 0)) + third_derivatives(basis, wave_rad_mm)
    x_mm, y_mm = found.pose.on_plate(points_mm).T
    scan = ScatteredData(basis, x_mm, y_mm, found.fit.residual)
    try:
        lacking = scan.smooth(penalty)
    except np.linalg.LinAlgError:  # waves much longer than the polynomials resolve: rounding hides all but the penalty
        return None
    coefficients = np.concatenate((found.fit.coefficients, lacking.coefficients))
    both = Smoothed(coefficients, found.fit.freedom + lacking.freedom, lacking.residual)
    before, after = (float((one.prediction_rms**2).sum()) for one in (found.fit, both))

    def on_grid(coefficients: FloatArray, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        of_free, lacking = np.split(coefficients, [len(modes)])
        return modes.on_grid(of_free, x_mm, y_mm) + basis.on_grid(lacking, x_mm, y_mm)

    return (on_grid, both) if after < (1.0 - _LEAST_FALL) ** 2 * before else None


def _free_plate_modes(basis: PlateBasis, wave_rad_mm: float, points: int) -> FreePlateModes | None:
    """Return None if theory has no modes for this plate, takes too long, or has more modes than the scan resolves."""
    size_mm = (2.0 * basis.half_mm[0], 2.0 * basis.half_mm[1])
    if wave_rad_mm * max(size_mm) > _MOST_THEORY_RAD:
        return None
    try:
        modes = FreePlateModes(size_mm, wave_rad_mm)
    except ValueError:
        return None
    return modes if 0 < len(modes) < points // 4 else None


def compensated(driven: FloatArray, undriven: FloatArray, pushed: FloatArray) -> FloatArray:
    """Return the shapes (M, ny, nx) of driven modes, each with its share of the K others, `pushed` (K, M)."""
    return np.asarray(driven + np.tensordot(pushed.T, undriven, 1))


def map_axis(edge_mm: float, step_mm: float = _STEP_MM) -> FloatArray:
    """Return the positions of a map along an edge."""
    cells = max(math.ceil(edge_mm / step_mm - 1e-9), MIN_LINES)
    return np.linspace(-edge_mm / 2.0, edge_mm / 2.0, cells + 1)
