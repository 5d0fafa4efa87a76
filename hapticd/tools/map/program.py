"""`hapticd map`: arguments, table and arrays of the achievability maps (`design.achievability`)."""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...config.sections import MOST_MODES
from ...errors import ModesError, UsageError
from ...files import outputs
from ..arguments import number, whole
from ..progress import Progress

if TYPE_CHECKING:
    from ...core.plate.mode_shapes import ModeShapes
    from ...design.achievability import AchievabilityMap, Finger, PairMap
    from ...design.contact_map import ContactMap
    from ...design.legendre import FloatArray
    from .picture import Panel

LIMIT_UM = 4.0  # of each mode with --modes, which names no configuration
MOST_UM, MOST_LIMIT_UM = 1000.0, 20.0  # the bounds of client targets and of the configuration
MOST_FINGERS = 15
CELLS, MOST_CELLS = 201, 401
SEARCHED_CELLS = 61  # several slipping fingers on three modes or more take the solver a millisecond a cell
PAIR_CELLS, MOST_PAIR_CELLS = 45, 101  # the work grows with their fourth power
SHARES = (0.5, 0.9, 1.0)
NAME_COLUMNS = 52  # width of the table's first column
CONTACT_MODES = 4  # fewer cannot hold a whole contact still while another slips
CONTACT_CELLS = 81
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
    parser.add_argument(
        "--target", type=number(1e-3, MOST_UM), default=1.0, metavar="UM", help="target of slipping fingers (default 1)"
    )
    parser.add_argument("--limit", metavar="UM[,UM..]", help="of each mode (default: the configuration's, or 4)")
    parser.add_argument(
        "--cells",
        type=whole(2, MOST_CELLS),
        metavar="N",
        help=f"per side (default {CELLS}; without --finger {PAIR_CELLS})",
    )
    outputs.add_file(parser, "--plot", outputs.PICTURE, metavar="F.png", help="draw it")
    outputs.add_file(parser, "--out", outputs.NPZ, metavar="F.npz", help="write the arrays")
    parser.set_defaults(command=_map)


def _map(options: argparse.Namespace) -> None:
    from ...design.achievability import achievability_map
    from .picture import Panel, draw

    if not options.finger and options.cells is not None and options.cells > MOST_PAIR_CELLS:
        raise UsageError(f"--cells: without --finger it must be 2 .. {MOST_PAIR_CELLS}, not {options.cells}.")
    modes, size_mm, limit_um, radius_mm = _plate(options)
    target_um = options.target
    if not options.finger:
        if options.still or options.slip:
            raise UsageError("--still and --slip need the other fingers: give a --finger, such as -30,20.")
        _map_pairs(options, modes, size_mm, limit_um)
        return
    if len(options.finger) > MOST_FINGERS:
        raise UsageError(f"--finger: {len(options.finger)} fingers are too many: give at most {MOST_FINGERS}.")
    panels = []
    for other_um in _other_um(options):
        usual_um = target_um if other_um == 0.0 else 0.0
        fingers = [_finger(text, usual_um, size_mm) for text in options.finger]
        if other_um == 0.0 and not any(finger.target_um > 0.0 for finger in fingers):
            continue
        slipping = sum(um > 0.0 for um in (other_um, *(finger.target_um for finger in fingers)))
        usual_cells = CELLS if slipping == 1 or modes.M <= 2 else SEARCHED_CELLS
        cells = usual_cells if options.cells is None else options.cells
        with Progress(_title(other_um)) as progress:
            result = achievability_map(
                modes, fingers, other_um, limit_um, size_mm=size_mm, cells=cells, progress=progress
            )
        contacts = None
        if modes.M >= CONTACT_MODES and radius_mm > 0.0 and not any(finger.target_um > 0.0 for finger in fingers):
            cells = CONTACT_CELLS if options.cells is None else options.cells
            contacts = _contacts(modes, fingers, other_um, limit_um, radius_mm, size_mm, cells)
        panels.append(Panel(_title(other_um), tuple(fingers), result, contacts))
    if not panels:
        raise UsageError("--still: no finger slips: give a --finger an amplitude above 0.")
    print(_table(panels, modes, size_mm, limit_um))
    if options.plot is not None:
        draw(panels, modes, size_mm, options.plot)
    if options.out is not None:
        _write(panels, limit_um, options.out)


