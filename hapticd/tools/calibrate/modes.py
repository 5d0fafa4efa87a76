"""Fit of a vibrometer's or microphone's scan, or of added masses, to the mode map that the service solves with.

`design.cartography` fits twice, by the plate equation and by free-plate modes; the better fit is taken, the other one
is the cross-check. The map's cross-validated error is propagated through the solver.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...config.sections import LEAST_CONTACT_MODES, MOST_MODES, LimitsConfig, SimConfig, SolverConfig
from ...core.plate.mode_shapes import ModeShapes
from ...core.solver.public import solve_batch
from ...design import CartographyFit, fit_scan, nearest_free_modes
from ...design.cartography import REFERENCE_SIZE_MM, compensated
from ...design.contact_pairs import random_fingers
from ...design.felt_places import settle_felt, touches, touches_at
from ...design.free_fit import signed
from ...design.mode_choice import CHOICE_PLACES, FINGER_KG_S, Choice, FeltTask, NearModes, choose
from ...design.patch_reach import AMPLIFIER_V, PatchDrive
from ...errors import CalibrationError, ModesError
from ...formats.mode_map import LoweredScan, Scan, SweptModes, read_scan, read_swept
from ...sim.plate.glasses import find_glass
from ...sim.plate.ground_truth import GroundTruth, PlateSettings
from ...values import ComplexArray, FloatArray
from .. import glass, plotting
from ..progress import progress_bar
from . import simulated
from .resonance import SWEEP_FILE
from .step import PICTURE, Figure, Finding, MissingInput, Outcome, Step, Verdict, judge
from .universal_file import PER_METRE, SUFFIXES, read_universal

MODES_FILE = "modes.npz"

USUAL_LIMIT_UM = LimitsConfig().w_limit_um
GOOD_LEAK_UM, USABLE_LEAK_UM = 0.05, 0.3  # at the sticky finger, for 1 um at the other
USABLE_NOISE_FRAC = 0.5  # of the map, both RMS
ONE_PHASE = 3.0  # times the noise: the largest quadrature of a single mode
WRONG_FRAC = 0.05  # of the points
ALIKE_FRAC = 0.9  # squared correlation beyond which two modes are the same
LIKE_THEORY_FRAC = 0.7  # least squared correlation with the nearest free-plate mode
TURNED_DEG, SHIFTED_MM = 1.0, 1.0
RUNAWAY = 3.0  # times the largest readings: a larger map is extrapolated between points or at the edges
TARGETS_UM = (1.0, 0.0)  # of the pairs for which the leak is estimated
W_LIMIT_UM = 4.0
PAIRS = 1000
USUAL_KG_MM2 = 7.5e-6  # of 3 mm of glass: fingers move undriven modes little compared with patches
SCAN_PT2 = 8  # area of a reading's mark in the picture


class ExpectedLeak(NamedTuple):
    """RMS and 95th percentile over pairs of fingers, in um for the TARGETS_UM."""

    rms_um: float
    most_um: float


@dataclass(frozen=True, slots=True)
class FittedMap:
    """The better fit and its checks.

    `other_differs_rms` (M,): difference of the other fit's map, NaN without one. `like`: for each mode the most similar
    free-plate mode and their squared correlation. `beyond`: the map's largest value over the largest readings.
    """

    fit: CartographyFit
    other_differs_rms: FloatArray
    like: tuple[tuple[str, float], ...]
    beyond: float
    leak: ExpectedLeak


def check(options: argparse.Namespace) -> None:
    """Check the arguments. Raises CalibrationError."""
    if not options.sim:
        _read(options)


def _read(options: argparse.Namespace) -> tuple[Scan, Mapping[str, int]]:
    """Return the scan, and what of a universal file is not in it. Raises CalibrationError."""
    path: Path | None = options.scan
    if path is None:
        raise MissingInput("No scan is given: add --scan with the vibrometer's CSV, NPZ or UFF, or --sim.")
    try:
        if path.suffix.lower() in SUFFIXES:
            return read_universal(path, options.unit)
        if options.unit is not None:
            raise CalibrationError("--unit: only a universal file needs it; CSV and NPZ are in mm: omit it.")
        return read_scan(path), {}
    except ModesError as error:
        raise CalibrationError(f"--scan: {error}") from None


def run(options: argparse.Namespace) -> Verdict:
    """Run the step. Raises CalibrationError."""
    plate = glass.chosen(options) if options.sim else None
    size_mm = options.size or (REFERENCE_SIZE_MM if plate is None else find_glass(plate.plate).size_mm)
    sweep = options.out / SWEEP_FILE
    if plate is None:
        scan, left_out = _read(options)
    else:
        swept_hz = read_swept(sweep).frequency_hz if sweep.exists() else None
        scan, left_out = simulated.scan(options.seed, plate, swept_hz), {}
    swept = scan.swept
    if isinstance(scan, LoweredScan):
        scan = _with_signs(scan, size_mm)  # of its own: a sweep's gains have other ones
    elif swept is None and sweep.exists():
        swept = read_swept(sweep, scan.readings.shape[1])
    # The simulated scan is divided by the modal amplitude, as the simulated plate's own cartography is.
    with progress_bar("fitting the scan twice") as progress:
        found = fit_map(scan, size_mm, normalise=not (options.own_scale or options.sim), progress=progress)
    draw(scan, found, options.out / "modes.png", source=simulated.source(options))
    choice, maps = (None, found.fit.modes) if swept is None else chosen(found.fit, swept, size_mm)
    maps.save(options.out / MODES_FILE)
    if choice is not None:
        error_rms = found.fit.map_error_rms[list(choice.used)]
        found = replace(found, leak=expected_leak(maps, error_rms, size_mm))
    return verdict(found, len(scan.points_mm), size_mm, plate, left_out, choice)


def chosen(fit: CartographyFit, swept: SweptModes, size_mm: tuple[float, float]) -> tuple[Choice, ModeShapes]:
    """Return which of the scanned modes are driven, and their maps, with what the patches push of the others: in the
    scan's scale, in which `swept` is. Raises CalibrationError."""
    peaks = np.abs(fit.modes.shapes).max(axis=(1, 2))
    hz, gain_um_per_v_s = swept.frequency_hz, swept.gain_um_per_v_s * peaks[:, None]
    driven = PatchDrive(
        hz, math.pi * hz / swept.q_factor, gain_um_per_v_s, np.full(gain_um_per_v_s.shape[1], AMPLIFIER_V)
    )
    task, scanned = FeltTask(), ModeShapes(fit.modes.x_mm, fit.modes.y_mm, fit.modes.shapes / peaks[:, None, None])
    found = touches(scanned, size_mm, task.radius_mm, len(task.targets_um), CHOICE_PLACES, task.seed)
    near = NearModes(driven, found, FINGER_KG_S / (math.prod(size_mm) * USUAL_KG_MM2))
    choice = choose(near, task)
    if choice is None:
        raise CalibrationError(
            f"No drive is within {task.farthest_hz:g} Hz of {gain_um_per_v_s.shape[1]} modes that the amplifiers move "
            "each alone: sweep wider and scan more modes, or drive fewer."
        )
    used, rest = list(choice.used), near.undriven(choice.used)
    pushed = near.pushed(used, choice.drive_hz).real
    shapes = compensated(scanned.shapes[used], scanned.shapes[rest], pushed) * peaks[used, None, None]
    limits_um = (np.array(choice.limits_um) / peaks[used]).tolist()
    return replace(choice, limits_um=tuple(limits_um)), ModeShapes(scanned.x_mm, scanned.y_mm, shapes)


