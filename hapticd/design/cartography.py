"""From a vibrometer's scan to a map: noise down, lost points filled, the margin outside the scan continued.

What is known of any shape a plate makes at one frequency, whatever its edges, supports and glued parts, is that
away from them it obeys the plate equation, lap lap w = k^4 w, with one wave number k. The fit therefore weighs, per
mode, the misfit at the measured points against the mean of (lap lap w - k^4 w)^2 over the plate. Nothing is said
about the edges: a free-plate mode is not assumed. A little of the squared third derivatives is added, because waves
that decay within a millimetre of an edge obey the plate equation too and would take up noise for nothing.

k is read off the map itself (a first, plainly smoothed fit is regressed on its own Laplacian), and the weight is
the one with the least generalised cross validation: where a plate does not obey, the weight falls by itself.

Beside it stands a fit by a dozen free-plate modes (`free_fit`). It has less noise where the plate is as theory wants
it and misses the scan where it is not; the one with the smaller cross-validated error is taken, for all modes.

Source of the equation: A. W. Leissa, Vibration of Plates (NASA SP-160), ch. 1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hapticd.core.modes import ModeShapes
from hapticd.errors import ModesError

from .free_fit import FreePlateModes
from .free_plate import ModeShape
from .legendre import FloatArray
from .smoothing import PlateBasis, ScatteredData, Smoothed, plate_equation, third_derivatives

REFERENCE_SIZE_MM = (137.5, 137.5)

_MIN_LINES = 8  # per axis: fewer cannot hold a wave and its surroundings
_MIN_STEP_MM = 0.1
_MAX_DEGREE = 40  # per axis: 861 products, a second of work; enough for seven wavelengths across the plate
_SMOOTHING = 1e-3  # share of the third derivatives; from 1e-4 to 1e-2 the map's error changes by a sixth
_START_WAVE_RAD_MM = 0.1  # only sets the scale of the weights in the first fit
_MOST_THEORY_RAD = (
    66.0  # k times the longer edge, twice the reference plate's: theory's work grows with its sixth power
)
_WAVES_FROM = 0.8  # share of the plate, about its centre, where the wave number is read: clear of the edges
_FINER = 4  # the peak is looked for in steps this much smaller than the map's: 0.1 % at worst


@dataclass(frozen=True, slots=True)
class CartographyFit:
    """A fitted map and how well it holds; arrays are per mode (M,), in units of the map's own shapes.

    `residual_rms`: data minus map at the measured points. `noise_rms`: the data's noise, as the residual and the
    `freedom` (how many parameters the data really decided) imply it. `prediction_rms`: by how much the map would
    miss a fresh measurement (square root of the generalised cross validation). `map_error_rms`: the map's own share
    of it. `wavelength_mm` is of the plate wave found, one for all modes.
    """

    modes: ModeShapes
    residual_rms: FloatArray
    noise_rms: FloatArray
    prediction_rms: FloatArray
    map_error_rms: FloatArray
    freedom: FloatArray
    wavelength_mm: float


def fit_cartography(
    x_mm: npt.ArrayLike,
    y_mm: npt.ArrayLike,
    shapes: npt.ArrayLike,
    *,
    size_mm: tuple[float, float] = REFERENCE_SIZE_MM,
    step_mm: float = 1.375,
    normalise: bool = True,
) -> CartographyFit:
    """Fit measured `shapes` (M, ny, nx) on the grid `x_mm` (nx,), `y_mm` (ny,); NaN is a lost point.

    A point lost in one mode is left out in all. The map covers the whole plate of `size_mm`, edge to edge, in steps
    of at most `step_mm`. `normalise` scales every shape to a peak of 1 over the plate. That peak lies at an edge or
    a corner, where noise is averaged least, so give False where the data's own scale is known better: readings
    divided by the modal amplitude that the plate's sensors showed during the scan.
    Raises ModesError when the data does not describe mode shapes on this plate, ValueError for a step below 0.1 mm.
    """
    x, y, data = (np.asarray(part, np.float64) for part in (x_mm, y_mm, shapes))
    _require_scan(x, y, data, size_mm)
    if not _MIN_STEP_MM <= step_mm < math.inf:
        raise ValueError(f"step_mm is {step_mm}; give a map step of at least {_MIN_STEP_MM} mm.")
    basis = PlateBasis(
        (min(x.size - 1, _MAX_DEGREE), min(y.size - 1, _MAX_DEGREE)), (size_mm[0] / 2.0, size_mm[1] / 2.0)
    )
    whole = np.isfinite(data).all(axis=0)
    rows, columns = np.nonzero(whole)
    scan = ScatteredData(basis, x[columns], y[rows], data[:, whole].T)
    wave_rad_mm = _wave_number(basis, scan)
    smooth = scan.smooth(plate_equation(basis, wave_rad_mm) + _SMOOTHING * third_derivatives(basis, wave_rad_mm))
    surfaces, fit = _better(
        (basis, smooth), _free_plate_fit(size_mm, wave_rad_mm, x[columns], y[rows], data[:, whole].T)
    )

    map_x_mm, map_y_mm = _map_axis(size_mm[0], step_mm), _map_axis(size_mm[1], step_mm)
    peak = np.ones(len(data))
    if normalise:
        fine_x_mm, fine_y_mm = (_map_axis(edge_mm, step_mm / _FINER) for edge_mm in size_mm)
        peak = np.abs(surfaces.on_grid(fit.coefficients, fine_x_mm, fine_y_mm)).max(axis=(1, 2))
    return CartographyFit(
        modes=ModeShapes.from_grid(map_x_mm, map_y_mm, surfaces.on_grid(fit.coefficients / peak, map_x_mm, map_y_mm)),
        residual_rms=fit.residual_rms / peak,
        noise_rms=fit.noise_rms / peak,
        prediction_rms=fit.prediction_rms / peak,
        map_error_rms=np.sqrt(fit.prediction_rms**2 - fit.noise_rms**2) / peak,
        freedom=fit.freedom,
        wavelength_mm=2.0 * math.pi / wave_rad_mm,
    )


def sample_cartography(
    modes: Sequence[ModeShape],
    step_mm: float = 4.5,
    noise_frac: float = 0.02,
    seed: int = 1,
    missing_frac: float = 0.0,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What a vibrometer would read: `x_mm` (nx,), `y_mm` (ny,), shapes (M, ny, nx) with noise and NaN.

    The grid is centred on the plate and stays on it. Noise is normal and independent, `noise_frac` of the peak RMS.
    A point is lost with a chance of `missing_frac`, and then in all modes: it is a speck that reflects badly. The
    same seed gives the same scan.
    """
    random = np.random.default_rng(seed)
    x_mm, y_mm = (_scan_axis(edge_mm, step_mm) for edge_mm in modes[0].size_mm)
    shapes = np.stack([mode.on_grid(x_mm, y_mm) for mode in modes])
    shapes += noise_frac * random.standard_normal(shapes.shape)
    shapes[:, random.random(shapes.shape[1:]) < missing_frac] = np.nan
    return x_mm, y_mm, shapes


