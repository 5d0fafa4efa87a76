"""`hapticd plate --contacts`: plates, drives and numbers of modes compared by the contrast of whole fingertips."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ..design.contact_map import contact_map
from ..design.contact_pairs import surfaces
from ..design.contact_search import (
    FARTHEST_HZ,
    Q_FACTOR,
    RADIUS_MM,
    REACH_UM,
    SEED,
    ContactDesign,
    Drive,
    search,
)
from ..design.contact_tolerances import ENOUGH_FRAC, ToleranceStudy, tolerance_study
from ..errors import CalibrationError, UsageError
from ..files import outputs, plotting
from . import plate_arguments, plate_felt, plate_files, plate_patches, plate_verdict
from .arguments import number, whole
from .plate_arguments import DRIVES
from .plate_patches import Placement
from .plate_verdict import Motion, verdict
from .progress import Progress

TOML = (".toml",)
ROWS = 15
CELL_IN = 2.9  # of a mode's picture
CELLS = 61  # per side of the picture's map
_CONTACTS = (
    "modes",
    "drive",
    "config",
    "glass",
    "tolerances",
    "seed",
    "q",
    "reach",
    "radius",
    "farthest",
    "patch",
    "place",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add --contacts and what belongs to it. Values are None without their option, so that they can be refused."""
    group = parser.add_argument_group("whole fingertips")
    group.add_argument(
        "--contacts",
        action="store_true",
        help="compare plates by the contrast of whole fingertips; --size, --thickness and --modes may be ranges, such "
        "as 150..240 (every 10 mm), 2..4 (every 0.5 mm) and 4..6; --material may name several, as in glass/steel",
    )
    plate_felt.add_argument(group)
    group.add_argument("--modes", metavar="N", help="driven modes, 2 .. 8 (default 4)")
    group.add_argument("--drive", metavar="HZ", help=f"drive frequency, or the range to search (default {DRIVES})")
    group.add_argument("--q", type=number(1.0, 1e5), metavar="Q", help=f"quality of the modes (default {Q_FACTOR:g})")
    group.add_argument(
        "--reach",
        type=number(0.01, 100.0),
        metavar="UM",
        help=f"of an amplifier, at a mode's resonance (default {REACH_UM:g})",
    )
    group.add_argument(
        "--radius", type=number(0.1, 15.0), metavar="MM", help=f"of a contact (default {RADIUS_MM:g} mm)"
    )
    group.add_argument(
        "--patch",
        action="append",
        metavar="X,Y,AxBxC",
        help="a piezoelectric patch glued at X,Y of AxB mm, C mm thick: its mass and stiffness count; repeat for more",
    )
    group.add_argument(
        "--place",
        metavar="AxBxC",
        help="place a patch and a sensor per mode of AxB mm, C mm thick, along the edges, and four stamps; with --felt "
        "the sizes of patches to choose from, such as 10x10x0.5/20x10x0.3",
    )
    group.add_argument(
        "--farthest",
        type=number(1.0, 1000.0),
        metavar="HZ",
        help=f"of a driven mode from the drive (default {FARTHEST_HZ:g}; the firmware controls 300)",
    )
    group.add_argument(
        "--tolerances",
        type=whole(1, 10000),
        metavar="N",
        help="also judge N random plates around the best: edges within 0.1 mm, modulus 2 %%, thickness 1 %% (with "
        "--felt 0.2 mm), patches 0.5 mm",
    )
    group.add_argument("--seed", type=whole(0, 2**31 - 1), metavar="N", help=f"of random pairs and plates ({SEED})")
    outputs.add_file(
        parser, "--glass", TOML, group=group, metavar="F.toml", help="the best plate, for --plate of simulated plates"
    )
    outputs.add_file(
        parser, "--config", TOML, group=group, metavar="F.toml", help="configuration for the best plate, with --out"
    )