def parse_size(text: str) -> tuple[float, float]:
    """Parse width and depth in mm, such as "137.5x137.5". Raises CalibrationError."""
    try:
        width_mm, depth_mm = map(float, text.lower().split("x"))
    except ValueError:
        raise CalibrationError(f"--size is {text!r}: write width x depth in mm, such as 137.5x137.5.") from None
    if not (10.0 <= width_mm <= 1000.0 and 10.0 <= depth_mm <= 1000.0):
        raise CalibrationError(f"--size is {text!r}: a plate has 10 to 1000 mm along either edge.")
    return width_mm, depth_mm


def fit_map(
    scan: Scan, size_mm: tuple[float, float], *, normalise: bool, progress: Callable[[float], None] = lambda _: None
) -> FittedMap:
    """Fit and cross-check the scan. Raises CalibrationError if it does not describe mode shapes."""
    fits: list[CartographyFit] = []
    for by in ("plate_equation", "free_plate"):
        try:
            fits.append(fit_scan(scan.points_mm, scan.readings, size_mm=size_mm, normalise=normalise, by=by))
        except ModesError as error:
            if by == "plate_equation":
                raise CalibrationError(f"The scan cannot be fitted: {error}") from None
        progress(0.5 * len(fits))
    fits.sort(key=lambda fit: float((fit.prediction_rms**2).sum()))
    best = fits[0]
    differs = best.modes.shapes - fits[-1].modes.shapes
    differs_rms = np.sqrt((differs**2).mean(axis=(1, 2))) if len(fits) > 1 else np.full(best.modes.M, np.nan)
    largest = np.nanpercentile(np.abs(scan.readings / best.scale), 99.0, axis=0)
    beyond = float((np.abs(best.modes.shapes).max(axis=(1, 2)) / largest).max())
    like = nearest_free_modes(best.modes, best.wavelength_mm, size_mm)
    return FittedMap(best, differs_rms, like, beyond, expected_leak(best.modes, best.map_error_rms, size_mm))


