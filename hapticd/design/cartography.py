"""From a vibrometer's scan to a map: noise down, lost points filled, the margin outside the scan continued.

What is known of any shape a plate makes at one frequency, whatever its edges, supports and glued parts, is that
away from them it obeys the plate equation, lap lap w = k^4 w, with one wave number k. The fit therefore weighs, per
mode, the misfit at the measured points against the mean of (lap lap w - k^4 w)^2 over the plate. Nothing is said
about the edges: a free-plate mode is not assumed. A little of the squared third derivatives is added, because waves
that decay within a millimetre of an edge obey the plate equation too and would take up noise for nothing.

k is read off the map itself (a first, plainly smoothed fit is regressed on its own Laplacian), and the weight is
the one with the least generalised cross validation: where a plate does not obey, the weight falls by itself.

Beside it stands a fit by a dozen free-plate modes (`free_fit`), which also finds how the scan is turned and shifted on
the plate. It has less noise where the plate is as theory wants it and misses the scan where it is not; the one with the
smaller cross-validated error is taken, for all modes. Points that it misses by far more than the noise are no readings
of the plate: they are left out, and the rest is fitted again.

Source of the equation: A. W. Leissa, Vibration of Plates (NASA SP-160), ch. 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.errors import ModesError

from .checks import MIN_LINES, require_grid, require_scan, require_size, require_step
from .free_fit import FreeFit, FreePlateModes
from .legendre import FloatArray
from .pose import AS_TOLD, Pose
from .readings import InPhase, Readings, in_phase, numbers, outliers
from .smoothing import PlateBasis, ScatteredData, Smoothed, plate_equation, third_derivatives

REFERENCE_SIZE_MM = (137.5, 137.5)
FITS = ("best", "plate_equation", "free_plate")

_MAX_DEGREE = 40  # per axis: 861 products, a second of work; enough for seven wavelengths across the plate
_SMOOTHING = 1e-3  # share of the third derivatives; from 1e-4 to 1e-2 the map's error changes by a sixth
_START_WAVE_RAD_MM = 0.1  # only sets the scale of the weights in the first fit
_MOST_THEORY_RAD = (
    66.0  # k times the longer edge, twice the reference plate's: theory's work grows with its sixth power
)
_WAVES_FROM = 0.8  # share of the plate, about its centre, where the wave number is read: clear of the edges
_FINER = 4  # the peak is looked for in steps this much smaller than the map's: 0.1 % at worst
_MOST_ROUNDS = 5  # of leaving out points; after the second one none is left to find, usually


@dataclass(frozen=True, slots=True)
class CartographyFit:
    """A fitted map and how well it holds; arrays are per mode (M,), in units of the map's own shapes.

    `residual_rms`: data minus map at the measured points. `noise_rms`: the data's noise, as the residual and the
    `freedom` (how many parameters the data really decided) imply it. `prediction_rms`: by how much the map would
    miss a fresh measurement (square root of the generalised cross validation). `map_error_rms`: the map's own share
    of it. `wavelength_mm` is of the plate wave found, one for all modes.

    `scale` (M,) complex: a reading is the shape times this. `across_rms`: what of complex readings was out of the
    mode's phase; more than the noise means that not one mode alone was measured. `by`: which of `FITS` it is.
    `pose`: how the scan lies on the plate, where free-plate modes could tell. `left_out`: how many points were no
    readings of the plate.
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


