"""Step 6: fit of the friction curve to measured friction against amplitude.

Readings are coefficients of friction, forces or anything proportional; there may be several at each amplitude. The fit
assumes only that friction does not rise with amplitude: isotonic regression (R. E. Barlow et al., Statistical Inference
under Order Restrictions, 1972), its blocks joined by a monotone cubic (F. N. Fritsch and R. E. Carlson, SIAM J. Numer.
Anal. 17 (1980) 238). Bare glass maps to 1, the floor to 0. Readings beyond OUTLIER_SIGMA are left out and counted.

The curve ends where the floor begins: beyond it amplitude costs voltage without lowering friction.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ...errors import CalibrationError, missing_library, reason
from ...files import plotting
from ...regular_file import read_bounded
from . import simulated
from .verdict import PICTURE, Figure, Finding, Outcome, Verdict, judge

PICTURE_FILE = "friction.png"
COLUMNS = ("amplitude_um", "friction")
KNOTS = 17  # of the curve, at equally spaced frictions
MIN_LEVELS = 4  # different amplitudes: fewer show no curve
MAX_READINGS = 100_000
MAX_BYTES = 1 << 24  # of the file
BARE_UM = 0.02  # up to here the glass counts as bare
OUTLIER_SIGMA = 5.0
SIGMA_PER_MEDIAN = 1.4826  # of normal noise: standard deviation over median size
LEAST_FALL = 0.2  # of bare glass's friction: a smaller fall is hardly perceptible
FLAT_SIGMA = 2.0  # of a block's mean: a block nearer to the floor belongs to it
LARGEST = 1e9  # of a reading in any unit: its square is summed
ROUNDING = 1e-9  # of the friction: readings without noise have a floor too

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FrictionFit:
    """The curve `amplitude_um` (KNOTS,) at equally spaced frictions 1 .. 0, rising from 0; bare glass, floor and noise
    of one reading in the readings' own unit; and the readings (N,) that were left out."""

    amplitude_um: Array
    bare: float
    floor: float
    noise_rms: float
    left_out: npt.NDArray[np.bool_]


def check(options: argparse.Namespace) -> None:
    """Check the arguments. Raises CalibrationError."""
    if options.sim:
        return
    if options.readings is None:
        raise CalibrationError("No readings are given: add --readings F.csv with amplitude_um,friction, or --sim.")
    read(options.readings)


def run(options: argparse.Namespace) -> Verdict:
    """Run the step. Raises CalibrationError."""
    check(options)
    amplitude_um, friction = simulated.friction_readings(options.seed) if options.sim else read(options.readings)
    found = fit_friction(amplitude_um, friction)
    draw(amplitude_um, friction, found, options.out / PICTURE_FILE, source=simulated.source(options))
    return verdict(found, is_simulated=options.sim)