def _with_signs(scan: LoweredScan, size_mm: tuple[float, float]) -> Scan:
    try:
        return Scan(scan.points_mm, signed(scan.points_mm, scan.readings, size_mm))
    except ModesError as error:
        raise CalibrationError(f"The scan cannot be fitted: {error}") from None


def verdict(
    found: FittedMap,
    points: int,
    size_mm: tuple[float, float],
    simulated: SimConfig | None,
    left_out: Mapping[str, int] | None = None,
    choice: Choice | None = None,
) -> Verdict:
    """Judge whether these are modes of one plate, here the `simulated` one, and the map's expected leak; `choice`:
    which of them are driven."""
    fit = found.fit
    share = 100.0 / np.abs(fit.modes.shapes).max(axis=(1, 2))
    figures = [
        Figure("points", float(points), ""),
        Figure("points left out", float(fit.left_out), ""),
        *(Figure(f"left out of the file: {what}", count, "functions") for what, count in (left_out or {}).items()),
        Figure("wavelength", fit.wavelength_mm, "mm"),
        Figure("scan turned by", math.degrees(fit.pose.rotation_rad), "degrees"),
        Figure("scan shifted by", math.hypot(fit.pose.x_mm, fit.pose.y_mm), "mm"),
    ]
    for mode in range(fit.modes.M):
        name, correlation = found.like[mode] if found.like else ("none", math.nan)
        figures += [
            Figure(f"mode {mode + 1} noise of a reading", share[mode] * fit.noise_rms[mode], "% of the peak"),
            Figure(f"mode {mode + 1} error of the map", share[mode] * fit.map_error_rms[mode], "% of the peak"),
            Figure(
                f"mode {mode + 1} other fit differs by", share[mode] * found.other_differs_rms[mode], "% of the peak"
            ),
            Figure(f"mode {mode + 1} residual", share[mode] * fit.residual_rms[mode], "% of the peak"),
            Figure(f"mode {mode + 1} is like {name}", 100.0 * correlation, "%"),
        ]
    figures += [
        Figure("expected leak, RMS", found.leak.rms_um, "um for 1 um"),
        Figure("expected leak, 95 %", found.leak.most_um, "um for 1 um"),
    ]
    taken = "free-plate modes" if fit.by == "free_plate" else "the plate equation"
    taken += " and what they lack" if fit.by == "free_plate" and np.isfinite(fit.free_plate_rms).all() else ""
    passed = f"The map, by {taken}, leaks {found.leak.rms_um:.4f} um for 1 um."
    outcome, sentence = judge(_findings(found, points, simulated is not None or choice is not None), passed)
    count = fit.modes.M if choice is None else len(choice.used)
    if choice is not None:
        sentence = f"{choice.sentence(fit.modes.M)}. {sentence}"
    settings: dict[str, dict[str, Any]] = {"plate": {"size_mm": [*size_mm], "modes_file": MODES_FILE}}
    if simulated is not None:
        settings |= glass.settings(simulated)
    if simulated is None and choice is not None:
        settings["limits"] = {"w_limit_um": [round(um, 3) for um in choice.limits_um]}
    elif len(USUAL_LIMIT_UM) != count:  # the service requires one for each mode
        built = None if simulated is None else GroundTruth(PlateSettings.of(simulated.plate, count))
        settings["limits"] = {"w_limit_um": [min(USUAL_LIMIT_UM)] * count if built is None else [*built.w_limit_um]}
    return Verdict("modes", outcome, sentence, tuple(figures), settings, simulated is not None)


