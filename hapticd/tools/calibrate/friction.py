"""Fit of the friction curve to measured friction against amplitude.

The fit assumes only that friction does not rise with amplitude: isotonic regression (R. E. Barlow et al., Statistical
Inference under Order Restrictions, 1972), its blocks joined by a monotone cubic (F. N. Fritsch and R. E. Carlson, SIAM
J. Numer. Anal. 17 (1980) 238). Bare glass maps to 1, the floor, where the curve ends, to 0. Where the readings have
speeds, their effect is fitted first (`friction_speed`), and the curve is that of a finger at rest.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ...errors import CalibrationError, reason
from ...regular_file import csv_rows, read_lines
from ...values import FloatArray
from .. import plotting
from . import simulated
from .friction_speed import BARE_UM, SpeedFit, fit_speed
from .step import PICTURE, Figure, Finding, MissingInput, Outcome, Step, Verdict, add_participant, judge

COLUMNS = ("amplitude_um", "friction")
SPEED_COLUMN = "speed_mm_s"  # optional
KNOTS = 17  # of the curve, at equally spaced frictions
MIN_LEVELS = 4  # different amplitudes: fewer show no curve
MAX_READINGS = 100_000
OUTLIER_SIGMA = 5.0
SIGMA_PER_MEDIAN = 1.4826  # of normal noise: standard deviation over median size
LEAST_FALL = 0.2  # of bare glass's friction: a smaller fall is hardly perceptible
FLAT_SIGMA = 2.0  # of a block's mean: a block nearer to the floor belongs to it
LARGEST = 1e9  # of a reading in any unit: its square is summed
LEAST_FLOOR_FRAC, MOST_FLOOR_FRAC = 0.001, 0.99  # of the configuration's key
ROUNDING = 1e-9  # of the friction: readings without noise have a floor too


@dataclass(frozen=True, slots=True)
class FrictionFit:
    """The curve `amplitude_um` (KNOTS,) at equally spaced frictions 1 .. 0, rising from 0; bare glass, floor and noise
    of one reading in the readings' own unit; the readings (N,) that were left out; what was fitted of their speeds."""

    amplitude_um: FloatArray
    bare: float
    floor: float
    noise_rms: float
    left_out: npt.NDArray[np.bool_]
    speed: SpeedFit


def check(options: argparse.Namespace) -> None:
    """Check the arguments. Raises CalibrationError."""
    if options.sim:
        return
    if options.readings is None:
        raise MissingInput("No readings are given: add --readings F.csv with amplitude_um,friction, or --sim.")
    read(options.readings)


def run(options: argparse.Namespace) -> Verdict:
    """Run the step. Raises CalibrationError."""
    found = fit_friction(*(simulated.friction_readings(options.seed) if options.sim else read(options.readings)))
    draw(found, options.out / "friction.png", source=simulated.source(options))
    return verdict(found, is_simulated=options.sim)


def read(path: Path) -> FloatArray:
    """Return amplitudes, frictions and, where they were noted, sliding speeds (2 or 3, N) of a CSV file with the header
    COLUMNS, and SPEED_COLUMN if it has speeds. Raises CalibrationError."""
    try:
        lines = read_lines(path, 2 * MAX_READINGS)  # some of them empty
        rows = csv_rows(lines)
        _, header = next(rows, (0, []))
        if header not in ([*COLUMNS], [*COLUMNS, SPEED_COLUMN]):
            raise CalibrationError(
                f"{path}: does not begin with the header {','.join(COLUMNS)}: add it, with commas between cells and "
                "points in numbers."
            )
        cells = [row for _, row in rows]
    except (OSError, ValueError) as error:
        raise CalibrationError(f"{path}: cannot be read ({reason(error)}): save the readings as CSV.") from None
    if not 0 < len(cells) <= MAX_READINGS:
        raise CalibrationError(f"{path}: holds {len(cells)} readings: give 1 to {MAX_READINGS}, a line for each.")
    found = []
    for place, row in enumerate(cells, 1):
        try:
            found.append(np.array(row, np.float64).reshape(len(header)))
        except ValueError:
            why = f"reading {place} is not {len(header)} numbers"
            raise CalibrationError(f"{path}: {why}: correct or delete it.") from None
    return np.array(found).T


def fit_friction(
    amplitude_um: npt.ArrayLike, friction: npt.ArrayLike, speed_mm_s: npt.ArrayLike | None = None
) -> FrictionFit:
    """Fit a falling curve to readings (N,) in any order, and its dependence on speed where they show one.

    Raises CalibrationError for readings that show no curve.
    """
    amplitude, value = np.asarray(amplitude_um, np.float64), np.asarray(friction, np.float64)
    if not ((amplitude >= 0.0) & (amplitude <= LARGEST) & (np.abs(value) <= LARGEST)).all():  # NaN fails this, too
        raise CalibrationError("An amplitude is negative, or a reading is no finite number: correct or delete it.")
    if len(np.unique(amplitude)) < MIN_LEVELS or not amplitude.min() <= BARE_UM:
        raise CalibrationError(f"Measure bare glass (0 um) and at least {MIN_LEVELS - 1} amplitudes above it.")
    speeds = None if speed_mm_s is None else np.asarray(speed_mm_s, np.float64)
    if speeds is not None and not ((speeds > 0.0) & (speeds <= LARGEST)).all():
        raise CalibrationError("A speed is not above 0, or no finite number: correct or delete its reading.")
    speed = fit_speed(amplitude, value, speeds)
    amplitude, value = speed.amplitude_um, speed.friction
    left_out = _left_out(amplitude, value)
    kept, heights = amplitude[~left_out], value[~left_out]
    levels, falling, weights = _falling(kept, heights)
    if not falling[0] > 0.0:
        raise CalibrationError("Bare glass has no friction above 0: check the readings' sign.")
    noise = float(np.sqrt(np.mean((heights - falling[np.searchsorted(levels, kept)]) ** 2)))
    curve_um = _inverted(*_blocks(levels, falling, weights, noise))
    bare, floor = float(falling[0]), float(falling[-1])
    return FrictionFit(curve_um, bare, floor, noise, left_out, speed)