def _contacts(
    modes: ModeShapes,
    fingers: Sequence[Finger],
    target_um: float,
    limit_um: Sequence[float],
    radius_mm: float,
    size_mm: tuple[float, float],
    cells: int,
) -> ContactMap:
    """Return the contrast between contacts: the given fingers still, the other slipping."""
    from ...design.contact_map import contact_map

    still_mm = [(finger.x_mm, finger.y_mm) for finger in fingers]
    with Progress(f"contacts of {radius_mm:g} mm radius") as progress:
        return contact_map(
            modes, still_mm, target_um, limit_um, radius_mm=radius_mm, size_mm=size_mm, cells=cells, progress=progress
        )


def _map_pairs(
    options: argparse.Namespace, modes: ModeShapes, size_mm: tuple[float, float], limit_um: tuple[float, ...]
) -> None:
    from ...design.achievability import pair_map
    from .picture import draw_pairs

    cells, target_um = PAIR_CELLS if options.cells is None else options.cells, options.target
    with Progress("all pairs of positions") as progress:
        pairs = pair_map(modes, target_um, limit_um, size_mm=size_mm, cells=cells, progress=progress)
    print(_plate_line(modes, size_mm, limit_um))
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
        _save(arrays, limit_um, options.out)


def _position(pairs: PairMap, part: FloatArray, index: int) -> str:
    row, column = divmod(index, part.shape[1])
    return f"{100 * part[row, column]:.0f} % at {pairs.x_mm[column]:.1f}, {pairs.y_mm[row]:.1f} mm"


# --- arguments --------------------------------------------------------------------------------------------------


def _plate(options: argparse.Namespace) -> tuple[ModeShapes, tuple[float, float], tuple[float, ...], float]:
    """Return the mode shapes, the plate's size, the modes' limits and a contact's radius. Raises HapticdError."""
    from ...config import loader as config
    from ...config.sections import Config

    if options.modes is not None:
        from ...core.plate.mode_shapes import ModeShapes

        try:
            modes = ModeShapes.load(options.modes)
        except ModesError as error:
            raise UsageError(f"--modes: {error}") from None
        if modes.M > MOST_MODES:
            raise UsageError(f"--modes: {options.modes} has {modes.M} modes: give a file of at most {MOST_MODES}.")
        size_mm = 2.0 * float(np.abs(modes.x_mm).max()), 2.0 * float(np.abs(modes.y_mm).max())
        return modes, size_mm, _limits(options.limit, (LIMIT_UM,) * modes.M), Config().solver.contact_radius_mm
    from ...daemon.service import load_modes

    loaded = config.load(options.config) if options.config is not None else Config()
    width_mm, depth_mm = loaded.plate.size_mm
    limits_um = _limits(options.limit, loaded.limits.reference_limit_um)
    return load_modes(loaded), (width_mm, depth_mm), limits_um, loaded.solver.contact_radius_mm


def _limits(text: str | None, usual_um: tuple[float, ...]) -> tuple[float, ...]:
    if text is None:
        return usual_um
    limits = [_number(part, "--limit", 1e-3, MOST_LIMIT_UM) for part in text.split(",")]
    if len(limits) not in (1, len(usual_um)):
        raise UsageError(f"--limit: has {len(limits)} limits for {len(usual_um)} modes: give one, or one for each.")
    return tuple(limits * len(usual_um) if len(limits) == 1 else limits)


