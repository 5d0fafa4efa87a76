"""`hapticd plate`: plates for whole fingertips, compared by friction felt as asked (`plate_felt`), and their shapes.

Theory (`design.glued_plate`): a free, homogeneous plate with its patches. A real one is supported, and its frequencies
differ by some per cent: measure its modes with `hapticd calibrate modes`. The mode file is for trials before that.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..core.plate.mode_shapes import ModeShapes
from ..design import ModeShape
from ..errors import CalibrationError, ModesError
from ..formats.mode_map import FORMATS
from . import outputs, plate_felt
from .arguments import add_command
from .map import program as map_program

MAP_STEP_MM = 1.375


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = (
        f"{parser.epilog}\n\n"
        "materials: glass, float, pilkington, borosilicate, aluminium, steel (hapticd/design/materials.py: sources)"
    )
    plate_felt.add_arguments(parser)
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
    """Print the tables and write the outputs. Raises HapticdError."""
    design = plate_felt.run(options)
    if options.out is not None:
        _write_map(design.shapes, design.plate.size_mm, options.out)


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
