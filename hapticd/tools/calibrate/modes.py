"""Step 2: from a vibrometer's scan to the map that the service solves with.

`design.cartography` aligns, denoises and fits twice, by the plate equation alone and by free-plate modes; what fits
better is taken, the other is the cross-check. The map's cross-validated error goes through the solver (`leak`).
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ...config.sections import LimitsConfig
from ...core.plate.mode_shapes import ModeShapes
from ...design import CartographyFit, fit_scan, nearest_free_modes
from ...errors import CalibrationError, ModesError
from . import picture, simulated
from .leak import ExpectedLeak, expected_leak
from .scan_file import Scan, read
from .verdict import Figure, Finding, Outcome, Verdict, judge

MODES_FILE, PICTURE_FILE = "modes.npz", "modes.png"

USUAL_LIMIT_UM = LimitsConfig().w_limit_um
GOOD_LEAK_UM, USABLE_LEAK_UM = 0.05, 0.3  # under the sticky finger, for 1 um under the other
USABLE_NOISE_FRAC = 0.5  # of the map, both RMS
ONE_PHASE = 3.0  # times the noise: what may lie across a mode's phase
WRONG_FRAC = 0.05  # of the points
ALIKE_FRAC = 0.9  # of two modes' correlation squared: beyond it they are one
LIKE_THEORY_FRAC = 0.7  # of that with the nearest free-plate mode
TURNED_DEG, SHIFTED_MM = 1.0, 1.0
RUNAWAY = 3.0  # times the largest readings: a map that goes beyond was invented between points or at the edges


@dataclass(frozen=True, slots=True)
class FittedMap:
    """The fit that is taken; by how much the other one's map differs, RMS per mode (M,), NaN where there is none; per
    mode the free-plate mode that it is most like and their correlation squared; how far the map goes beyond the largest
    readings; and what it will leak."""

    fit: CartographyFit
    other_differs_rms: npt.NDArray[np.float64]
    like: tuple[tuple[str, float], ...]
    beyond: float
    leak: ExpectedLeak


def run(options: argparse.Namespace) -> Verdict:
    """The whole step. Raises CalibrationError."""
    picture.require()
    size_mm = parse_size(options.size)
    if options.sim:
        scan = Scan(*simulated.scan(options.seed))
    elif options.scan is None:
        raise CalibrationError("No scan is named: give --scan with the vibrometer's CSV or NPZ, or try it with --sim.")
    else:
        scan = read(options.scan)
    # The simulated scan is divided by the modal amplitude, as the simulated plate's own cartography is.
    found = fit_map(scan, size_mm, normalise=not (options.own_scale or options.sim))
    found.fit.modes.save(options.out / MODES_FILE)
    draw(scan, found, options.out / PICTURE_FILE)
    return verdict(found, len(scan.points_mm), size_mm, is_simulated=options.sim)


def parse_size(text: str) -> tuple[float, float]:
    """Width and depth in mm of "137.5x137.5". Raises CalibrationError."""
    try:
        width_mm, depth_mm = map(float, text.lower().split("x"))
    except ValueError:
        raise CalibrationError(f"--size is {text!r}: write width x depth in mm, such as 137.5x137.5.") from None
    if not (10.0 <= width_mm <= 1000.0 and 10.0 <= depth_mm <= 1000.0):
        raise CalibrationError(f"--size is {text!r}: a plate has 10 to 1000 mm along either edge.")
    return width_mm, depth_mm


def fit_map(scan: Scan, size_mm: tuple[float, float], *, normalise: bool) -> FittedMap:
    """Fit, cross-check and price the scan. Raises CalibrationError where it does not describe mode shapes."""
    fits: list[CartographyFit] = []
    for by in ("plate_equation", "free_plate"):
        try:
            fits.append(fit_scan(*scan, size_mm=size_mm, normalise=normalise, by=by))
        except ModesError as error:
            if by == "plate_equation":
                raise CalibrationError(f"The scan cannot be fitted: {error}") from None
    fits.sort(key=lambda fit: float((fit.prediction_rms**2).sum()))
    best = fits[0]
    differs = best.modes.shapes - fits[-1].modes.shapes
    differs_rms = np.sqrt((differs**2).mean(axis=(1, 2))) if len(fits) > 1 else np.full(best.modes.M, np.nan)
    return FittedMap(
        best,
        differs_rms,
        nearest_free_modes(best.modes, best.wavelength_mm, size_mm),
        _beyond(best, scan),
        expected_leak(best.modes, best.map_error_rms.tolist()),
    )


def verdict(found: FittedMap, points: int, size_mm: tuple[float, float], *, is_simulated: bool) -> Verdict:
    """Whether these are modes of one plate, and what the map will leak."""
    fit = found.fit
    figures = [
        Figure("points", float(points), ""),
        Figure("points left out", float(fit.left_out), ""),
        Figure("wavelength", fit.wavelength_mm, "mm"),
        Figure("scan turned by", math.degrees(fit.pose.rotation_rad), "degrees"),
        Figure("scan shifted by", math.hypot(fit.pose.x_mm, fit.pose.y_mm), "mm"),
    ]
    for mode in range(fit.modes.M):
        name, correlation = found.like[mode] if found.like else ("none", math.nan)
        figures += [
            Figure(f"mode {mode} noise of a reading", 100.0 * fit.noise_rms[mode], "% of the peak"),
            Figure(f"mode {mode} error of the map", 100.0 * fit.map_error_rms[mode], "% of the peak"),
            Figure(f"mode {mode} other fit differs by", 100.0 * found.other_differs_rms[mode], "% of the peak"),
            Figure(f"mode {mode} is like {name}", 100.0 * correlation, "%"),
        ]
    figures += [
        Figure("expected leak, RMS", found.leak.rms_um, "um for 1 um"),
        Figure("expected leak, 95 %", found.leak.most_um, "um for 1 um"),
    ]
    taken = {"plate_equation": "the plate equation", "free_plate": "free-plate modes"}[fit.by]
    outcome, sentence = judge(
        _findings(found, points), f"The map, by {taken}, will leak {found.leak.rms_um:.4f} um for 1 um."
    )
    settings: dict[str, dict[str, Any]] = {"plate": {"size_mm": [*size_mm], "modes_file": MODES_FILE}}
    if len(USUAL_LIMIT_UM) != fit.modes.M:
        settings["limits"] = {"w_limit_um": _limits_um(fit.modes.M)}
    return Verdict("modes", outcome, sentence, tuple(figures), settings, is_simulated)


def _findings(found: FittedMap, points: int) -> list[Finding]:
    fit, leak_um = found.fit, found.leak.rms_um
    findings: list[Finding] = []
    if leak_um > GOOD_LEAK_UM:
        bad = Outcome.FAIL if leak_um > USABLE_LEAK_UM else Outcome.LOOK
        findings.append(
            (bad, f"The map would leak {leak_um:.2f} um for 1 um: measure closer points, or longer at each.")
        )
    if len(USUAL_LIMIT_UM) != fit.modes.M:
        count = f"{fit.modes.M} mode{'' if fit.modes.M == 1 else 's'} where a plate usually has {len(USUAL_LIMIT_UM)}"
        findings.append((Outcome.LOOK, f"The scan has {count}: are limits.w_limit_um right, and the board's modes?"))
    if found.beyond > RUNAWAY:
        beyond = f"The map goes {found.beyond:.1f} times beyond the largest readings"
        findings.append((Outcome.FAIL, f"{beyond}: measure closer points, up to the edges."))
    for first, second in zip(*np.triu_indices(fit.modes.M, 1), strict=True):
        if _correlation(fit.modes, int(first), int(second)) > ALIKE_FRAC:
            findings.append(
                (Outcome.FAIL, f"Modes {first} and {second} have the same shape: drive each of them alone.")
            )
    sizes = np.sqrt((fit.modes.shapes**2).mean(axis=(1, 2)))
    for mode, noise_frac in enumerate(fit.noise_rms / sizes):
        if not noise_frac <= USABLE_NOISE_FRAC:
            findings.append((Outcome.FAIL, f"Mode {mode} is mostly noise: measure longer at each point."))
    if not found.like:
        findings.append(
            (Outcome.LOOK, "Theory has no mode of this wavelength here: is --size right, and are positions in mm?")
        )
    for mode, across in enumerate(fit.across_rms):
        if across > ONE_PHASE * fit.noise_rms[mode]:
            findings.append((Outcome.LOOK, f"Mode {mode} does not move in one phase: another mode was driven with it."))
    for mode, (name, correlation) in enumerate(found.like):
        if correlation < LIKE_THEORY_FRAC:
            like = f"Mode {mode} is like the free plate's {name} by only {100 * correlation:.0f} %"
            findings.append((Outcome.LOOK, f"{like}: is it another one, or a mixture?"))
    if fit.left_out > WRONG_FRAC * points:
        findings.append((Outcome.LOOK, f"{fit.left_out} of {points} readings are wrong: look at the reflecting film."))
    turned_deg, shifted_mm = math.degrees(fit.pose.rotation_rad), math.hypot(fit.pose.x_mm, fit.pose.y_mm)
    if abs(turned_deg) > TURNED_DEG or shifted_mm > SHIFTED_MM:
        findings.append(
            (Outcome.LOOK, f"The scan lay {turned_deg:+.1f} degrees and {shifted_mm:.1f} mm off: was that so?")
        )
    return findings


def _limits_um(modes: int) -> list[float]:
    """One for each mode, for the service takes no other number of them: the usual plate's, none larger."""
    return [min(USUAL_LIMIT_UM)] * modes


