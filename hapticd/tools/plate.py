"""`hapticd plate`: pairs of modes to drive a plate with, their shapes, and support points; with --felt, plates for
whole fingertips by friction felt as asked (`plate_felt`).

Theory (`design.glued_plate`): a free, homogeneous plate. A real one is glued and supported, and its frequencies
differ by some per cent: measure its modes with `hapticd calibrate modes`. The mode file is for trials before that.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..core.plate.mode_shapes import ModeShapes
from ..design import ModeShape
from ..design.glued_plate import GluedPlate
from ..design.materials import Material, find_material
from ..design.pairs import ModePair, mode_pairs
from ..design.stamps import Stamp, common_nodes, four_stamps
from ..errors import CalibrationError, ModesError, UsageError
from ..formats.mode_map import FORMATS
from . import outputs, plate_felt, plotting
from .arguments import POSITIVE, add_command, number, whole
from .calibrate.modes import parse_size
from .map import program as map_program

SIZE, THICKNESS = "137.5x137.5", "2"
SPAN_FRAC = 0.05  # of the frequency, to either side: the searched band
ROWS = 10  # of the tables
MAP_STEP_MM = 1.375
SPLITTING_HZ = 60.0  # largest of a pair
AMPLITUDE_UM = 4.0  # of both modes, under a stamp
DRAWN = 2  # pairs in the picture


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = (
        f"{parser.epilog}\n\n"
        "materials: glass, float, pilkington, borosilicate, aluminium, steel (hapticd/design/materials.py: sources)"
    )
    parser.add_argument("--size", metavar="MMxMM", help=f"width x depth (default {SIZE})")
    parser.add_argument("--thickness", metavar="MM", help=f"default {THICKNESS}")
    parser.add_argument(
        "--material", default="glass", metavar="NAME", help="see below, or GPa,Poisson,kg/m3 (default glass)"
    )
    parser.add_argument("--near", dest="near_hz", type=POSITIVE, default=28200.0, metavar="HZ", help="default 28200")
    parser.add_argument("--pair", type=whole(1), default=1, metavar="N", help="select a pair of the table (default 1)")
    parser.add_argument(
        "--stamp", dest="stamp_mm", type=number(0.0), default=2.0, metavar="MM", help="radius (default 2)"
    )
    outputs.add_file(parser, "--out", FORMATS, metavar="F.npz", help="write the pair's shapes as a mode file")
    outputs.add_file(
        parser,
        "--plot",
        outputs.PICTURE,
        metavar="F.png",
        help="draw the shapes, the stamps, and of --felt patches and sensors",
    )
    outputs.add_json(parser, "pairs and stamps, or the compared plates")
    plate_felt.add_arguments(parser)
    parser.set_defaults(command=run)
    actions = parser.add_subparsers(title="actions", metavar="ACTION")
    mapped = "map where fingers feel the frictions asked of them"
    map_program.add_arguments(add_command(actions, "map", mapped, "--plate wide --finger -30,20 --plot map.png"))


def run(options: argparse.Namespace) -> None:
    """Print the tables and write the outputs. Raises HapticdError."""
    if options.felt is not None:
        plate_felt.fill_in(options)
        design = plate_felt.run(options)
        if options.out is not None:
            _write_map(design.shapes, design.plate.size_mm, options.out)
        return
    plate_felt.refuse_without_felt(options)
    options.size, options.thickness = options.size or SIZE, options.thickness or THICKNESS
    size_mm = parse_size(options.size)
    if options.stamp_mm > min(size_mm) / 4.0:
        raise UsageError(f"--stamp: {options.stamp_mm:g} mm is too large: give at most a quarter of the plate's edge.")
    try:
        pairs = _pairs(options, size_mm, find_material(options.material))
    except ValueError as error:
        raise CalibrationError(f"This plate cannot be designed: {error}") from None
    if not 1 <= options.pair <= len(pairs):
        raise CalibrationError(_no_pair(options, len(pairs)))
    pair = pairs[options.pair - 1]
    nodes = common_nodes(pair.shapes, options.stamp_mm)
    chosen = four_stamps(nodes, size_mm)
    out = outputs.table_stream(options.json)
    print(_pair_table(pairs, options.pair), file=out)
    print(_stamp_table(pair, nodes, chosen, options), file=out)
    if options.json is not None:
        _write_json(pairs, pair, nodes, options.json)
    if options.out is not None:
        _write_map(pair.shapes, size_mm, options.out)
    if options.plot is not None:
        draw(pairs[:DRAWN] if pair in pairs[:DRAWN] else (pair,), pair, nodes, chosen, options.plot)


def _pairs(options: argparse.Namespace, size_mm: tuple[float, float], of: Material) -> tuple[ModePair, ...]:
    band_hz = (options.near_hz * (1.0 - SPAN_FRAC), options.near_hz * (1.0 + SPAN_FRAC))
    try:
        thickness_mm = number(0.01, 100.0)(options.thickness)
    except argparse.ArgumentTypeError as error:
        raise UsageError(f"--thickness: {error}.") from None
    modes = GluedPlate(size_mm, thickness_mm, of).modes(band_hz)
    return mode_pairs(modes, options.near_hz, SPLITTING_HZ)


def _no_pair(options: argparse.Namespace, pairs: int) -> str:
    if pairs == 0:
        near = f"within {100 * SPAN_FRAC:g} % of {options.near_hz:g} Hz no two modes lie {SPLITTING_HZ:g} Hz apart"
        return f"No pair: {near}: give another --near."
    return f"--pair is {options.pair}: give 1 .. {pairs}."


def _pair_table(pairs: Sequence[ModePair], taken: int) -> str:
    lines = ["   pair                         centre Hz  split Hz  next mode Hz"]
    for place, pair in enumerate(pairs[: max(ROWS, taken)], 1):
        mark = "*" if place == taken else " "
        lines.append(
            f"{mark}{place:>2} {pair.name:<28} {pair.centre_hz:9.1f} {pair.splitting_hz:9.1f} {pair.next_hz:13.1f}"
        )
    if len(pairs) > ROWS:
        lines.append(f"   and {len(pairs) - ROWS} more, farther from --near")
    return "\n".join(lines)


def _stamp_table(pair: ModePair, nodes: Sequence[Stamp], chosen: Sequence[Stamp], options: argparse.Namespace) -> str:
    if not nodes:
        return f"\n{pair.name}: no common node has room for a stamp of {options.stamp_mm:g} mm."
    um = AMPLITUDE_UM
    lines = [
        f"\n{pair.name}: {len(nodes)} common nodes. With both modes at {um:g} um a stamp of {options.stamp_mm:g} mm "
        f"radius is moved by {um * nodes[0].moved_frac:.2f} to {um * nodes[-1].moved_frac:.2f} um.",
        "Four to glue, the one of least motion in each quadrant:"
        if len(chosen) == 4
        else "Not every quadrant has one:",
        "     x mm    y mm  moved um",
    ]
    lines += [f"  {stamp.x_mm:7.2f} {stamp.y_mm:7.2f} {um * stamp.moved_frac:9.3f}" for stamp in chosen]
    return "\n".join(lines)


def _write_json(pairs: Sequence[ModePair], pair: ModePair, nodes: Sequence[Stamp], file: str) -> None:
    table: dict[str, Any] = {
        "pairs": [
            {
                "modes": [shape.name for shape in one.shapes],
                "frequency_hz": list(one.frequency_hz),
                "splitting_hz": one.splitting_hz,
                "next_hz": one.next_hz if math.isfinite(one.next_hz) else None,
            }
            for one in pairs
        ],
        "taken": pairs.index(pair) + 1,
        "stamps": [stamp._asdict() for stamp in nodes],
    }
    outputs.write_json(table, file)


def _write_map(shapes: Sequence[ModeShape], size_mm: tuple[float, float], path: Path) -> None:
    """Write a mode file for `plate.modes_file`: peaks of 1, edge to edge."""
    x_mm, y_mm = (
        np.linspace(-edge_mm / 2, edge_mm / 2, math.ceil(edge_mm / max(MAP_STEP_MM, edge_mm / 300)) + 1)
        for edge_mm in size_mm
    )
    try:
        ModeShapes.from_grid(x_mm, y_mm, np.stack([shape.on_grid(x_mm, y_mm) for shape in shapes])).save(path)
    except ModesError as error:
        raise CalibrationError(str(error)) from None


def draw(
    pairs: Sequence[ModePair], taken: ModePair, nodes: Sequence[Stamp], chosen: Sequence[Stamp], path: Path
) -> None:
    """Draw both shapes of each pair, and the common nodes of the selected one. Raises HapticdError."""
    rows = len(pairs)
    figure, axes = plotting.subplots(8.6, 2.6 * rows + 1.0, rows, 3, layout="compressed", sharex=True, sharey=True)
    width_mm, depth_mm = taken.shapes[0].size_mm
    x_mm, y_mm = (np.linspace(-edge_mm / 2, edge_mm / 2, 161) for edge_mm in (width_mm, depth_mm))
    signed, greys = plotting.stepped("RdBu", 20), plotting.stepped("Greys", 20)
    extent = (-width_mm / 2, width_mm / 2, -depth_mm / 2, depth_mm / 2)
    for row, pair in zip(axes, pairs, strict=True):
        grids = [shape.on_grid(x_mm, y_mm) for shape in pair.shapes]
        for plot, grid, shape, hz in zip(row, grids, pair.shapes, pair.frequency_hz, strict=False):
            shapes = plot.imshow(grid, origin="lower", extent=extent, cmap=signed, vmin=-1, vmax=1)
            plot.set_title(f"{shape.name}: {hz:.0f} Hz", fontsize=9)
        both = row[2].imshow(abs(grids[0]) + abs(grids[1]), origin="lower", extent=extent, cmap=greys, vmin=0, vmax=2)
        if pair is taken:
            row[2].scatter([one.x_mm for one in nodes], [one.y_mm for one in nodes], s=6, color="tab:blue")
            row[2].scatter(
                [one.x_mm for one in chosen],
                [one.y_mm for one in chosen],
                s=60,
                facecolors="none",
                edgecolors="tab:red",
            )
        row[2].set_title("both: nodes blue, stamps red" if pair is taken else "both", fontsize=9)
        row[0].set_ylabel("y, mm")
    for plot in axes[-1]:
        plot.set_xlabel("x, mm")
    figure.colorbar(shapes, ax=axes[:, :2], location="bottom", label="mode shape; its largest value is 1", aspect=40)
    figure.colorbar(both, ax=axes[:, 2], location="bottom", label="sum of both magnitudes")
    plotting.save(figure, path, dpi=80, colours=96)