def refuse_without_contacts(options: argparse.Namespace) -> None:
    """Raise UsageError for an option that needs --contacts or --felt."""
    for name in _CONTACTS:
        if getattr(options, name) is not None:
            raise UsageError(f"--{name}: belongs to --contacts and --felt: add one of them.")


def run(options: argparse.Namespace) -> ContactDesign:
    """Print the table and the verdict, write JSON, configuration and picture; return the best design.

    Raises HapticdError.
    """
    if options.config is not None and options.out is None:
        raise UsageError("--config: names the plate's mode file: add --out F.npz.")
    if options.glass is not None and options.q is not None:
        raise UsageError(f"--glass: a simulated plate has a quality of {Q_FACTOR:g}: omit --q.")
    counts = plate_arguments.modes("4" if options.modes is None else options.modes)
    drive_hz = plate_arguments.span(DRIVES if options.drive is None else options.drive, "--drive", 100.0, 1e6)
    plates = plate_arguments.plates(options)
    drive = Drive(
        Q_FACTOR if options.q is None else options.q,
        REACH_UM if options.reach is None else options.reach,
        RADIUS_MM if options.radius is None else options.radius,
        farthest_hz=FARTHEST_HZ if options.farthest is None else options.farthest,
    )
    seed = SEED if options.seed is None else options.seed
    try:
        with Progress(f"{len(plates)} plates" if len(plates) > 1 else "the plate's drives") as progress:
            designs = search(plates, counts, drive_hz, drive, seed=seed, progress=progress)
    except ValueError as error:
        raise CalibrationError(f"This plate cannot be designed: {error}") from None
    if not designs:
        raise CalibrationError(
            f"No plate has {min(counts)} modes near a drive of {drive_hz[0]:g} to {drive_hz[1]:g} Hz: "
            "give another --drive, a larger --size, more --farthest, or fewer --modes."
        )
    best = designs[0]
    placement = None if options.place is None else _placed(best, drive, options.place)
    study = None
    if options.tolerances is not None:
        with Progress(f"{options.tolerances} random plates") as progress:
            study = tolerance_study(best, drive, options.tolerances, seed=seed, progress=progress)
    glass = None if options.glass is None else _glass(best, drive)
    motion = _motion(best, drive)
    judged = verdict(best, drive, motion)
    out = sys.stderr if options.json == outputs.STDOUT else sys.stdout
    print(_table(designs), judged, sep="\n\n", file=out)
    if placement is not None:
        print("", plate_patches.table(placement, best), sep="\n", file=out)
    if study is not None:
        print(_study_line(study), file=out)
    if options.json is not None:
        _write_json(designs, drive, motion, study, placement, options.json)
    if options.config is not None:
        plate_files.write_config(best, drive.radius_mm, f"# {judged}", options.config, options.out)
    if glass is not None:
        outputs.write_text("\n".join((f"# {judged}", *glass)) + "\n", options.glass)
    if options.plot is not None:
        draw(best, drive, options.plot, placement)
    return best


def _glass(design: ContactDesign, drive: Drive) -> list[str]:
    """Return the lines of --glass. Raises CalibrationError."""
    try:
        return plate_files.glass_lines(design, drive.reach_um)
    except ValueError as error:
        raise CalibrationError(f"--glass: {error}.") from None


def _motion(design: ContactDesign, drive: Drive) -> Motion | str:
    """Return what fingers in motion get, or why that is unknown."""
    try:
        with Progress("fingers in motion on the best plate") as progress:
            return plate_verdict.simulate(design, drive, progress)
    except ValueError as error:
        return str(error).rstrip(".")


def _placed(design: ContactDesign, drive: Drive, text: str) -> Placement:
    try:
        dimensions_mm = plate_arguments.dimensions_mm(text)
    except (ValueError, argparse.ArgumentTypeError):
        raise UsageError(f"--place: {text!r} is no patch: write its dimensions in mm, such as 10x10x0.3.") from None
    try:
        return plate_patches.place(design, drive, dimensions_mm)
    except ValueError as error:
        raise UsageError(f"--place: {error}") from None