def fit_cartography(
    x_mm: npt.ArrayLike,
    y_mm: npt.ArrayLike,
    shapes: npt.ArrayLike,
    *,
    size_mm: tuple[float, float] = REFERENCE_SIZE_MM,
    step_mm: float = 1.375,
    normalise: bool = True,
    by: str = "best",
) -> CartographyFit:
    """Fit measured `shapes` (M, ny, nx), real or complex, on the grid `x_mm` (nx,), `y_mm` (ny,); NaN is a lost point.

    A point lost in one mode is left out in all. The map covers the whole plate of `size_mm`, edge to edge, in steps
    of at most `step_mm`. `normalise` scales every shape to a peak of 1 over the plate. That peak lies at an edge or
    a corner, where noise is averaged least, so give False where the data's own scale is known better: readings
    divided by the modal amplitude that the plate's sensors showed during the scan. `by`, of `FITS`, names a fit to take
    whether or not it is the best.
    Raises ModesError when the data does not describe mode shapes on this plate, ValueError for a step below 0.1 mm,
    a size that is none or an unknown fit.
    """
    x, y = np.asarray(x_mm, np.float64), np.asarray(y_mm, np.float64)
    data = numbers(shapes)
    require_size(size_mm)
    require_grid(x, y, data)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return _fitted(points, data.reshape(len(data), -1).T, (x.size, y.size), size_mm, step_mm, normalise, by)


def fit_scan(
    points_mm: npt.ArrayLike,
    readings: npt.ArrayLike,
    *,
    size_mm: tuple[float, float] = REFERENCE_SIZE_MM,
    step_mm: float = 1.375,
    normalise: bool = True,
    by: str = "best",
) -> CartographyFit:
    """The same for `readings` (N, M), real or complex, at `points_mm` (N, 2) anywhere on the plate, in any order.

    At least 64 points, some four to a wavelength in either direction; the rest as in `fit_cartography`.
    """
    points, data = np.asarray(points_mm, np.float64), numbers(readings)
    if points.ndim != 2 or points.shape[1] != 2 or data.ndim != 2 or len(points) != len(data):
        raise ModesError(
            f"points and readings are {points.shape} and {data.shape}; give (N, 2) and (N, modes), a row per point."
        )
    require_size(size_mm)
    lines = [round(math.sqrt(len(points) * edge / other)) for edge, other in (size_mm, size_mm[::-1])]
    return _fitted(points, data, (lines[0], lines[1]), size_mm, step_mm, normalise, by)


def _fitted(
    points_mm: FloatArray,
    readings: Readings,
    lines: tuple[int, int],
    size_mm: tuple[float, float],
    step_mm: float,
    normalise: bool,
    by: str,
) -> CartographyFit:
    if by not in FITS:
        raise ValueError(f"there is no fit by {by!r}; it is one of {', '.join(FITS)}.")
    require_scan(points_mm, readings, lines, size_mm)
    require_step(step_mm)
    basis = PlateBasis(
        (min(lines[0] - 1, _MAX_DEGREE), min(lines[1] - 1, _MAX_DEGREE)), (size_mm[0] / 2.0, size_mm[1] / 2.0)
    )
    whole = np.isfinite(readings).all(axis=1)
    told, best = _without_outliers(basis, points_mm[whole], readings[whole], by)
    fit = best.fit

    map_x_mm, map_y_mm = _map_axis(size_mm[0], step_mm), _map_axis(size_mm[1], step_mm)
    peak = np.ones(readings.shape[1])
    if normalise:
        fine_x_mm, fine_y_mm = (_map_axis(edge_mm, step_mm / _FINER) for edge_mm in size_mm)
        peak = np.abs(best.surfaces.on_grid(fit.coefficients, fine_x_mm, fine_y_mm)).max(axis=(1, 2))
        if not (peak > 0.0).all():
            raise ModesError("a map is flat; spread the points over the plate.")
    shapes = best.surfaces.on_grid(fit.coefficients / peak, map_x_mm, map_y_mm)
    return CartographyFit(
        modes=ModeShapes.from_grid(map_x_mm, map_y_mm, shapes),
        residual_rms=fit.residual_rms / peak,
        noise_rms=fit.noise_rms / peak,
        prediction_rms=fit.prediction_rms / peak,
        map_error_rms=np.sqrt(fit.prediction_rms**2 - fit.noise_rms**2) / peak,
        freedom=fit.freedom,
        wavelength_mm=2.0 * math.pi / best.wave_rad_mm,
        scale=peak * np.exp(1j * told.phase_rad),
        across_rms=told.across_rms / peak,
        by="plate_equation" if isinstance(best.surfaces, PlateBasis) else "free_plate",
        pose=best.pose,
        left_out=int(whole.sum()) - len(told.values),
    )


