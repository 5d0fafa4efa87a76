"""What `hapticd plate --contacts` writes of the best plate: the service's configuration, and the simulation's plate."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

from ..config.keys import toml
from ..design.contact_search import ContactDesign, Drive
from ..design.free_plate import free_modes
from ..design.materials import MATERIALS
from ..files import outputs
from ..sim.plate.glasses import FARTHEST_HZ, LEAST_PARASITIC, NUMBERS

PARASITIC = 4  # modes besides the driven ones that a simulated plate has


def write_config(design: ContactDesign, drive: Drive, heading: str, path: Path, modes_file: Path) -> None:
    """Write what the service needs for this plate; all other keys keep their defaults."""
    frequencies = ", ".join(f"{hz:.0f}" for hz in design.frequency_hz)
    named = os.path.relpath(modes_file.absolute(), path.absolute().parent)
    lines = [
        heading,
        f"# Modes by theory, for trials: {frequencies} Hz. A real plate is measured: `hapticd calibrate modes` and",
        "# `hapticd firmware sweep`. The drive frequency is part of the board's calibration.",
        "[plate]",
        f"size_mm = {toml(design.plate.size_mm)}",
        f"modes_file = {toml(named)}",
        "",
        "[limits]",
        f"w_limit_um = {toml(tuple(round(um, 3) for um in design.limits_um))}",
        "",
        "[solver]",
        f"contact_radius_mm = {toml(drive.radius_mm)}",
    ]
    outputs.write_text("\n".join(lines) + "\n", path)


def glass_lines(design: ContactDesign, drive: Drive) -> list[str]:
    """Return the lines of a file with what the simulation needs for this plate: `sim.plate.glasses`.

    Raises ValueError with the reason why there can be none.
    """
    plate, driven = design.plate, [shape.name for shape in design.shapes]
    of = plate.material
    if plate.patches:
        raise ValueError("simulated plates have no glued patches")
    low_hz, high_hz = NUMBERS["drive_hz"]
    if not low_hz <= design.drive_hz <= high_hz:
        raise ValueError(f"simulated plates have {low_hz:g} to {high_hz:g} Hz of drive")
    band_hz = (design.drive_hz - FARTHEST_HZ, design.drive_hz + FARTHEST_HZ)
    modes = free_modes(plate.size_mm, plate.thickness_mm, of, band_hz)
    times = Counter(shape.name for _, shape in modes)
    if any(times[mode] != 1 for mode in driven):
        raise ValueError(f"a simulated plate names its modes, and two near the drive are {' or '.join(driven)}")
    others = [(abs(hz - design.drive_hz), one.name) for hz, one in modes if times[one.name] == 1]
    near = sorted(other for other in others if other[1] not in driven)
    if len(near) < LEAST_PARASITIC:
        raise ValueError(f"simulated plates have {LEAST_PARASITIC} more modes within {FARTHEST_HZ:g} Hz of the drive")
    name = next((name for name, known in MATERIALS.items() if known == of), None)
    values = {
        "size_mm": plate.size_mm,
        "thickness_mm": plate.thickness_mm,
        "drive_hz": float(design.drive_hz),
        "driven": len(driven),
        "reach_um": drive.reach_um,
        "modes": (*driven, *(name for _, name in near[:PARASITIC])),
        "material": name or f"{of.young_gpa:g},{of.poisson:g},{of.density_kg_m3:g}",
    }
    head = "# For --plate of simulated plates: the driven modes first, then the next ones."
    return [head, *(f"{key} = {toml(value)}" for key, value in values.items())]