def _free_plate_fit(
    size_mm: tuple[float, float], wave_rad_mm: float, x_mm: FloatArray, y_mm: FloatArray, values: FloatArray
) -> tuple[FreePlateModes, Smoothed] | None:
    """None where theory has no modes for this plate, would take long, or has more than the scan can tell apart."""
    if wave_rad_mm * max(size_mm) > _MOST_THEORY_RAD:
        return None
    try:
        modes = FreePlateModes(size_mm, wave_rad_mm)
    except ValueError:
        return None
    if not 0 < len(modes) < len(values) // 4:
        return None
    return modes, modes.fit(x_mm, y_mm, values)


def _better(
    smooth: tuple[PlateBasis, Smoothed], free: tuple[FreePlateModes, Smoothed] | None
) -> tuple[PlateBasis | FreePlateModes, Smoothed]:
    """The fit that would miss a fresh measurement by less."""
    if free is None:
        return smooth
    misses = [float((fit.prediction_rms**2).sum()) for _, fit in (smooth, free)]
    return free if misses[1] < misses[0] else smooth


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
    cells = max(math.ceil(edge_mm / step_mm - 1e-9), _MIN_LINES)
    return np.linspace(-edge_mm / 2.0, edge_mm / 2.0, cells + 1)


def _scan_axis(edge_mm: float, step_mm: float) -> FloatArray:
    count = math.floor(edge_mm / 2.0 / step_mm + 1e-9)
    return np.asarray(step_mm * np.arange(-count, count + 1), np.float64)


def _require_scan(x_mm: FloatArray, y_mm: FloatArray, data: FloatArray, size_mm: tuple[float, float]) -> None:
    for axis, name, edge_mm in ((x_mm, "x_mm", size_mm[0]), (y_mm, "y_mm", size_mm[1])):
        if axis.ndim != 1 or axis.size < _MIN_LINES or not (np.diff(axis) > 0.0).all():
            raise ModesError(f"{name} is no increasing row of at least {_MIN_LINES} positions; sort or extend it.")
        if not (-edge_mm / 2.0 <= axis[0] and axis[-1] <= edge_mm / 2.0):
            raise ModesError(
                f"{name} runs from {axis[0]:g} to {axis[-1]:g} mm, off a plate of {edge_mm:g} mm; "
                "give the plate's size, or measure positions from its centre."
            )
    if data.ndim != 3 or len(data) < 1 or data.shape[1:] != (y_mm.size, x_mm.size):
        wanted = f"(modes, {y_mm.size}, {x_mm.size})"
        raise ModesError(f"the shapes are {data.shape} where the axes ask for {wanted}; order them as mode, y, x.")
    if np.isinf(data).any():
        raise ModesError("a shape is infinite somewhere; measure that point again or leave it empty.")
    if np.isfinite(data).all(axis=0).mean() < 0.5:
        raise ModesError("more than half of the points have no value in some mode; measure them again.")
    for mode, shape in enumerate(data, 1):
        if not np.nanmax(np.abs(shape)) > 0.0:
            raise ModesError(f"mode {mode} is zero everywhere; leave it out or measure it again.")