class _Best(NamedTuple):
    """The fit taken, what its coefficients are of, the wave number, and how the scan lies."""

    surfaces: PlateBasis | FreePlateModes
    fit: Smoothed
    wave_rad_mm: float
    pose: Pose


def _without_outliers(basis: PlateBasis, points_mm: FloatArray, readings: Readings, by: str) -> tuple[InPhase, _Best]:
    """The readings that are the plate's, and their fit."""
    for _ in range(_MOST_ROUNDS):
        told = in_phase(readings)
        best = _fit(basis, points_mm, told.values, by)
        lost = outliers(told.values, best.fit.residual)
        if not lost.any():
            break
        points_mm, readings = points_mm[~lost], readings[~lost]
        if len(readings) < MIN_LINES**2:
            raise ModesError("hardly a point agrees with its neighbours; check the order of the readings.")
    return told, best


def _fit(basis: PlateBasis, points_mm: FloatArray, values: FloatArray, by: str) -> _Best:
    """The fit that is asked for; "best" is the one that would miss a fresh measurement by less."""
    on_plate = np.clip(points_mm, -np.array(basis.half_mm), basis.half_mm)
    scan = ScatteredData(basis, on_plate[:, 0], on_plate[:, 1], values)
    wave_rad_mm = _wave_number(basis, scan)
    found = []
    if by != "free_plate":
        smooth = scan.smooth(plate_equation(basis, wave_rad_mm) + _SMOOTHING * third_derivatives(basis, wave_rad_mm))
        found.append(_Best(basis, smooth, wave_rad_mm, AS_TOLD))
    if by != "plate_equation" and (free := _free_plate_fit(basis, wave_rad_mm, points_mm, values)) is not None:
        modes, (fit, pose) = free
        found.append(_Best(modes, fit, wave_rad_mm, pose))
    if not found:
        raise ModesError("theory has no free-plate modes for this scan; fit it by the plate equation.")
    return min(found, key=lambda one: float((one.fit.prediction_rms**2).sum()))


def _free_plate_fit(
    basis: PlateBasis, wave_rad_mm: float, points_mm: FloatArray, values: FloatArray
) -> tuple[FreePlateModes, FreeFit] | None:
    """None where theory has no modes for this plate, would take long, or has more than the scan can tell apart."""
    size_mm = (2.0 * basis.half_mm[0], 2.0 * basis.half_mm[1])
    if wave_rad_mm * max(size_mm) > _MOST_THEORY_RAD:
        return None
    try:
        modes = FreePlateModes(size_mm, wave_rad_mm)
    except ValueError:
        return None
    if not 0 < len(modes) < len(values) // 4:
        return None
    return modes, modes.fit(points_mm, values)


def _wave_number(basis: PlateBasis, scan: ScatteredData) -> float:
    """k in rad/mm with lap w = -k^2 w, by regression over a plainly smoothed fit of all modes."""
    surfaces = scan.smooth(third_derivatives(basis, _START_WAVE_RAD_MM)).coefficients
    x_mm, y_mm = (half_mm * np.linspace(-_WAVES_FROM, _WAVES_FROM, 41) for half_mm in basis.half_mm)
    shape = basis.on_grid(surfaces, x_mm, y_mm)
    laplacian = basis.on_grid(surfaces, x_mm, y_mm, (2, 0)) + basis.on_grid(surfaces, x_mm, y_mm, (0, 2))
    square = -float(np.vdot(shape, laplacian)) / float(np.vdot(shape, shape))
    if not 0.0 < square < math.inf:
        raise ModesError("the map holds no plate wave; check its units, or measure the modes again.")
    return math.sqrt(square)


def _map_axis(edge_mm: float, step_mm: float) -> FloatArray:
    cells = max(math.ceil(edge_mm / step_mm - 1e-9), MIN_LINES)
    return np.linspace(-edge_mm / 2.0, edge_mm / 2.0, cells + 1)
