"""After the steps: correct pad, sensors and map by a recording of ordinary touches (`design.touch`)."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ...config.sections import SIMULATED
from ...core.plate.mode_shapes import ModeShapes
from ...design.touch.coverage import known_sentence, place_name
from ...design.touch.guide import GUIDED_S, places_at
from ...design.touch.judge import TouchCalibration
from ...design.touch.model import CENTROID
from ...errors import CalibrationError, HapticdError
from ...files import calibration as calibration_file
from ...files.recording.mcap_reader import open_recording
from ...sim.fingers.scenarios import LAND_S
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
from .step import PICTURE, Figure, FoundSettings, Outcome, Step, Verdict

CALIBRATION_FILE, MODES_FILE = "touch-calibration.toml", "touch-modes.npz"
RECORDING_FILE = "touch.mcap"  # of guided touches
_POSE = (  # name, unit's size, unit
    ("x", 1.0, "mm"),
    ("y", 1.0, "mm"),
    ("rotation", math.degrees(1.0), "degrees"),
    ("scale along x", 100.0, "%"),
    ("scale along y", 100.0, "%"),
)
_CONTACTS = (  # section, key, figure, unit
    ("solver", "contact_radius_mm", "radius of a contact, mean", "mm"),
    ("trackpad", "ellipse_scale", "scale of the pad's ellipses", ""),
    ("trackpad", "ellipse_offset_mm", "offset of their axes", "mm"),
)
CLIENT = "calibrate-touch"  # of guided touches
SIMULATED_PLATE = "fingertip"
TELEMETRY_HZ = 500
_SLIPPERY_UM, _STICKY_UM = 1.0, 0.0
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
        record(recording, is_simulated=options.sim, seed=options.seed, endpoint=options.endpoint)
        if is_simulated(recording) and not options.sim:
            raise CalibrationError("The running service has a simulated plate: give --sim, which needs no service.")
    touched = joined({path: read(path) for path in recordings})
    judged = judged_by(touched)
    settings = saved(touched, judged, options.out)
    names = ", ".join(path.name for path in recordings)
    draw(touched, judged, options.out / "touch.png", source=plotting.plain(names))
    return verdict(judged, settings, has_sensors=has_sensors(touched), is_simulated=options.sim)


def saved(touched: Touched, judged: TouchCalibration, directory: Path) -> FoundSettings:
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


def verdict(judged: TouchCalibration, settings: FoundSettings, *, has_sensors: bool, is_simulated: bool) -> Verdict:
    """Return what moved, by how much, one sigma, and whether it is adopted."""
    moved = [
        (f"pad's {name}", unit * judged.fitted.pad[place], unit * judged.sigma.pad[place], text)
        for place, (name, unit, text) in enumerate(_POSE)
    ]
    latency = "pad's latency, with the centroid's shift"
    moved.append((latency, 1e3 * judged.latency_s, 1e3 * judged.latency_sigma_s, "ms"))
    moved.append(("centroid's shift", judged.fitted.pad[CENTROID], judged.sigma.pad[CENTROID], "mm"))
    change = 100.0 * (judged.fitted.sense - np.eye(len(judged.fitted.sense)))
    for place in list(np.ndindex(*change.shape))[1:]:  # the first, in its own mode, stands for all gains
        name, error = "sensor {1} in mode {0}".format(*place), 100.0 * judged.sigma.sense[place]
        moved.append((f"{name}, in phase", change[place].real, error.real, "%"))
        moved.append((f"{name}, in quadrature", change[place].imag, error.imag, "%"))
    figures = [Figure("touching", judged.touched_s, "s")]
    for name, value, sigma, text in moved:
        figures += [Figure(name, float(value), text), Figure(f"{name}, one sigma", float(sigma), text)]
    if judged.waves is not None:
        rms = judged.waves.rms(judged.calibration.waves).tolist()
        figures += [Figure(f"map of mode {mode}, change RMS", value, "") for mode, value in enumerate(rms)]
    if judged.map_sigma is not None:
        for (row, column), sigma in np.ndenumerate(judged.map_sigma):
            figures.append(Figure(f"map, one sigma, {place_name(row, column)}", 100.0 * float(sigma), "% of the peak"))
    figures.append(Figure("held-out residual falls by", 100.0 * judged.gain_frac, "%"))
    figures.append(Figure("held-out residual falls by, map", 100.0 * judged.map_gain_frac, "%"))
    found = ((text, settings.get(section, {}).get(key), unit) for section, key, text, unit in _CONTACTS)
    figures += [Figure(text, value, unit) for text, value, unit in found if value is not None]
    is_adopted = not judged.refusal
    is_sense_moved = has_sensors and not np.array_equal(judged.calibration.sense, np.eye(len(change)))
    parts = {
        "pad": is_adopted,
        "sensors": is_adopted and is_sense_moved,
        "map": is_adopted and judged.waves is not None,
        "the contacts' size": "solver" in settings,
    }
    adopted = ", ".join(part for part, is_adopted in parts.items() if is_adopted)
    lacking = "" if has_sensors else "The sensors' weights need `hapticd calibrate resonance` before the recording."
    known = "" if judged.map_sigma is None else known_sentence(judged.map_sigma)
    reasons = [judged.refusal] if judged.refusal else [lacking, judged.map_refusal + known]
    sentence = " ".join(filter(None, [f"Adopted: {adopted}." if adopted else "Nothing is adopted.", *reasons]))
    outcome = Outcome.PASS if adopted else Outcome.FAIL
    return Verdict("touch", outcome, sentence, tuple(figures), settings, is_simulated)


def draw(touched: Touched, judged: TouchCalibration, path: Path, *, source: str = "") -> None:
    """Draw how far positions move over the plate, and the map's change. Raises HapticdError."""
    modes = touched.header.modes
    figure, ((plot, *maps),) = plotting.subplots(4.0 * (1 + modes.M), 4.0, 1, 1 + modes.M, source=source)
    x_mm, y_mm = (_DRAWN * np.linspace(axis[0], axis[-1], 9) for axis in (modes.x_mm, modes.y_mm))
    grid = np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)
    matrix, offset_mm = judged.fitted.affine
    moved_mm = grid @ matrix.T + offset_mm - grid
    for track in touched.tracks:
        plot.plot(*track.xy_mm.T, color="lightgrey", lw=0.5, zorder=0)
    plot.quiver(*grid.T, *_ENLARGED * moved_mm.T, angles="xy", scale_units="xy", scale=1)
    plot.set(aspect="equal", xlabel="x, mm", ylabel="y, mm")
    largest_mm = float(np.hypot(*moved_mm.T).max())
    plot.set_title(f"positions move by up to {largest_mm:.2f} mm (drawn x{_ENLARGED:g})", fontsize=9)
    for mode, plot in enumerate(maps):
        _draw_map(plot, figure, modes, judged, mode)
    plotting.save(figure, path, **PICTURE)


