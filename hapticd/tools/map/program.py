"""`hapticd plate map`: where fingers feel the frictions that are asked of them."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

import numpy as np

from ...errors import UsageError
from ...regular_file import opened
from ...values import FloatArray
from .. import outputs
from ..arguments import numbers, whole
from ..progress import progress_bar
from .plate import MappedPlate, mapped_plate

MOST_FINGERS = 15
CELLS, MOST_CELLS = 61, 401


def add_arguments(parser: argparse.ArgumentParser) -> None:
    # A position may begin with a minus sign, which argparse accepts in whole numbers only.
    parser._negative_number_matcher = re.compile(r"-[\d.]")
    parser.description = (
        f"{parser.description} As asked is within one just noticeable difference, as the mean over a contact."
    )
    plate = parser.add_mutually_exclusive_group()
    plate.add_argument("--modes", type=Path, metavar="F.npz", help="mode shapes, NPZ or CSV, of 1 to 8 modes")
    plate.add_argument("--plate", metavar="PLATE", help="a simulated plate: reference, fingertip, wide or F.toml")
    plate.add_argument("--config", type=Path, help="the service's configuration (default: the simulated plate)")
    parser.add_argument(
        "--finger",
        action="append",
        required=True,
        type=numbers(-1e6, 1e6, 2),
        metavar="X,Y",
        help="a finger's position in mm from the plate's centre; repeat for more fingers",
    )
    parser.add_argument(
        "--friction",
        type=numbers(0.0, 1.0),
        default=(0.2, 1.0),
        metavar="F,F[,F..]",
        help="0 (most slippery) .. 1 (bare glass), of each --finger and of the other one (default 0.2,1)",
    )
    parser.add_argument(
        "--cells",
        type=whole(2, MOST_CELLS),
        default=CELLS,
        metavar="N",
        help=f"per side (default {CELLS})",
    )
    outputs.add_file(parser, "--plot", outputs.PICTURE, metavar="F.png", help="draw it")
    outputs.add_file(parser, "--out", outputs.NPZ, metavar="F.npz", help="write the arrays")
    parser.set_defaults(command=_map)


def _map(options: argparse.Namespace) -> None:
    if len(options.finger) > MOST_FINGERS:
        raise UsageError(f"--finger: {len(options.finger)} fingers are too many: give at most {MOST_FINGERS}.")
    fingers = len(options.finger) + 1
    if len(options.friction) != fingers:
        raise UsageError(f"--friction: has {len(options.friction)} frictions for {fingers} fingers: give one for each.")
    mapped = mapped_plate(options)
    for x_mm, y_mm in options.finger:
        if not (abs(x_mm) <= mapped.size_mm[0] / 2 and abs(y_mm) <= mapped.size_mm[1] / 2):
            raise UsageError(f"--finger {x_mm:g},{y_mm:g}: lies off {mapped}.")
    print(mapped)
    arrays = _map_given(options, mapped)
    if options.out is not None:
        with opened(options.out) as file:
            np.savez_compressed(file, limit_um=np.array(mapped.limit_um), **arrays)  # type: ignore[arg-type]
        print(f"written: {options.out}", file=sys.stderr)


def _map_given(options: argparse.Namespace, mapped: MappedPlate) -> dict[str, FloatArray]:
    from ...design.felt_places import felt_map
    from .picture import FeltPanel, draw, felt_figure

    given, asked = options.finger, options.friction
    both_ways = [asked, asked[::-1]] if len(asked) == 2 and asked[0] != asked[1] else [asked]
    panels, arrays = [], {"fingers_mm": np.array(given)}
    for number, each in enumerate(both_ways, 1):
        with progress_bar(f"friction {each[-1]:g} of the other finger") as progress:
            result = felt_map(
                *(mapped.modes, given, each, mapped.limit_um, mapped.curve),
                radius_mm=mapped.radius_mm,
                size_mm=mapped.size_mm,
                cells=options.cells,
                progress=progress,
            )
        panels.append(FeltPanel(given, each, result))
        arrays |= {"x_mm": result.x_mm, "y_mm": result.y_mm, f"frictions_{number}": np.array(each)}
        arrays[f"errors_jnd_{number}"] = result.errors_jnd
        present = " and ".join(
            f"one at {x_mm:g}, {y_mm:g} mm feels {friction:g}"
            for (x_mm, y_mm), friction in zip(given, each[:-1], strict=True)
        )
        middle, tenth = np.quantile(result.largest_jnd, (0.5, 0.9))
        print(
            f"friction {each[-1]:g} of another finger, while {present}: as asked on {100 * result.felt_frac:.1f} % of "
            f"the plate; largest error {middle:.2f} just noticeable differences at the median position, {tenth:.2f} at "
            "the worst tenth"
        )
    if options.plot is not None:
        draw(felt_figure(panels, mapped), options.plot)
    return arrays