def _findings(found: FittedMap, points: int, is_count_known: bool) -> Iterator[Finding]:
    fit, leak_um = found.fit, found.leak.rms_um
    if leak_um > GOOD_LEAK_UM:
        bad = Outcome.FAIL if leak_um > USABLE_LEAK_UM else Outcome.WARN
        yield bad, f"The map would leak {leak_um:.2f} um for 1 um: measure closer points, or longer at each."
    if len(USUAL_LIMIT_UM) != fit.modes.M and not is_count_known:
        count = f"{fit.modes.M} mode{'' if fit.modes.M == 1 else 's'} where a plate usually has {len(USUAL_LIMIT_UM)}"
        yield Outcome.WARN, f"The scan has {count}: check limits.w_limit_um and the board's modes."
    if found.beyond > RUNAWAY:
        beyond = f"The map goes {found.beyond:.1f} times beyond the largest readings"
        yield Outcome.FAIL, f"{beyond}: measure closer points, up to the edges."
    sizes = np.sqrt((fit.modes.shapes**2).mean(axis=(1, 2)))
    unit = fit.modes.shapes.reshape(fit.modes.M, -1) / sizes[:, None]
    alike = (unit @ unit.T / unit.shape[1]) ** 2
    for first, second in combinations(range(fit.modes.M), 2):
        if alike[first, second] > ALIKE_FRAC:
            yield Outcome.FAIL, f"Modes {first + 1} and {second + 1} have the same shape: drive each of them alone."
    for mode, noise_frac in enumerate(fit.noise_rms / sizes):
        if not noise_frac <= USABLE_NOISE_FRAC:
            yield Outcome.FAIL, f"Mode {mode + 1} is mostly noise: measure longer at each point."
    if not found.like:
        yield Outcome.WARN, "Theory has no mode of this wavelength: check --size, and that positions are in mm."
    for mode, across in enumerate(fit.across_rms):
        if across > ONE_PHASE * fit.noise_rms[mode]:
            yield Outcome.WARN, f"Mode {mode + 1} does not move in one phase: another mode was driven with it."
    for mode, (name, correlation) in enumerate(found.like):
        if correlation < LIKE_THEORY_FRAC:
            like = f"Mode {mode + 1} is like the free plate's {name} by only {100 * correlation:.0f} %"
            yield Outcome.WARN, f"{like}: check for another mode or a mixture."
    if fit.left_out > WRONG_FRAC * points:
        yield Outcome.WARN, f"{fit.left_out} of {points} readings are wrong: look at the reflecting film."
    turned_deg, shifted_mm = math.degrees(fit.pose.rotation_rad), math.hypot(fit.pose.x_mm, fit.pose.y_mm)
    if abs(turned_deg) > TURNED_DEG or shifted_mm > SHIFTED_MM:
        yield Outcome.WARN, f"The scan lay {turned_deg:+.1f} degrees and {shifted_mm:.1f} mm off: check its axes."


def solved_um(modes: ModeShapes, pairs_mm: FloatArray) -> ComplexArray:
    """Return the modal amplitudes (pairs, M) that the service would find on the map, for points or for contacts."""
    if modes.M >= LEAST_CONTACT_MODES:
        found = touches_at(modes, pairs_mm, SolverConfig().contact_radius_mm)
        return settle_felt(found, TARGETS_UM, [W_LIMIT_UM] * modes.M, starts=1)[0]
    phi = modes.evaluate(pairs_mm.reshape(-1, 2)).reshape(*pairs_mm.shape[:2], modes.M)
    return solve_batch(phi, TARGETS_UM, W_LIMIT_UM).astype(np.complex128)