def _draw_map(plot: Any, figure: Any, modes: ModeShapes, judged: TouchCalibration, mode: int) -> None:
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


class Guide:
    """Guidance where to touch, from the recording's start on; `begin` is called then."""

    def __init__(
        self,
        begin: Callable[[], None],
        say: Callable[[str], None] = lambda text: print(text, flush=True),
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._begin, self._say, self._now_s = begin, say, now_s
        self._t_begun_s: float | None = None
        self._said_s = -1  # whole seconds after the start: places change at such

    def notify(self, text: str) -> None:
        """Pass on what the recorder says."""
        from ..record import attach

        self._say(text)
        if text != attach.WAITING and self._t_begun_s is None:
            self._t_begun_s = self._now_s()
            self._begin()

    def is_ended(self) -> bool:
        """Say the next place each second; return whether the guided time is over."""
        if self._t_begun_s is None:
            return False
        t_s = self._now_s() - self._t_begun_s
        if int(t_s) > self._said_s:
            self._said_s = int(t_s)
            self._say(places_at(t_s).sentence(max(GUIDED_S - t_s, 0.0)))
        return t_s >= GUIDED_S


def record(path: Path, *, is_simulated: bool, seed: int, endpoint: str | None = None) -> None:
    """Record to `path`, replacing what an earlier run wrote. Raises HapticdError."""
    import hapticd_client

    from ...config.sections import Config, RecordConfig
    from ...sim.plate.ground_truth import PlateSettings
    from ...sim.settings import Settings
    from ..record import attach, simulated  # late, with the recorder and the daemon

    path.unlink(missing_ok=True)
    if is_simulated:
        plate = PlateSettings.of(SIMULATED_PLATE)
        settings = Settings(config=Config(record=RecordConfig(telemetry_hz=TELEMETRY_HZ)), plate=plate)
        print(f"Simulated fingers follow the guide for {GUIDED_S:.0f} s.", file=sys.stderr, flush=True)
        simulated.run("guided", path, settings=settings, seed=seed, seconds=GUIDED_S + LAND_S)
        return
    try:
        with hapticd_client.Client(endpoint, name=CLIENT) as client:
            guide = Guide(lambda: _lay(client))
            directory = None if endpoint is None else Path(endpoint)
            print(attach.record(path, directory, None, notify=guide.notify, is_ended=guide.is_ended), flush=True)
    except hapticd_client.HapticdError as error:
        raise HapticdError(str(error)) from None


def _lay(client: Any) -> None:
    """Make the plate slippery on one side of a line on which no two guided places lie, and sticky on the other."""
    from hapticd_client import Polygon

    half_x, half_y = (size_mm / 2.0 for size_mm in client.plate()["size_mm"])
    upper, lower = (-half_y / 2.0, half_y), (half_y / 2.0, -half_y)
    left = Polygon(((-half_x, -half_y), lower, upper, (-half_x, half_y)))
    right = Polygon((lower, (half_x, -half_y), (half_x, half_y), upper))
    client.surface("slippery", left, amplitude_um=_SLIPPERY_UM)
    client.surface("sticky", right, amplitude_um=_STICKY_UM)


def _add_recording(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "recordings",
        type=Path,
        nargs="*",
        metavar="RECORDING",
        help="of touches, with record.telemetry_hz = 500; of several sessions best, the newest last",
    )
    guided = "record a minute on the running service, and say where to touch"
    parser.add_argument("--guided", action="store_true", help=guided)
    parser.add_argument("--endpoint", metavar="DIR", help="with --guided: the service's runtime directory")
    simulated = "with --guided: simulated fingers on a simulated plate"
    parser.add_argument("--sim", dest="sim_guided", action="store_true", help=simulated)
    parser.add_argument("--seed", type=whole(0), default=1, help="of the simulated fingers (default 1)")


STEP = Step(
    name="touch",
    order=None,
    summary="correct pad, sensors and map by touches (--guided, or RECORDING)",
    example="--guided --out DIR",
    arguments=(_add_recording,),
    check=check,
    run=run,
    files=(CALIBRATION_FILE, MODES_FILE, RECORDING_FILE),
    is_simulated=lambda given: given.sim_guided if given.guided else any(map(is_simulated, given.recordings)),
)
