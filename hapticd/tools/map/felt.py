"""`hapticd plate map --friction`: where fingers feel the frictions that are asked of them."""

from __future__ import annotations

import argparse

import numpy as np

from ...design.felt_map import felt_map, felt_pairs
from ...errors import UsageError
from ..progress import Progress
from .arguments import FELT_CELLS, FELT_PAIR_CELLS, MappedPlate, finger, frictions, plate
from .felt_picture import FeltPanel, draw_felt, draw_felt_pairs
from .results import plate_line, save

PAIRS_PER_CELL = 50


def map_frictions(options: argparse.Namespace) -> None:
    """Print, draw and write what the options ask for. Raises HapticdError."""
    if options.target is not None:
        raise UsageError("--target: is an amplitude: with --friction leave it out.")
    for text in options.finger:
        if text.count(",") > 1:
            raise UsageError(f"--finger: {text!r} names an amplitude: with --friction write X,Y.")
    asked, mapped = frictions(options.friction, len(options.finger)), plate(options)
    if not mapped.radius_mm > 0.0:
        raise UsageError("--friction: is felt by whole contacts: set solver.contact_radius_mm above 0.")
    print(plate_line(mapped.modes, mapped.size_mm, mapped.limit_um))
    if options.finger:
        _map_given(options, mapped, asked)
    else:
        _map_pairs(options, mapped, asked)


def _map_given(options: argparse.Namespace, mapped: MappedPlate, asked: tuple[float, ...]) -> None:
    given = [finger(text, 0.0, mapped.size_mm)[:2] for text in options.finger]
    both_ways = [asked, asked[::-1]] if len(asked) == 2 and asked[0] != asked[1] else [asked]
    cells = FELT_CELLS if options.cells is None else options.cells
    panels, arrays = [], {"fingers_mm": np.array(given)}
    for number, each in enumerate(both_ways, 1):
        with Progress(f"friction {each[-1]:g} of the other finger") as progress:
            result = felt_map(
                mapped.modes,
                given,
                each,
                mapped.limit_um,
                mapped.curve,
                radius_mm=mapped.radius_mm,
                size_mm=mapped.size_mm,
                cells=cells,
                progress=progress,
            )
        panels.append(FeltPanel(given, each, result))
        arrays |= {"x_mm": result.x_mm, "y_mm": result.y_mm, f"frictions_{number}": np.array(each)}
        arrays[f"errors_jnd_{number}"] = result.errors_jnd
        print(_line(panels[-1]))
    if options.plot is not None:
        draw_felt(panels, mapped, options.plot)
    if options.out is not None:
        save(arrays, mapped.limit_um, options.out)


def _line(panel: FeltPanel) -> str:
    while_ = " and ".join(
        f"one at {x_mm:g}, {y_mm:g} mm feels {friction:g}"
        for (x_mm, y_mm), friction in zip(panel.fingers_mm, panel.frictions[:-1], strict=True)
    )
    middle, tenth = np.quantile(panel.result.largest_jnd, (0.5, 0.9))
    return (
        f"friction {panel.frictions[-1]:g} of another finger, while {while_}: as asked on "
        f"{100 * panel.result.felt_frac:.1f} % of the plate; largest error {middle:.2f} just noticeable differences at "
        f"the median position, {tenth:.2f} at the worst tenth"
    )


def _map_pairs(options: argparse.Namespace, mapped: MappedPlate, asked: tuple[float, ...]) -> None:
    cells = FELT_PAIR_CELLS if options.cells is None else options.cells
    with Progress("random pairs of positions") as progress:
        try:
            pairs = felt_pairs(
                mapped.modes,
                asked,
                mapped.limit_um,
                mapped.curve,
                radius_mm=mapped.radius_mm,
                size_mm=mapped.size_mm,
                cells=cells,
                count=PAIRS_PER_CELL * cells * cells,
                progress=progress,
            )
        except ValueError as error:
            raise UsageError(f"--friction: {error}") from None
    print(
        f"frictions {asked[0]:g} and {asked[1]:g} of two fingers: both as asked on {100 * pairs.felt_frac:.1f} % of "
        f"{pairs.count} random pairs of positions"
    )
    if options.plot is not None:
        draw_felt_pairs(pairs, asked, mapped, options.plot)
    if options.out is not None:
        arrays = {"x_mm": pairs.x_mm, "y_mm": pairs.y_mm, "shares": pairs.shares, "frictions": np.array(asked)}
        save(arrays, mapped.limit_um, options.out)