def expected_leak(modes: ModeShapes, map_error_rms: FloatArray, size_mm: tuple[float, float]) -> ExpectedLeak:
    """Return the vibration at a sticky finger caused by the map's errors `map_error_rms` (M,), in units of the shapes.

    Random pairs of fingers, one slippery, one sticky, are solved on the map. The sticky one then gets sum_k W_k e_k,
    where the map's error e_k is independent between modes and has the cross-validated RMS everywhere. Raises
    CalibrationError for a plate without room for two.
    """
    try:
        pairs_mm = random_fingers(size_mm, PAIRS, seed=1)
    except ValueError as error:
        raise CalibrationError(f"--size: {error}") from None
    if modes.M > MOST_MODES:  # none are chosen yet
        modes = ModeShapes(modes.x_mm, modes.y_mm, modes.shapes[:MOST_MODES])
    variance_um2 = np.abs(solved_um(modes, pairs_mm)) ** 2 @ map_error_rms[: modes.M] ** 2
    return ExpectedLeak(float(np.sqrt(variance_um2.mean())), float(np.sqrt(np.percentile(variance_um2, 95.0))))


def draw(scan: Scan, found: FittedMap, path: Path, *, source: str = "") -> None:
    """Draw readings, map and difference of each mode. Raises HapticdError."""
    modes, scale = found.fit.modes, found.fit.scale
    figure, axes = plotting.subplots(
        8.6, 2.6 * modes.M + 1.0, modes.M, 3, source=source, layout="compressed", sharex=True, sharey=True
    )
    extent = (modes.x_mm[0], modes.x_mm[-1], modes.y_mm[0], modes.y_mm[-1])
    values = (scan.readings / scale).real
    residual = values - modes.evaluate(found.fit.pose.on_plate(scan.points_mm))
    largest = float(np.abs(modes.shapes).max())
    reach = max(float(np.nanpercentile(np.abs(residual), 99.0)), 1e-12)
    look = {"cmap": plotting.stepped("RdBu", 20), "vmin": -largest, "vmax": largest}
    off = {"cmap": plotting.stepped("RdBu", 20), "vmin": -100 * reach, "vmax": 100 * reach}
    for mode, (left, middle, right) in enumerate(axes):
        left.scatter(*scan.points_mm.T, c=values[:, mode], s=SCAN_PT2, marker="s", **look)
        shapes = middle.imshow(modes.shapes[mode], origin="lower", extent=extent, **look)
        differences = right.scatter(*scan.points_mm.T, c=100 * residual[:, mode], s=SCAN_PT2, marker="s", **off)
        like = found.like[mode][0] if found.like else "mode"
        left.set(title=f"mode {mode + 1}: readings", ylabel="y, mm")
        middle.set(title=f"map, like {like}")
        right.set(title="readings - map")
    for plot in axes.ravel():
        plot.set(aspect="equal", xlim=extent[:2], ylim=extent[2:])
    for plot in axes[-1]:
        plot.set_xlabel("x, mm")
    figure.colorbar(shapes, ax=axes[:, :2], location="bottom", label="mode shape; its largest value is 1", aspect=40)
    figure.colorbar(differences, ax=axes[:, 2], location="bottom", label="difference, % of that", extend="both")
    plotting.save(figure, path, dpi=PICTURE["dpi"], colours=96)


def _add_scan(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scan", type=Path, metavar="FILE", help="the readings: CSV, NPZ or UFF")
    parser.add_argument("--unit", choices=[*PER_METRE], help="of positions in a UFF that does not say it (default m)")
    size = "of the plate (default 137.5x137.5, or the simulated plate's)"
    parser.add_argument("--size", type=parse_size, metavar="MMxMM", help=size)
    own = "the readings are divided by the modal amplitude: keep their scale"
    parser.add_argument("--own-scale", action="store_true", help=own)


STEP = Step(
    name="modes",
    order=8,
    summary="fit the vibrometer's scan of the mode shapes (--scan FILE)",
    example="--scan scan.csv --out DIR",
    arguments=(_add_scan, glass.add_arguments),
    check=check,
    run=run,
    files=(MODES_FILE,),
)
