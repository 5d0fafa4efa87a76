"""`hapticd plate map`: arguments, table and arrays of the achievability maps (`design.achievability`)."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...errors import UsageError
from ...values import FloatArray
from .. import outputs
from ..arguments import number, whole
from ..progress import Progress
from .arguments import FELT_CELLS, FELT_PAIR_CELLS, MOST_UM, finger, plate
from .results import plate_line, save

if TYPE_CHECKING:
    from ...core.plate.mode_shapes import ModeShapes
    from ...design.achievability import AchievabilityMap, MapFinger, PairMap
    from .picture import Panel

MOST_FINGERS = 15
TARGET_UM = 1.0
CELLS, MOST_CELLS = 201, 401
SEARCHED_CELLS = 61  # several slipping fingers on three modes or more take the solver a millisecond a cell
PAIR_CELLS, MOST_PAIR_CELLS = 45, 101  # the work grows with their fourth power
SHARES = (0.5, 0.9, 1.0)
NAME_COLUMNS = 52  # width of the table's first column
POSITION_ERROR_MM = 0.12  # RMS on each axis: the prediction's error on strokes


def add_arguments(parser: argparse.ArgumentParser) -> None:
    # A position may begin with a minus sign, which argparse accepts in whole numbers only.
    parser._negative_number_matcher = re.compile(r"-[\d.]")
    parser.description = (
        f"{parser.description} Without --still or --slip: both maps. Without --finger: for every position, the part of "
        "the plate on which a second finger reaches its target too."
    )
    plate = parser.add_mutually_exclusive_group()
    plate.add_argument("--modes", type=Path, metavar="F.npz", help="mode shapes, NPZ or CSV, of 1 to 8 modes")
    plate.add_argument("--plate", metavar="PLATE", help="a simulated plate: reference, fingertip, wide or F.toml")
    plate.add_argument("--config", type=Path, help="the service's configuration (default: the simulated plate)")
    parser.add_argument(
        "--finger",
        action="append",
        default=[],
        metavar="X,Y[,UM]",
        help="a finger's position in mm from the plate's centre, and its target in um; without UM it slips by --target "
        "while the other finger is still, and is still while the other slips; repeat for more fingers",
    )
    other = parser.add_mutually_exclusive_group()
    other.add_argument("--still", action="store_true", help="map where the other finger can be still")
    other.add_argument("--slip", action="store_true", help="map where the other finger can slip by --target")
    other.add_argument(
        "--friction",
        metavar="F,F[,F..]",
        help="frictions, 0 (most slippery) .. 1 (bare glass), of each --finger X,Y and of the other one: map where all "
        "fingers feel them as asked, within one just noticeable difference; without --finger for random pairs",
    )
    parser.add_argument(
        "--target", type=number(1e-3, MOST_UM), metavar="UM", help=f"target of slipping fingers (default {TARGET_UM:g})"
    )
    parser.add_argument("--limit", metavar="UM[,UM..]", help="of each mode (default: the configuration's, or 4)")
    parser.add_argument(
        "--cells",
        type=whole(2, MOST_CELLS),
        metavar="N",
        help=f"per side (default {CELLS}, without --finger {PAIR_CELLS}; of friction {FELT_CELLS}, {FELT_PAIR_CELLS})",
    )
    outputs.add_file(parser, "--plot", outputs.PICTURE, metavar="F.png", help="draw it")
    outputs.add_file(parser, "--out", outputs.NPZ, metavar="F.npz", help="write the arrays")
    parser.set_defaults(command=_map)


def _map(options: argparse.Namespace) -> None:
    from ...design.achievability import achievability_map
    from .picture import Panel, draw

    if not options.finger and options.cells is not None and options.cells > MOST_PAIR_CELLS:
        raise UsageError(f"--cells: without --finger it must be 2 .. {MOST_PAIR_CELLS}, not {options.cells}.")
    if len(options.finger) > MOST_FINGERS:
        raise UsageError(f"--finger: {len(options.finger)} fingers are too many: give at most {MOST_FINGERS}.")
    if options.friction is not None:
        from .felt import map_frictions

        map_frictions(options)
        return
    mapped = plate(options)
    modes, size_mm, limit_um = mapped.modes, mapped.size_mm, mapped.limit_um
    target_um = _target_um(options)
    if not options.finger:
        if options.still or options.slip:
            raise UsageError("--still and --slip need the other fingers: give a --finger, such as -30,20.")
        _map_pairs(options, modes, size_mm, limit_um)
        return
    panels = []
    for other_um in _other_um(options):
        usual_um = target_um if other_um == 0.0 else 0.0
        fingers = [finger(text, usual_um, size_mm) for text in options.finger]
        if other_um == 0.0 and not any(finger.target_um > 0.0 for finger in fingers):
            continue
        slipping = sum(um > 0.0 for um in (other_um, *(finger.target_um for finger in fingers)))
        usual_cells = CELLS if slipping == 1 or modes.M <= 2 else SEARCHED_CELLS
        cells = usual_cells if options.cells is None else options.cells
        with Progress(_title(other_um)) as progress:
            result = achievability_map(
                modes, fingers, other_um, limit_um, size_mm=size_mm, cells=cells, progress=progress
            )
        panels.append(Panel(_title(other_um), tuple(fingers), result))
    if not panels:
        raise UsageError("--still: no finger slips: give a --finger an amplitude above 0.")
    print(_table(panels, modes, size_mm, limit_um))
    if options.plot is not None:
        draw(panels, modes, size_mm, options.plot)
    if options.out is not None:
        _write(panels, limit_um, options.out)


def _map_pairs(
    options: argparse.Namespace, modes: ModeShapes, size_mm: tuple[float, float], limit_um: tuple[float, ...]
) -> None:
    from ...design.achievability import pair_map
    from .picture import draw_pairs

    cells, target_um = PAIR_CELLS if options.cells is None else options.cells, _target_um(options)
    with Progress("all pairs of positions") as progress:
        pairs = pair_map(modes, target_um, limit_um, size_mm=size_mm, cells=cells, progress=progress)
    print(plate_line(modes, size_mm, limit_um))
    served = f"{100 * pairs.still.mean():.1f} % of all pairs of positions"
    print(f"one finger slips by {target_um:g} um and one is still: both reach their target on {served}")
    for name, part in (("slips", pairs.slipping), ("is still", pairs.still)):
        extremes = (("least", int(part.argmin())), ("most", int(part.argmax())))
        ends = ", ".join(f"{word} {_position(pairs, part, index)}" for word, index in extremes)
        print(f"if one {name} here, the other can be on this part of the plate: {ends}")
    if options.plot is not None:
        draw_pairs(pairs, modes, size_mm, options.plot)
    if options.out is not None:
        arrays = {"x_mm": pairs.x_mm, "y_mm": pairs.y_mm, "slipping": pairs.slipping, "still": pairs.still}
        save(arrays, limit_um, options.out)


def _position(pairs: PairMap, part: FloatArray, index: int) -> str:
    row, column = divmod(index, part.shape[1])
    return f"{100 * part[row, column]:.0f} % at {pairs.x_mm[column]:.1f}, {pairs.y_mm[row]:.1f} mm"


def _other_um(options: argparse.Namespace) -> tuple[float, ...]:
    if options.still or options.slip:
        return (0.0,) if options.still else (_target_um(options),)
    return 0.0, _target_um(options)


def _target_um(options: argparse.Namespace) -> float:
    return TARGET_UM if options.target is None else float(options.target)


# --- results ----------------------------------------------------------------------------------------------------


def _title(other_um: float) -> str:
    return "the other finger still" if other_um == 0.0 else f"the other finger slips by {other_um:g} um"


def _table(panels: Sequence[Panel], modes: ModeShapes, size_mm: tuple[float, float], limit_um: Sequence[float]) -> str:
    lines = [plate_line(modes, size_mm, limit_um)]
    for column, panel in enumerate(panels, 1):
        lines.append(f"({column}) {panel.title}, while {' and '.join(map(_finger_line, panel.fingers))}")
    lines += ["", " " * NAME_COLUMNS + "".join(f"{f'({column})':>8}" for column in range(1, len(panels) + 1))]
    columns = [_figures(panel.result) for panel in panels]
    for (name, unit), *values in zip(columns[0], *(column.values() for column in columns), strict=True):
        lines.append(f"{name:<{NAME_COLUMNS}}" + "".join(map(_cell, values)) + f"  {unit}")
    return "\n".join(lines)


def _cell(value: float) -> str:
    return f"{value:8.2f}" if math.isfinite(value) else "       -"


def _finger_line(finger: MapFinger) -> str:
    does = "is still" if finger.target_um == 0.0 else f"slips by {finger.target_um:g} um"
    return f"one at {finger.x_mm:g}, {finger.y_mm:g} mm {does}"


def _figures(result: AchievabilityMap) -> dict[tuple[str, str], float]:
    """Return values by (name, unit); NaN where there is none."""
    figures = {}
    for share in SHARES:
        part = "all" if share == 1.0 else f"{100 * share:.0f} %"
        figures[f"slipping fingers get {part} of the target on", "% of the plate"] = 100.0 * result.served_frac(share)
    figures["reach at the median position", "um"] = float(np.median(result.reach_um))
    figures["reach at the worst tenth of positions", "um"] = float(np.quantile(result.reach_um, 0.1))
    contrast = result.contrast(POSITION_ERROR_MM)[result.share >= SHARES[0]]
    usual = float(np.median(contrast)) if contrast.size > 0 else math.nan
    figures[f"contrast to a still finger that is {POSITION_ERROR_MM} mm off", "times, where half the target is met"] = (
        usual
    )
    return figures


def _write(panels: Sequence[Panel], limit_um: Sequence[float], path: Path) -> None:
    """Write the arrays of `AchievabilityMap`, named still_... or slip_... by what the other finger does."""
    arrays: dict[str, FloatArray] = {}
    for panel in panels:
        result = panel.result
        prefix = "still" if result.target_um[-1] == 0.0 else "slip"
        arrays[f"{prefix}_fingers_mm"] = np.array([finger[:2] for finger in panel.fingers])
        for name in ("x_mm", "y_mm", "target_um", "share", "achieved_um", "reach_um", "slope_um_mm", "determinant"):
            arrays[f"{prefix}_{name}"] = getattr(result, name)
    save(arrays, limit_um, path)
