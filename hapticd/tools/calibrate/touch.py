"""After the steps: correct pad, sensors and map by a recording of ordinary touches (`design.touch`).

A finger loads the plate where it is, which the board's sensors show. The recording needs the board's control ticks
(`record.telemetry_hz`). Nothing is adopted that held-out touches do not confirm.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np

from ...config.sections import SIMULATED
from ...core.plate.mode_shapes import ModeShapes
from ...design.touch.coverage import known_sentence, place_name
from ...design.touch.judge import Judged
from ...design.touch.model import CENTROID
from ...errors import CalibrationError
from ...files import calibration as calibration_file
from ...files.recording.mcap_reader import open_recording
from .. import plotting
from ..arguments import whole
from ..touch_correction import (
    calibration_of,
    contact_settings,
    has_sensors,
    joined,
    judged_by,
    known_better,
    mode_map,
    pad_settings,
)
from ..touch_recording import Touched, read
from . import guided
from .step import Step
from .verdict import PICTURE, Figure, FoundSettings, Outcome, Verdict

PICTURE_FILE, CALIBRATION_FILE, MODES_FILE = "touch.png", "touch-calibration.toml", "touch-modes.npz"
RECORDING_FILE = "touch.mcap"  # of guided touches
_POSE = (  # name, unit's size, unit
    ("x", 1.0, "mm"),
    ("y", 1.0, "mm"),
    ("rotation", math.degrees(1.0), "degrees"),
    ("scale along x", 100.0, "%"),
    ("scale along y", 100.0, "%"),
)
CONTACTS = "the contacts' size"
_CONTACTS = (  # section, key, figure, unit
    ("solver", "contact_radius_mm", "radius of a contact, mean", "mm"),
    ("trackpad", "ellipse_scale", "scale of the pad's ellipses", ""),
    ("trackpad", "ellipse_offset_mm", "offset of their axes", "mm"),
)
_DRAWN = 0.8  # of the map's extent
_ENLARGED = 20.0  # magnification of moved positions in the picture


def check(options: argparse.Namespace) -> None:
    """Check the arguments. Raises CalibrationError."""
    if options.guided == bool(options.recordings):
        raise CalibrationError("Give either a RECORDING of touches or --guided.")
    if options.sim_guided and not options.guided:
        raise CalibrationError("--sim: only with --guided, since a recording says which plate it is of.")
    for path in options.recordings:
        if not path.is_file():
            raise CalibrationError(f"RECORDING: {path} is not a file: give a recording (.mcap).")


def is_simulated(path: Path) -> bool:
    """Return whether a recording is of the simulated plate. Raises RecordingError."""
    return open_recording(path).header.config.trackpad.source == SIMULATED


def run(options: argparse.Namespace) -> Verdict:
    """Run the step. Raises HapticdError."""
    recordings = options.recordings
    if options.guided:
        recordings = [recording := options.out / RECORDING_FILE]
        guided.record(recording, is_simulated=options.sim, seed=options.seed, endpoint=options.endpoint)
        if is_simulated(recording) and not options.sim:
            raise CalibrationError("The running service has a simulated plate: give --sim, which needs no service.")
    touched = joined({path: read(path) for path in recordings})
    judged = judged_by(touched)
    settings = saved(touched, judged, options.out)
    names = ", ".join(path.name for path in recordings)
    draw(touched, judged, options.out / PICTURE_FILE, source=plotting.plain(names))
    return verdict(judged, settings, has_sensors=has_sensors(touched), is_simulated=options.sim)


def saved(touched: Touched, judged: Judged, directory: Path) -> FoundSettings:
    """Write what changes of calibration and map, and return the settings that go with it. Raises HapticdError."""
    settings = contact_settings(touched, judged)
    if judged.refusal:
        return settings
    settings["trackpad"] = settings.get("trackpad", {}) | pad_settings(touched, judged.calibration)
    if has_sensors(touched):
        calibration_file.save(directory / CALIBRATION_FILE, calibration_of(touched, judged))
        settings["device"] = {"calibration_file": CALIBRATION_FILE}
    if judged.waves is not None:
        mode_map(touched.header.modes, judged).save(directory / MODES_FILE)
        settings.setdefault("plate", {})["modes_file"] = MODES_FILE
    if known := known_better(touched, judged):
        settings["uncertainty"] = known
    return settings


def verdict(judged: Judged, settings: FoundSettings, *, has_sensors: bool, is_simulated: bool) -> Verdict:
    """Return what moved, by how much, one sigma, and whether it is adopted."""
    figures = [Figure("touching", judged.touched_s, "s")]
    for place, (name, unit, text) in enumerate(_POSE):
        figures += _moved(f"pad's {name}", judged.fitted.pad[place], judged.sigma.pad[place], unit, text)
    figures += _moved("pad's latency, with the centroid's shift", judged.latency_s, judged.latency_sigma_s, 1e3, "ms")
    figures += _moved("centroid's shift", judged.fitted.pad[CENTROID], judged.sigma.pad[CENTROID], 1.0, "mm")
    figures += _sense_figures(judged)
    if judged.waves is not None:
        change = judged.waves.rms(judged.calibration.waves)
        figures += [Figure(f"map of mode {mode}, change RMS", float(rms), "") for mode, rms in enumerate(change)]
    if judged.map_sigma is not None:
        for (row, column), sigma in np.ndenumerate(judged.map_sigma):
            figures.append(Figure(f"map, one sigma, {place_name(row, column)}", 100.0 * float(sigma), "% of the peak"))
    figures.append(Figure("held-out residual falls by", 100.0 * judged.gain_frac, "%"))
    figures.append(Figure("held-out residual falls by, map", 100.0 * judged.map_gain_frac, "%"))
    found = ((text, settings.get(section, {}).get(key), unit) for section, key, text, unit in _CONTACTS)
    figures += [Figure(text, value, unit) for text, value, unit in found if value is not None]
    independent = [CONTACTS] if "solver" in settings else []
    if judged.refusal:
        outcome = Outcome.PASS if independent else Outcome.FAIL
        adopted_alone = f"Adopted: {', '.join(independent)}." if independent else "Nothing is adopted."
        return Verdict("touch", outcome, f"{adopted_alone} {judged.refusal}", tuple(figures), settings, is_simulated)
    is_sense_moved = not np.array_equal(judged.calibration.sense, np.eye(len(judged.calibration.sense)))
    adopted = ["pad"]
    adopted += ["sensors"] if has_sensors and is_sense_moved else []
    adopted += ["map"] if judged.waves is not None else []
    adopted += independent
    lacking = "" if has_sensors else " The sensors' weights need `hapticd calibrate resonance` before the recording."
    known = "" if judged.map_sigma is None else known_sentence(judged.map_sigma)
    sentence = f"Adopted: {', '.join(adopted)}.{lacking} {judged.map_refusal}{known}"
    return Verdict("touch", Outcome.PASS, sentence.strip(), tuple(figures), settings, is_simulated)


def _moved(name: str, value: float, sigma: float, unit: float, text: str) -> list[Figure]:
    return [Figure(name, unit * float(value), text), Figure(f"{name}, one sigma", unit * float(sigma), text)]


def _sense_figures(judged: Judged) -> list[Figure]:
    """Return each sensor's weight in each mode against before; that of the first in its own stands for all gains."""
    figures = []
    modes = len(judged.fitted.sense)
    for mode in range(modes):
        for sensor in range(modes):
            if mode == sensor == 0:
                continue
            moved = judged.fitted.sense[mode, sensor] - (mode == sensor)
            sigma = judged.sigma.sense[mode, sensor]
            name = f"sensor {sensor} in mode {mode}"
            figures += _moved(f"{name}, in phase", moved.real, sigma.real, 100.0, "%")
            figures += _moved(f"{name}, in quadrature", moved.imag, sigma.imag, 100.0, "%")
    return figures


