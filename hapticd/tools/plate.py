"""`hapticd plate`: plates with patches, compared by the share of places where friction is felt as asked.

Theory (`design.glued_plate`): a free, homogeneous plate with its patches. A real one is supported, and its frequencies
differ by some per cent: measure its modes with `hapticd calibrate modes`. The mode file is for trials before that.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path

from ..config import person
from ..config.sections import LEAST_MODES, MOST_MODES, PlateConfig
from ..core.friction import FrictionCurve
from ..design.campaign import TaskRunner
from ..design.felt_search import ORDERABLE, FeltDesign, Kit, search
from ..design.felt_tolerances import felt_tolerances
from ..design.glued_plate import GluedPlate, Patch
from ..design.materials import find_material
from ..design.mode_choice import FARTHEST_HZ, SEED, FeltTask
from ..design.plate_bounds import bounds
from ..errors import CalibrationError, UsageError
from ..formats.mode_map import FORMATS
from . import campaigns, outputs, plate_files, plate_places, plate_tables, plate_verdict
from .arguments import add_command, number, whole
from .map import program as map_program
from .plate_verdict import FeltMotion
from .progress import progress_bar

TARGETS = "1um,0um"
SIZES, THICKNESSES, MODES = "200..220", "2..3", "8"  # searched without options: a minute
DRIVES = "27000..33000"  # in Hz: 30 kHz is above hearing, and amplifiers and patches are made for it
SIZE_STEP_MM, THICKNESS_STEP_MM = 10.0, 0.5
MOST_PLATES = 2000
COPIED = 3  # best plates as drawn, of which --tolerances takes the best as they may be made
MOST_FINGERS = 5
MOST_TARGET_UM = 20.0
TOML = (".toml",)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = (
        f"{parser.epilog}\n\n"
        "materials: glass, float, pilkington, borosilicate, aluminium, steel (hapticd/design/materials.py: sources)"
    )
    parser.add_argument(
        "--felt",
        nargs="?",
        const=TARGETS,
        default=TARGETS,
        metavar="TARGETS",
        help="compare plates with their patches by the share of places where each finger's friction is felt as asked "
        f"of it: 0 .. 1 as in clients, or amplitudes, such as 0.2,1 or {TARGETS} (the default)",
    )
    size = f"width x depth, or a range of edges, every 10 mm (default {SIZES})"
    parser.add_argument("--size", default=SIZES, metavar="MMxMM", help=size)
    thickness = f"or a range, every 0.5 mm (default {THICKNESSES})"
    parser.add_argument("--thickness", default=THICKNESSES, metavar="MM", help=thickness)
    material = "see below, or GPa,Poisson,kg/m3, or several, as in glass/steel (default glass)"
    parser.add_argument("--material", default="glass", metavar="NAME", help=material)
    modes = f"driven modes, 2 .. 8, or a range such as 4..8 (default {MODES})"
    parser.add_argument("--modes", default=MODES, metavar="N", help=modes)
    drive = f"drive frequency, or the range to search (default {DRIVES})"
    parser.add_argument("--drive", default=DRIVES, metavar="HZ", help=drive)
    parser.add_argument(
        "--patch",
        action="append",
        metavar="X,Y,AxBxC",
        help="a piezoelectric patch glued at X,Y of AxB mm, C mm thick, one for each mode: judge a plate that has them",
    )
    parser.add_argument(
        "--place", metavar="AxBxC", help="sizes of patches to choose from and to place, such as 10x10x0.5/20x10x0.3"
    )
    parser.add_argument(
        "--tolerances",
        type=whole(1, 10000),
        metavar="N",
        help="of the best three take the one with most felt on nine in ten of N copies as they may be made: "
        "thickness 0.2 mm off, edges cut to it within 0.1 mm, modulus 2 %%, patches 0.5 mm, glue; each is scanned and "
        "set up, in 4 to 10 s",
    )
    parser.add_argument(
        "--friction",
        type=Path,
        metavar="F.toml",
        help="a configuration whose plate.friction_curve is what these fingers feel, as `calibrate friction` measures "
        "it (default: the usual finger's)",
    )
    seed = f"of random places and plates (default {SEED})"
    parser.add_argument("--seed", type=whole(0, 2**31 - 1), default=SEED, metavar="N", help=seed)
    campaigns.add_arguments(parser)
    outputs.add_file(parser, "--glass", TOML, metavar="F.toml", help="the best plate, for --plate of simulated plates")
    outputs.add_file(parser, "--out", FORMATS, metavar="F.npz", help="write the best plate's shapes as a mode file")
    outputs.add_file(
        parser, "--plot", outputs.PICTURE, metavar="F.png", help="draw the shapes, the patches, sensors and stamps"
    )
    outputs.add_json(parser, "the compared plates")
    parser.set_defaults(command=run)
    actions = parser.add_subparsers(title="actions", metavar="ACTION")
    mapped = "map where fingers feel the frictions asked of them"
    map_program.add_arguments(add_command(actions, "map", mapped, "--plate wide --finger -30,20 --plot map.png"))


def run(options: argparse.Namespace) -> None:
    """Print the tables and the verdict, and write the outputs. Raises HapticdError."""
    if options.patch is not None and options.place is not None:
        raise UsageError("--place: --patch says where the patches are: omit one of them.")
    felt = PlateConfig()
    if options.friction is not None:
        felt, _ = person.load(options.friction, felt)
    task = FeltTask((), curve_um=felt.friction_curve, floor_frac=felt.friction_floor_frac)
    targets_um = _targets_um(options.felt, task.curve)
    task = replace(task, targets_um=targets_um, farthest_hz=FARTHEST_HZ, seed=options.seed)
    campaign = campaigns.of(options)
    designs = _searched(options, task, campaign)
    studies = felt_tolerances(designs[:COPIED], task, options.tolerances, campaign) if options.tolerances else []
    designs = [one.design for one in studies] + designs[len(studies) :]
    best = designs[0]
    try:
        with progress_bar("fingers in motion on the best plate") as progress:
            motion: FeltMotion | str = plate_verdict.simulate_felt(best, task, felt, progress)
    except ValueError as error:
        motion = str(error).rstrip(".")
    asked = bounds(best, task.q_factor)
    judged = plate_verdict.felt_verdict(best, asked, motion, *studies[:1])
    placement = plate_places.place(best)
    out = outputs.table_stream(options.json)
    print(plate_tables.designs_table(designs, studies), plate_tables.patch_table(best), file=out, sep="\n")
    print(plate_places.table(placement, best), plate_tables.mode_table(best), *judged, sep="\n", file=out)
    if options.json is not None:
        plate_tables.write_json(designs, task, asked, motion, studies, placement, options.json)
    heading = f"# {judged[-1]}"
    if options.glass is not None:
        try:
            lines = plate_files.glass_lines(best, tuple(round(um, 3) for um in best.reach_um))
        except ValueError as error:
            raise CalibrationError(f"--glass: {error}.") from None
        outputs.write_text("\n".join((heading, *lines)) + "\n", options.glass)
    if options.plot is not None:
        plate_places.draw(best, placement, options.plot)
    if options.out is not None:
        plate_files.write_map(best.shapes, best.plate.size_mm, options.out)


def _searched(options: argparse.Namespace, task: FeltTask, campaign: TaskRunner) -> list[FeltDesign]:
    """Return the designs, the best first. Raises HapticdError."""
    counts = _modes(options.modes)
    drive_hz = _span(options.drive, "--drive", 100.0, 1e6)
    plates, kits = _plates(options), _kits(options.place)
    try:
        designs = search(plates, counts, drive_hz, task, kits, campaign)
    except ValueError as error:
        raise CalibrationError(f"This plate cannot be designed: {error}") from None
    if not designs:
        raise CalibrationError(
            f"No plate with its patches has {min(counts)} modes within {task.farthest_hz:g} Hz of a drive of "
            f"{drive_hz[0]:g} to {drive_hz[1]:g} Hz: give another --drive, a larger --size, smaller "
            "patches, or fewer --modes."
        )
    return designs


def _targets_um(text: str, curve: FrictionCurve) -> tuple[float, ...]:
    """Return the amplitudes asked; a number without a unit is a friction by the curve. Raises UsageError."""
    found = []
    try:
        for part in text.split(","):
            if part.endswith("um"):
                found.append(number(0.0, MOST_TARGET_UM)(part.removesuffix("um")))
            else:
                found.append(curve.amplitude_um(number(0.0, 1.0)(part)))
    except argparse.ArgumentTypeError as error:
        raise UsageError(f"--felt: {error}: write frictions such as 0.2,1 or amplitudes such as 1um,0um.") from None
    if not 2 <= len(found) <= MOST_FINGERS or max(found) <= 0.0:
        raise UsageError(f"--felt: {text!r} must be of 2 to {MOST_FINGERS} fingers, one of which slips.")
    return tuple(found)


def _kits(text: str | None) -> list[Kit]:
    if text is None:
        return list(ORDERABLE)
    try:
        return [_dimensions_mm(part) for part in text.split("/")]
    except (ValueError, argparse.ArgumentTypeError):
        raise UsageError(f"--place: {text!r}: write sizes of patches in mm, such as 10x10x0.3/20x10x0.5.") from None


def _plates(options: argparse.Namespace) -> list[GluedPlate]:
    """Return the plates to compare, each size once: 200 x 150 is 150 x 200 turned."""
    try:
        materials = [find_material(name) for name in options.material.split("/")]
    except ValueError as error:
        raise CalibrationError(f"This plate cannot be designed: {error}") from None
    thicknesses_mm = _values(options.thickness, "--thickness", THICKNESS_STEP_MM, 0.01, 100.0)
    edges = options.size.lower().split("x")
    if len(edges) > 2:
        raise UsageError(f"--size: {options.size!r} has more than two edges: write 200x200, 150..240 or 150..240x200.")
    spans = [_values(edge, "--size", SIZE_STEP_MM, 10.0, 1000.0) for edge in edges]
    if len(spans) == 1:
        sizes = [(width_mm, depth_mm) for width_mm in spans[0] for depth_mm in spans[0] if depth_mm <= width_mm]
    else:
        sizes = [(width_mm, depth_mm) for width_mm in spans[0] for depth_mm in spans[1]]
    patches = tuple(_patch(text) for text in options.patch or ())
    plates = [
        GluedPlate(size, thick_mm, of, patches) for size in sizes for thick_mm in thicknesses_mm for of in materials
    ]
    if len(plates) > MOST_PLATES:
        raise UsageError(f"--size: {len(plates)} plates are too many: narrow the ranges to {MOST_PLATES}.")
    return plates


def _dimensions_mm(text: str) -> tuple[float, float, float]:
    """Return a patch's width, depth and thickness. Raises ValueError and ArgumentTypeError."""
    width_mm, depth_mm, thickness_mm = (number(0.01, 1000.0)(part) for part in text.lower().split("x"))
    return width_mm, depth_mm, thickness_mm


