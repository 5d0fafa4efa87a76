"""Files of the best plate for whole fingertips: of all of it, for the simulation, and of its mode shapes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..config.keys import toml
from ..core.plate.mode_shapes import ModeShapes
from ..design.cartography import map_axis
from ..design.felt_search import FeltDesign
from ..design.materials import MATERIALS
from ..design.mode_shape import ModeShape, distinct_names
from ..errors import CalibrationError, ModesError
from ..sim.plate.glasses import DRIVE_HZ, FARTHEST_HZ, LEAST_PARASITIC

MAP_STEP_MM = 1.375
PARASITIC = 4  # modes besides the driven ones that a simulated plate has


def glass_lines(design: FeltDesign, reach_um: float | tuple[float, ...]) -> list[str]:
    """Return the lines of a file with what the simulation needs for this plate: `sim.plate.glasses`.

    `reach_um` is at resonance, of all modes or of each driven one. Raises ValueError with the reason why there can be
    none.
    """
    plate, of = design.plate, design.plate.material
    count = len(design.frequency_hz)
    low_hz, high_hz = DRIVE_HZ
    if not low_hz <= design.drive_hz <= high_hz:
        raise ValueError(f"simulated plates have {low_hz:g} to {high_hz:g} Hz of drive")
    modes = plate.modes((design.drive_hz - FARTHEST_HZ, design.drive_hz + FARTHEST_HZ))
    if len(modes) < count + LEAST_PARASITIC:
        raise ValueError(f"simulated plates have {LEAST_PARASITIC} more modes within {FARTHEST_HZ:g} Hz of the drive")
    named = list(zip(distinct_names(modes), modes, strict=True))
    driven = [_name_of(hz, shape, named) for hz, shape in zip(design.frequency_hz, design.shapes, strict=True)]
    if len(set(driven)) < count:
        raise ValueError(f"a simulated plate names its modes, and these are not distinct: {', '.join(driven)}")
    near = sorted((abs(hz - design.drive_hz), name) for name, (hz, _) in named if name not in driven)
    known = next((name for name, known in MATERIALS.items() if known == of), None)
    values: dict[str, Any] = {
        "size_mm": plate.size_mm,
        "thickness_mm": plate.thickness_mm,
        "drive_hz": float(design.drive_hz),
        "driven": count,
        "reach_um": reach_um,
        "modes": (*driven, *(name for _, name in near[:PARASITIC])),
        "material": known or f"{of.young_gpa:g},{of.poisson:g},{of.density_kg_m3:g}",
    }
    if plate.patches:
        values["patches"] = tuple((p.x_mm, p.y_mm, *p.size_mm, p.thickness_mm) for p in plate.patches)
    head = "# For --plate of simulated plates: the driven modes first, then the next ones."
    return [head, *(f"{key} = {toml(value)}" for key, value in values.items())]


def _name_of(frequency_hz: float, shape: ModeShape, named: Sequence[tuple[str, tuple[float, ModeShape]]]) -> str:
    """Return the name of a mode among those near the drive."""
    return min(named, key=lambda one: (one[1][1].name != shape.name, abs(one[1][0] - frequency_hz)))[0]


def write_map(shapes: Sequence[ModeShape], size_mm: tuple[float, float], path: Path) -> None:
    """Write a mode file for `plate.modes_file`: peaks of 1, edge to edge. Raises CalibrationError."""
    x_mm, y_mm = (map_axis(edge_mm, max(MAP_STEP_MM, edge_mm / 300)) for edge_mm in size_mm)
    try:
        ModeShapes.from_grid(x_mm, y_mm, np.stack([shape.on_grid(x_mm, y_mm) for shape in shapes])).save(path)
    except ModesError as error:
        raise CalibrationError(str(error)) from None