def _beyond(fit: CartographyFit, scan: Scan) -> float:
    """The map's largest value over that of the readings, specks left out; of all modes the largest."""
    told = np.nanpercentile(np.abs(scan.readings / fit.scale), 99.0, axis=0)
    return float((np.abs(fit.modes.shapes).max(axis=(1, 2)) / told).max())


def _correlation(modes: ModeShapes, first: int, second: int) -> float:
    one, other = modes.shapes[first].ravel(), modes.shapes[second].ravel()
    return float((one @ other) ** 2 / ((one @ one) * (other @ other)))


def draw(scan: Scan, found: FittedMap, path: Path) -> None:
    """Of each mode the readings, the map, and what is between them. Raises CalibrationError."""
    modes, scale = found.fit.modes, found.fit.scale
    figure, axes = picture.canvas(3, modes.M, width_in=7.5, height_in=2.5 * modes.M)
    extent = (modes.x_mm[0], modes.x_mm[-1], modes.y_mm[0], modes.y_mm[-1])
    on_map = modes.evaluate(found.fit.pose.on_plate(scan.points_mm))
    for mode in range(modes.M):
        told = (scan.readings[:, mode] / scale[mode]).real
        largest = float(np.abs(modes.shapes[mode]).max())
        look = {"cmap": "RdBu", "vmin": -largest, "vmax": largest}
        left, middle, right = axes[mode]
        left.scatter(*scan.points_mm.T, c=told, s=7, marker="s", **look)
        middle.imshow(modes.shapes[mode], origin="lower", extent=extent, **look)
        residual = told - on_map[:, mode]
        reach = max(float(np.nanpercentile(np.abs(residual), 99.0)), 1e-12)
        right.scatter(*scan.points_mm.T, c=residual, s=7, marker="s", cmap="RdBu", vmin=-reach, vmax=reach)
        like = found.like[mode][0] if found.like else "mode"
        left.set(title=f"mode {mode}: readings", ylabel="y, mm")
        middle.set(title=f"map, like {like}")
        right.set(title=f"difference, to {100 * reach:.1f} %")
    for plot in axes.ravel():
        plot.set(aspect="equal", xlim=extent[:2], ylim=extent[2:])
    picture.save(figure, path)