def _patch(text: str) -> Patch:
    try:
        x_mm, y_mm, dimensions = text.split(",")
        width_mm, depth_mm, thickness_mm = _dimensions_mm(dimensions)
        place_mm = number(-500.0, 500.0)(x_mm), number(-500.0, 500.0)(y_mm)
    except (ValueError, argparse.ArgumentTypeError):
        raise UsageError(
            f"--patch: {text!r} is no patch: write position and dimensions in mm, such as 90,90,10x10x0.3."
        ) from None
    return Patch(*place_mm, (width_mm, depth_mm), thickness_mm)


def _modes(text: str) -> list[int]:
    """Return the numbers of modes of --modes. Raises UsageError."""
    values = _values(text, "--modes", 1.0, LEAST_MODES, MOST_MODES)
    if any(value != round(value) for value in values):
        raise UsageError(f"--modes: {text!r} is not a whole number, or a range of them such as 4..6.")
    return [round(value) for value in values]


def _values(text: str, name: str, step: float, low: float, high: float) -> list[float]:
    """Return one number, or those of a range such as 150..240, whose last is included."""
    first, last = _span(text, name, low, high)
    return [first + step * index for index in range(math.floor((last - first) / step + 1e-9) + 1)]


def _span(text: str, name: str, low: float, high: float) -> tuple[float, float]:
    """Return both ends of a range such as 150..240, of one number twice. Raises UsageError."""
    parsed = number(low, high)
    try:
        ends = [parsed(part) for part in text.split("..")]
    except argparse.ArgumentTypeError as error:
        raise UsageError(f"{name}: {error}.") from None
    if len(ends) > 2 or ends[-1] < ends[0]:
        raise UsageError(f"{name}: {text!r} is no range: write the lower end first, such as 150..240.")
    return ends[0], ends[-1]