# --- outputs ----------------------------------------------------------------------------------------------------


def _table(designs: Sequence[ContactDesign]) -> str:
    lines = ["   static bounds, for fingers at rest"]
    lines += ["   plate mm             drive Hz modes farthest Hz slip um still um contrast median tenth  bound"]
    for place, one in enumerate(designs[:ROWS], 1):
        size = "x".join(f"{edge_mm:g}" for edge_mm in (*one.plate.size_mm, one.plate.thickness_mm))
        lines.append(
            f"{place:>2} {size:<20} {one.drive_hz:8.0f} {len(one.shapes):5} {one.farthest_hz:11.0f} {one.slip_um:7.2f} "
            f"{one.still_um:8.3f} {one.contrast:8.1f} {one.contrast_median:6.1f} {one.contrast_tenth:5.1f} "
            f"{one.bound:6.1f}"
        )
    if len(designs) > ROWS:
        lines.append(f"   and {len(designs) - ROWS} more")
    return "\n".join(lines)


def _study_line(study: ToleranceStudy) -> str:
    tenth, median = np.quantile(study.contrast_frac, (0.1, 0.5))
    return (
        f"Within tolerance {100 * study.enough_frac:.1f} % of {len(study.contrast_frac)} plates reach two thirds of "
        f"this static contrast (median {100 * median:.0f} % of it, worst tenth {100 * tenth:.0f} %; "
        f"slip {100 * np.median(study.slip_frac):.0f} %)."
    )


def _write_json(
    designs: Sequence[ContactDesign],
    drive: Drive,
    motion: Motion | str,
    study: ToleranceStudy | None,
    placement: Placement | None,
    file: str,
) -> None:
    table: dict[str, Any] = {"drive": asdict(drive), "designs": [_as_json(one) for one in designs]}
    if isinstance(motion, Motion):
        table["motion"] = {**asdict(motion), "contrast": motion.contrast}
    else:
        table["motion"] = {"unknown": motion}
    if placement is not None:
        table["placement"] = plate_patches.as_json(placement)
    if study is not None:
        table["tolerances"] = {
            "plates": len(study.contrast_frac),
            "enough": ENOUGH_FRAC,
            "share": study.enough_frac,
            "contrast_frac": study.contrast_frac.tolist(),
            "slip_frac": study.slip_frac.tolist(),
        }
    outputs.write_text(json.dumps(table, indent=2) + "\n", file)


def _as_json(design: ContactDesign) -> dict[str, Any]:
    names = ("drive_hz", "frequency_hz", "limits_um", "farthest_hz", "slip_um", "still_um", "contrast")
    figures = {name: getattr(design, name) for name in (*names, "contrast_median", "contrast_tenth", "bound", "score")}
    return {**asdict(design.plate), "modes": [shape.name for shape in design.shapes], **figures}