def _finger(text: str, usual_um: float, size_mm: tuple[float, float]) -> Finger:
    from ...design.achievability import Finger

    parts = text.split(",")
    if len(parts) not in (2, 3):
        raise UsageError(
            f"--finger: {text!r} is no position: write X,Y in mm, or X,Y,UM, such as -30,20 or -30,20,0.5."
        )
    x_mm, y_mm = (_number(part, f"--finger {text}", -math.inf, math.inf) for part in parts[:2])
    if not (abs(x_mm) <= size_mm[0] / 2 and abs(y_mm) <= size_mm[1] / 2):
        raise UsageError(
            f"--finger {text}: lies off the plate, which reaches from -{size_mm[0] / 2:g},-{size_mm[1] / 2:g} "
            f"to {size_mm[0] / 2:g},{size_mm[1] / 2:g} mm."
        )
    return Finger(x_mm, y_mm, _number(parts[2], f"--finger {text}", 0.0, MOST_UM) if len(parts) == 3 else usual_um)


def _other_um(options: argparse.Namespace) -> tuple[float, ...]:
    if options.still or options.slip:
        return (0.0,) if options.still else (options.target,)
    return 0.0, options.target


def _number(text: str | float, name: str, low: float, high: float) -> float:
    try:
        value = float(text)
    except ValueError:
        raise UsageError(f"{name}: {text!r} is no number.") from None
    if not (math.isfinite(value) and low <= value <= high):
        bounds = f"it must be {low:g} .. {high:g}" if math.isfinite(low) else "it must be a number of mm"
        raise UsageError(f"{name}: {value:g} is out of bounds, {bounds}.")
    return value


# --- results ----------------------------------------------------------------------------------------------------


def _title(other_um: float) -> str:
    return "the other finger still" if other_um == 0.0 else f"the other finger slips by {other_um:g} um"


def _table(panels: Sequence[Panel], modes: ModeShapes, size_mm: tuple[float, float], limit_um: Sequence[float]) -> str:
    lines = [_plate_line(modes, size_mm, limit_um)]
    for column, panel in enumerate(panels, 1):
        lines.append(f"({column}) {panel.title}, while {' and '.join(map(_finger_line, panel.fingers))}")
    lines += ["", " " * NAME_COLUMNS + "".join(f"{f'({column})':>8}" for column in range(1, len(panels) + 1))]
    columns = [_figures(panel.result) for panel in panels]
    for (name, unit), *values in zip(columns[0], *(column.values() for column in columns), strict=True):
        lines.append(f"{name:<{NAME_COLUMNS}}" + "".join(map(_cell, values)) + f"  {unit}")
    lines += [_contact_line(panel.contacts) for panel in panels if panel.contacts is not None]
    return "\n".join(lines)


def _contact_line(contacts: ContactMap) -> str:
    tenth, median = np.quantile(contacts.contrast, (0.1, 0.5))
    return (
        f"\nwhole contacts: a slipping finger gets {np.median(contacts.slip_um):.2f} um at the median position, "
        f"{median:.1f} times what a still one gets ({tenth:.1f} times at the worst tenth of positions)"
    )


def _cell(value: float) -> str:
    return f"{value:8.2f}" if math.isfinite(value) else "       -"


def _plate_line(modes: ModeShapes, size_mm: tuple[float, float], limit_um: Sequence[float]) -> str:
    limits = ", ".join(f"{limit:g}" for limit in limit_um)
    named = "1 mode" if modes.M == 1 else f"{modes.M} modes"
    return f"a plate of {size_mm[0]:g} x {size_mm[1]:g} mm, {named} of at most {limits} um"


def _finger_line(finger: Finger) -> str:
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
        if panel.contacts is not None:
            for name in ("x_mm", "y_mm", "slip_um", "still_um", "contrast"):
                arrays[f"contact_{name}"] = getattr(panel.contacts, name)
    _save(arrays, limit_um, path)


def _save(arrays: dict[str, FloatArray], limit_um: Sequence[float], path: Path) -> None:
    with outputs.opened(path) as file:
        np.savez_compressed(file, limit_um=np.array(limit_um), **arrays)  # type: ignore[arg-type]
    print(f"written: {path}", file=sys.stderr)
