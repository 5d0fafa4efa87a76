"""The wave number of a scan, and the basis that holds its waves.

A dense scan shows its wave number by itself: a smoothed fit is regressed on its own Laplacian. A coarse one has fewer
lines than a basis for its waves has degrees. There the wave number is the one whose plane waves predict the scan best,
by generalised cross validation, up to the shortest wave that the points could sample.
"""

from __future__ import annotations

import math

import numpy as np

from hapticd.errors import ModesError
from hapticd.values import FloatArray

from .readings import Readings, in_phase
from .smoothing import PlateBasis, ScatteredData, plate_equation, third_derivatives

_MAX_DEGREE = 40  # per axis: 861 products, a second of work; enough for seven wavelengths across the plate
_SMOOTHING = 1e-3  # share of the third derivatives; from 1e-4 to 1e-2 the map's error changes by a sixth
_START_WAVE_RAD_MM = 0.1  # only sets the scale of the weights in the first fit
_WAVES_FROM = 0.8  # central share of the plate over which the wave number is estimated: clear of the edges
_SPARE_DEGREES = 8.0  # of a basis beyond k times half an edge: the Legendre series of a wave then falls to 1e-3
_DENSE_LINES = 30  # so many show any wave by themselves
_LEAST_POINTS = 2.75  # per wave, for a map to within some percent; 3 is asked for
_FEWEST_POINTS = 2.1  # per wave, to say how long it is
_NO_WAVE_FRAC = 0.7  # share of the data's RMS: a worse prediction is none
_APART_RAD = 0.25 * math.pi  # over the longer edge: steps of the search
_SPARE_DIRECTIONS = 2
_LEAST_SHARE = 1e-6  # of the largest singular value: smaller ones are no direction of their own


def start(
    points_mm: FloatArray, readings: Readings, lines: tuple[int, int], size_mm: tuple[float, float]
) -> tuple[PlateBasis, float | None]:
    """Return the basis of the fit, and the wave number of a coarse scan; None where the fit shows it by itself. Raises
    ModesError if the scan shows no wave, or does not sample it."""
    half_mm = size_mm[0] / 2.0, size_mm[1] / 2.0
    basis = PlateBasis((min(lines[0] - 1, _MAX_DEGREE), min(lines[1] - 1, _MAX_DEGREE)), half_mm)
    if min(lines) >= _DENSE_LINES:
        return basis, None
    wave_rad_mm = _searched(points_mm, in_phase(readings).values, size_mm)
    degrees = [] if wave_rad_mm is None else [math.ceil(wave_rad_mm * half + _SPARE_DEGREES) for half in half_mm]
    if wave_rad_mm is None or (degrees[0] <= basis.degrees[0] and degrees[1] <= basis.degrees[1]):
        return basis, None
    return PlateBasis((min(degrees[0], _MAX_DEGREE), min(degrees[1], _MAX_DEGREE)), half_mm), wave_rad_mm


def scattered(basis: PlateBasis, points_mm: FloatArray, values: FloatArray) -> ScatteredData:
    """Return values (N, M) at points (N, 2), which are clamped to the plate, for fits in a basis."""
    on_plate = np.clip(points_mm, -np.array(basis.half_mm), basis.half_mm)
    return ScatteredData(basis, on_plate[:, 0], on_plate[:, 1], values)


def plate_wave(basis: PlateBasis, wave_rad_mm: float) -> FloatArray:
    """Return the penalty on what is no plate wave of this number."""
    return plate_equation(basis, wave_rad_mm) + _SMOOTHING * third_derivatives(basis, wave_rad_mm)


def wave_number(basis: PlateBasis, scan: ScatteredData) -> float:
    """Return k in rad/mm with lap w = -k^2 w, by regression over a smoothed fit of all modes. Raises ModesError."""
    surfaces = scan.smooth(third_derivatives(basis, _START_WAVE_RAD_MM)).coefficients
    x_mm, y_mm = (half_mm * np.linspace(-_WAVES_FROM, _WAVES_FROM, 41) for half_mm in basis.half_mm)
    shape = basis.on_grid(surfaces, x_mm, y_mm)
    laplacian = basis.on_grid(surfaces, x_mm, y_mm, (2, 0)) + basis.on_grid(surfaces, x_mm, y_mm, (0, 2))
    square = -float(np.vdot(shape, laplacian)) / float(np.vdot(shape, shape))
    if not 0.0 < square < math.inf:
        raise ModesError("the scan shows no plate wave; check its units, or measure the modes again.")
    return math.sqrt(square)


def _searched(points_mm: FloatArray, values: FloatArray, size_mm: tuple[float, float]) -> float | None:
    """Return the wave number whose plane waves predict the scan best; None where none does.

    Raises ModesError if the points do not sample the wave.
    """
    half_mm = size_mm[0] / 2.0, size_mm[1] / 2.0
    apart_mm = math.sqrt(size_mm[0] * size_mm[1] / len(points_mm))
    shortest_rad_mm = min(2.0 * math.pi / (_FEWEST_POINTS * apart_mm), (_MAX_DEGREE - _SPARE_DEGREES) / max(half_mm))
    waves_rad_mm = np.arange(2.0 * math.pi / max(size_mm), shortest_rad_mm, _APART_RAD / max(size_mm))
    errors = [_prediction_square(points_mm, values, float(wave), math.hypot(*half_mm)) for wave in waves_rad_mm]
    best = int(np.argmin(errors))
    if errors[best] > _NO_WAVE_FRAC**2 * float((values**2).mean(axis=0).sum()):
        return None
    wave_rad_mm = float(waves_rad_mm[best])
    if 0 < best < len(errors) - 1:  # the lowest point of the parabola through it and its neighbours
        before, least, after = errors[best - 1 : best + 2]
        shift = 0.5 * (before - after) / (before - 2.0 * least + after)
        wave_rad_mm += float(shift * (waves_rad_mm[1] - waves_rad_mm[0]))
    wave_mm = 2.0 * math.pi / wave_rad_mm
    if wave_mm < _LEAST_POINTS * apart_mm:
        raise ModesError(
            f"the points are about {apart_mm:.1f} mm apart, too far for a wave of {wave_mm:.0f} mm; "
            f"measure at most {wave_mm / 3.0:.1f} mm apart."
        )
    return wave_rad_mm


def _prediction_square(points_mm: FloatArray, values: FloatArray, wave_rad_mm: float, reach_mm: float) -> float:
    """Return the mean square of the error at new points, summed over the modes, of a sum of plane waves.

    So many directions hold any such wave field within `reach_mm`. Waves that decay from the edges are left out.
    """
    turn_rad = np.linspace(0.0, math.pi, math.ceil(wave_rad_mm * reach_mm) + _SPARE_DIRECTIONS, endpoint=False)
    phase_rad = wave_rad_mm * points_mm @ np.stack((np.cos(turn_rad), np.sin(turn_rad)))
    design = np.hstack((np.cos(phase_rad), np.sin(phase_rad)))
    found, _, rank, _ = np.linalg.lstsq(design, values, rcond=_LEAST_SHARE)
    spare_frac = max(1.0 - rank / len(values), 1.0 / len(values))
    return float(((values - design @ found) ** 2).mean(axis=0).sum() / spare_frac**2)