def draw(design: ContactDesign, drive: Drive, path: Path, placement: Placement | None = None) -> None:
    """Draw each mode with two contacts to scale, patches and stamps where there are any, and the contrast of a finger
    that slips anywhere. Raises HapticdError."""
    from matplotlib.ticker import MaxNLocator

    size_mm, count = design.plate.size_mm, len(design.shapes)
    still_mm = -size_mm[0] / 6.0, size_mm[1] / 10.0
    splines = surfaces(design.shapes)
    found = contact_map(
        splines,
        [still_mm],
        drive.target_um,
        design.limits_um,
        radius_mm=drive.radius_mm,
        size_mm=size_mm,
        cells=CELLS,
    )
    at = np.unravel_index(int(np.argmin(np.abs(found.contrast - np.median(found.contrast)))), found.contrast.shape)
    slip_mm = float(found.x_mm[at[1]]), float(found.y_mm[at[0]])
    columns = math.ceil((count + 1) / 2)
    high_in = CELL_IN * min(size_mm[1] / size_mm[0], 2.0)
    figure, axes = plotting.subplots(
        (CELL_IN + 0.2) * columns + 1.6, 2.0 * (high_in + 0.4) + 1.5, 2, columns, sharex=True, sharey=True
    )
    extent = (-size_mm[0] / 2, size_mm[0] / 2, -size_mm[1] / 2, size_mm[1] / 2)
    x_mm, y_mm = (np.linspace(-edge_mm / 2, edge_mm / 2, 161) for edge_mm in size_mm)
    signed, scale = plotting.stepped("RdBu", 20), plotting.stepped("viridis", 20)
    for axis, shape, hz in zip(axes.flat, design.shapes, design.frequency_hz, strict=False):
        modes = axis.imshow(shape.on_grid(x_mm, y_mm), origin="lower", extent=extent, cmap=signed, vmin=-1, vmax=1)
        axis.set_title(f"{shape.name}: {hz - design.drive_hz:+.0f} Hz", fontsize=9)
        _mark(axis, still_mm, slip_mm, drive.radius_mm)
        if placement is not None:
            _mark_placement(axis, placement)
    contrast = axes.flat[count].imshow(
        np.log10(found.contrast), origin="lower", extent=extent, cmap=scale, vmin=0.0, vmax=2.0
    )
    axes.flat[count].set_title("contrast, one still (orange)", fontsize=9)
    _mark(axes.flat[count], still_mm, None, drive.radius_mm)
    for axis in axes.flat[count + 1 :]:
        axis.set_axis_off()
    for axis in axes[-1]:
        axis.set_xlabel("x, mm")
        axis.xaxis.set_major_locator(MaxNLocator(4, prune="both"))
    for axis in axes[:, 0]:
        axis.set_ylabel("y, mm")
        axis.yaxis.set_major_locator(MaxNLocator(4, prune="both"))  # labels at an edge would meet the next picture's
    figure.colorbar(
        modes, ax=axes, location="bottom", label="mode shape; its largest value is 1", shrink=0.8, aspect=50
    )
    bar = figure.colorbar(contrast, ax=axes, label="contrast: slip over still", ticks=[0, 1, 2], shrink=0.8, aspect=30)
    bar.ax.set_yticklabels(["1", "10", "100"])
    figure.legend(handles=_marks(placement), loc="outside upper left", ncols=5, fontsize=8, frameon=False)
    plotting.save(figure, path, dpi=80, colours=96)


def _marks(placement: Placement | None) -> list[Any]:
    """Return a line of the legend for each mark."""
    from matplotlib.lines import Line2D

    marks = [("o", "tab:orange", "still contact"), ("o", "tab:cyan", "slipping contact")]
    if placement is not None:
        marks += [("s", "black", "patch"), ("D", "black", "sensor"), ("x", "black", "stamp")]
    return [
        Line2D([], [], ls="", marker=marker, color=colour, fillstyle="none", label=label)
        for marker, colour, label in marks
    ]


def _mark(axis: Any, still_mm: tuple[float, float], slip_mm: tuple[float, float] | None, radius_mm: float) -> None:
    from matplotlib.patches import Circle

    for place_mm, colour in ((still_mm, "tab:orange"), (slip_mm, "tab:cyan")):
        if place_mm is not None:
            axis.add_patch(Circle(place_mm, radius_mm, fill=False, edgecolor=colour, linewidth=1.8))


def _mark_placement(axis: Any, placement: Placement) -> None:
    for patches, marker in ((placement.drive, "s"), (placement.sense, "D")):
        axis.plot(*patches.places_mm.T, marker, markersize=6, color="black", fillstyle="none")
    axis.plot(*np.array([stamp[:2] for stamp in placement.stamps]).reshape(-1, 2).T, "x", markersize=5, color="black")