def read(path: Path) -> tuple[Array, Array]:
    """Read amplitudes and frictions (N,) of a CSV file with the header COLUMNS. Raises CalibrationError."""
    try:
        lines = read_bounded(path, MAX_BYTES).decode("utf-8-sig").splitlines()
        rows = csv.reader(line for line in lines if line.strip() and not line.startswith("#"))
        if [cell.strip() for cell in next(rows, [])] != [*COLUMNS]:
            raise CalibrationError(f"{path}: does not begin with the header {','.join(COLUMNS)}: add it.")
        table = [_row(path, place, row) for place, row in enumerate(rows, 1)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise CalibrationError(f"{path}: cannot be read ({reason(error)}): save the readings as CSV.") from None
    if not table:
        raise CalibrationError(f"{path}: holds no readings: add a line for each.")
    amplitude_um, friction = np.array(table).T
    return amplitude_um, friction


def _row(path: Path, place: int, cells: Sequence[str]) -> tuple[float, float]:
    if place > MAX_READINGS:
        raise CalibrationError(f"{path}: has more than {MAX_READINGS} readings: average them first.")
    try:
        amplitude_um, friction = map(float, cells)
    except ValueError:
        raise CalibrationError(f"{path}: reading {place} is not two numbers: correct or delete it.") from None
    return amplitude_um, friction


def fit_friction(amplitude_um: npt.ArrayLike, friction: npt.ArrayLike) -> FrictionFit:
    """Fit a falling curve to readings (N,), (N,) in any order.

    Raises CalibrationError for readings that are not finite, absurdly large, too few or of the wrong sign, and for
    readings without bare glass or without a fall.
    """
    amplitude, value = np.asarray(amplitude_um, np.float64), np.asarray(friction, np.float64)
    if amplitude.shape != value.shape or amplitude.ndim != 1:
        raise CalibrationError("There must be one friction for each amplitude.")
    if not ((amplitude >= 0.0) & (amplitude <= LARGEST) & (np.abs(value) <= LARGEST)).all():  # NaN fails this, too
        raise CalibrationError("An amplitude is negative, or a reading is no finite number: correct or delete it.")
    if len(np.unique(amplitude)) < MIN_LEVELS or not amplitude.min() <= BARE_UM:
        raise CalibrationError(f"Measure bare glass (0 um) and at least {MIN_LEVELS - 1} amplitudes above it.")
    left_out = _left_out(amplitude, value)
    kept, heights = amplitude[~left_out], value[~left_out]
    levels, falling, weights = _falling(kept, heights)
    if not falling[0] > 0.0:
        raise CalibrationError("Bare glass has no friction above 0: check the readings' sign.")
    noise = float(np.sqrt(np.mean((heights - falling[np.searchsorted(levels, kept)]) ** 2)))
    curve_um = _inverted(*_blocks(levels, falling, weights, noise))
    return FrictionFit(curve_um, float(falling[0]), float(falling[-1]), noise, left_out)


def _left_out(amplitude: Array, value: Array) -> npt.NDArray[np.bool_]:
    """Mark readings far off a curve through the medians of each amplitude."""
    levels = np.unique(amplitude)
    medians = np.array([np.median(value[amplitude == level]) for level in levels])
    curve = _isotonic(medians, np.ones(len(levels)))
    miss = np.abs(value - curve[np.searchsorted(levels, amplitude)])
    sigma = SIGMA_PER_MEDIAN * float(np.median(miss))
    return np.asarray(miss > max(OUTLIER_SIGMA * sigma, 1e-9 * float(np.abs(value).max())), np.bool_)


def _falling(amplitude: Array, value: Array) -> tuple[Array, Array, Array]:
    """Return the distinct amplitudes (L,), the isotonic fit there (L,), and the number of readings of each (L,)."""
    levels, where = np.unique(amplitude, return_inverse=True)
    weights = np.bincount(where).astype(np.float64)
    return levels, _isotonic(np.bincount(where, value) / weights, weights), weights


def _isotonic(value: Array, weights: Array) -> Array:
    try:
        from scipy.optimize import isotonic_regression
    except ImportError:
        raise missing_library("A friction curve needs scipy 1.12", "design") from None
    return np.asarray(isotonic_regression(value, weights=weights, increasing=False).x, np.float64)


def _blocks(levels: Array, falling: Array, weights: Array, noise: float) -> tuple[Array, Array]:
    """Return the curve's knots: each block at its mean amplitude, bare glass at 0, the floor at its first amplitude."""
    starts = np.concatenate(([0], np.flatnonzero(np.diff(falling) < 0.0) + 1))
    counts = np.add.reduceat(weights, starts)
    at_um, height = np.add.reduceat(levels * weights, starts) / counts, falling[starts]
    flat = FLAT_SIGMA * noise * np.sqrt(1.0 / counts + 1.0 / counts[-1]) + ROUNDING * abs(height[0])
    is_floor = height - height[-1] <= flat
    first = int(np.argmax(is_floor))  # the last block always is
    if first == 0 or height[0] - height[-1] < LEAST_FALL * abs(height[0]):
        raise CalibrationError("Friction hardly falls with amplitude: measure again, with more amplitude.")
    at_um[0] = 0.0
    at_um[first] = levels[starts[first]]
    return at_um[: first + 1], np.append(height[:first], height[-1])


def _inverted(at_um: Array, height: Array) -> Array:
    """Return the amplitude at KNOTS equally spaced frictions 1 .. 0, by bisection: the cubic falls strictly."""
    from scipy.interpolate import PchipInterpolator

    curve = PchipInterpolator(at_um, (height - height[-1]) / (height[0] - height[-1]))
    target = np.linspace(1.0, 0.0, KNOTS)[1:-1]
    low, high = np.zeros(len(target)), np.full(len(target), at_um[-1])
    for _ in range(60):
        middle = (low + high) / 2.0
        is_above = curve(middle) > target
        low, high = np.where(is_above, middle, low), np.where(is_above, high, middle)
    return np.concatenate(([0.0], (low + high) / 2.0, at_um[-1:]))


def verdict(found: FrictionFit, *, is_simulated: bool) -> Verdict:
    """Judge the curve and its uncertainty."""
    fall = found.bare - found.floor
    noise_frac = found.noise_rms / fall
    figures = (
        Figure("friction of bare glass", found.bare, ""),
        Figure("friction at the floor", found.floor, ""),
        Figure("floor from", float(found.amplitude_um[-1]), "um"),
        Figure("half of the fall at", float(found.amplitude_um[KNOTS // 2]), "um"),
        Figure("noise of a reading", 100.0 * noise_frac, "% of the fall"),
        Figure("readings", float(len(found.left_out)), ""),
        Figure("readings left out", float(found.left_out.sum()), ""),
    )
    findings: list[Finding] = []
    if noise_frac > 0.15:
        findings.append((Outcome.WARN, "Readings scatter widely: take more, from more than one finger."))
    if found.left_out.mean() > 0.1:
        findings.append((Outcome.WARN, "More than a tenth of the readings are outliers: check them."))
    sentence = f"Friction falls to {100.0 * found.floor / found.bare:.0f} % at {found.amplitude_um[-1]:.2f} um."
    outcome, sentence = judge(findings, sentence)
    curve_um = [round(um, 5) for um in found.amplitude_um.tolist()]
    return Verdict("friction", outcome, sentence, figures, {"plate": {"friction_curve": curve_um}}, is_simulated)


def draw(amplitude_um: Array, friction: Array, found: FrictionFit, path: Path, *, source: str = "") -> None:
    """Draw readings, outliers and the curve. Raises HapticdError."""
    figure, axes = plotting.subplots(6.0, 4.0, source=source)
    left_out = found.left_out
    (plot,) = axes[0]
    plot.plot(amplitude_um[~left_out], friction[~left_out], ".", label="readings")
    if left_out.any():
        plot.plot(amplitude_um[left_out], friction[left_out], "x", label="left out")
    height = found.floor + (found.bare - found.floor) * np.linspace(1.0, 0.0, KNOTS)
    farthest_um = max(float(amplitude_um.max()), float(found.amplitude_um[-1]))
    plot.plot([*found.amplitude_um, farthest_um], [*height, found.floor], "-o", markersize=3, label="curve")
    plot.set(xlabel="amplitude, um peak to peak", ylabel="friction, as measured", ylim=(0.0, None))
    plot.legend()
    plotting.save(figure, path, **PICTURE)