def _left_out(amplitude: FloatArray, value: FloatArray) -> npt.NDArray[np.bool_]:
    """Mark readings far off a curve through the medians of each amplitude."""
    levels = np.unique(amplitude)
    medians = np.array([np.median(value[amplitude == level]) for level in levels])
    curve = _isotonic(medians, np.ones(len(levels)))
    miss = np.abs(value - curve[np.searchsorted(levels, amplitude)])
    sigma = SIGMA_PER_MEDIAN * float(np.median(miss))
    return np.asarray(miss > max(OUTLIER_SIGMA * sigma, 1e-9 * float(np.abs(value).max())), np.bool_)


def _falling(amplitude: FloatArray, value: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the distinct amplitudes (L,), the isotonic fit there (L,), and the number of readings of each (L,)."""
    levels, where = np.unique(amplitude, return_inverse=True)
    weights = np.bincount(where).astype(np.float64)
    return levels, _isotonic(np.bincount(where, value) / weights, weights), weights


def _isotonic(value: FloatArray, weights: FloatArray) -> FloatArray:
    from scipy.optimize import isotonic_regression

    return np.asarray(isotonic_regression(value, weights=weights, increasing=False).x, np.float64)


def _blocks(
    levels: FloatArray, falling: FloatArray, weights: FloatArray, noise: float
) -> tuple[FloatArray, FloatArray]:
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


def _inverted(at_um: FloatArray, height: FloatArray) -> FloatArray:
    """Return the amplitude at KNOTS equally spaced frictions 1 .. 0: the cubic falls strictly."""
    from scipy.interpolate import PchipInterpolator

    curve = PchipInterpolator(at_um, (height - height[-1]) / (height[0] - height[-1]))
    between = [curve.solve(share, extrapolate=False)[0] for share in np.linspace(1.0, 0.0, KNOTS)[1:-1]]
    return np.array([0.0, *between, at_um[-1]])


def verdict(found: FrictionFit, *, is_simulated: bool) -> Verdict:
    """Judge the curve and its uncertainty."""
    noise_frac = found.noise_rms / (found.bare - found.floor)
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
    fallen = f"Friction falls to {100.0 * found.floor / found.bare:.0f} % at {found.amplitude_um[-1]:.2f} um."
    outcome, sentence = judge(findings, f"{fallen} {found.speed.sentence}")
    plate = {
        "friction_curve": [round(um, 5) for um in found.amplitude_um.tolist()],
        "friction_floor_frac": round(min(max(found.floor / found.bare, LEAST_FLOOR_FRAC), MOST_FLOOR_FRAC), 4),
        "friction_speed_mm_s": round(found.speed.speed_mm_s, 1) if math.isfinite(found.speed.speed_mm_s) else 0.0,
    }
    return Verdict("friction", outcome, sentence, figures, {"plate": plate}, is_simulated)


def draw(found: FrictionFit, path: Path, *, source: str = "") -> None:
    """Draw readings, outliers and the curve, as of a finger at rest. Raises HapticdError."""
    figure, ((plot,),) = plotting.subplots(6.0, 4.0, source=source)
    amplitude_um, friction, left_out = found.speed.amplitude_um, found.speed.friction, found.left_out
    plot.plot(amplitude_um[~left_out], friction[~left_out], ".", label="readings")
    plot.plot(amplitude_um[left_out], friction[left_out], "x", label="left out")
    height = found.floor + (found.bare - found.floor) * np.linspace(1.0, 0.0, KNOTS)
    farthest_um = max(amplitude_um.max(), found.amplitude_um[-1])
    plot.plot([*found.amplitude_um, farthest_um], [*height, found.floor], "-o", markersize=3, label="curve")
    plot.set(xlabel="amplitude, um peak to peak", ylabel="friction, as measured", ylim=(0.0, None))
    plot.legend()
    plotting.save(figure, path, **PICTURE)


def _add_readings(parser: argparse.ArgumentParser) -> None:
    columns = "columns amplitude_um,friction, and optionally speed_mm_s"
    parser.add_argument("--readings", type=Path, metavar="F.csv", help=columns)


STEP = Step(
    name="friction",
    order=12,
    summary="fit friction against amplitude (--readings FILE)",
    example="--readings friction.csv --out DIR",
    arguments=(_add_readings, add_participant),
    check=check,
    run=run,
)