def draw(touched: Touched, judged: Judged, path: Path, *, source: str = "") -> None:
    """Draw how far positions move over the plate, and the map's change. Raises HapticdError."""
    modes = touched.header.modes
    figure, axes = plotting.subplots(4.0 * (1 + modes.M), 4.0, 1, 1 + modes.M, source=source)
    grid = np.stack(
        np.meshgrid(*(_DRAWN * np.linspace(axis[0], axis[-1], 9) for axis in (modes.x_mm, modes.y_mm))), axis=-1
    )
    matrix, offset_mm = judged.fitted.affine
    moved_mm = grid @ matrix.T + offset_mm - grid
    plot = axes[0][0]
    for track in touched.tracks:
        plot.plot(*track.xy_mm.T, color="lightgrey", lw=0.5, zorder=0)
    plot.quiver(
        *np.moveaxis(grid, -1, 0), *np.moveaxis(moved_mm * _ENLARGED, -1, 0), angles="xy", scale_units="xy", scale=1
    )
    plot.set(aspect="equal", xlabel="x, mm", ylabel="y, mm")
    largest_mm = float(np.hypot(*np.moveaxis(moved_mm, -1, 0)).max())
    plot.set_title(f"positions move by up to {largest_mm:.2f} mm (drawn x{_ENLARGED:g})", fontsize=9)
    for mode in range(modes.M):
        _draw_map(axes[0][1 + mode], figure, modes, judged, mode)
    plotting.save(figure, path, **PICTURE)


def _draw_map(plot: Any, figure: Any, modes: ModeShapes, judged: Judged, mode: int) -> None:
    plot.set_title(f"map of mode {mode}, change", fontsize=9)
    if judged.waves is None:
        plotting.mark_empty(plot, "unchanged")
        plot.set_xticks([])
        return
    change = judged.waves.on_grid(judged.calibration.waves, modes.x_mm, modes.y_mm)[mode]
    most = float(np.abs(change).max())
    edges = (modes.x_mm[0], modes.x_mm[-1], modes.y_mm[0], modes.y_mm[-1])
    image = plot.imshow(
        change, origin="lower", extent=edges, cmap=plotting.stepped("RdBu_r", 15), vmin=-most, vmax=most
    )
    figure.colorbar(image, ax=plot, shrink=0.7)


def _add_recording(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "recordings",
        type=Path,
        nargs="*",
        metavar="RECORDING",
        help="of touches, with record.telemetry_hz = 500; of several sessions best, the newest last",
    )
    parser.add_argument(
        "--guided", action="store_true", help="record a minute on the running service, and say where to touch"
    )
    parser.add_argument("--endpoint", metavar="DIR", help="with --guided: the service's runtime directory")
    parser.add_argument(
        "--sim", dest="sim_guided", action="store_true", help="with --guided: simulated fingers on a simulated plate"
    )
    parser.add_argument("--seed", type=whole(0), default=1, help="of the simulated fingers (default 1)")


def _is_simulated(options: argparse.Namespace) -> bool:
    return bool(options.sim_guided) if options.guided else any(map(is_simulated, options.recordings))


STEP = Step(
    name="touch",
    order=None,
    summary="correct pad, sensors and map by a recording of touches",
    todo="correct pad, sensors and map by touches (--guided, or RECORDING)",
    example="--guided --out DIR",
    arguments=(_add_recording,),
    check=check,
    run=run,
    files=(CALIBRATION_FILE, MODES_FILE, RECORDING_FILE),
    is_simulated=_is_simulated,
)
