"""What a laboratory knows of the simulated plate, as the files that it would have written."""

from __future__ import annotations

import math
from pathlib import Path

from ..plate.truth import PlateTruth
from .process import MODES_FILE, NEIGHBOURS_FILE, PLATE_FILE


def write_measured(plate: PlateTruth, seed: int, directory: Path, *, with_neighbours: bool) -> tuple[Path, ...]:
    """The cartography and, `with_neighbours`, the map of the modes beside the driven ones with the section of a
    configuration that names it. Returns the files, in `directory`."""
    modes = directory / MODES_FILE
    plate.cartography(seed).save(modes)
    if not with_neighbours:
        return (modes,)
    parasitic_modes = plate.parasitic_modes(seed)
    shapes, section = directory / NEIGHBOURS_FILE, directory / PLATE_FILE
    parasitic_modes.modes.save(shapes)
    detuning_hz = [detuning_rad_s / (2.0 * math.pi) for detuning_rad_s in parasitic_modes.detuning_rad_s]
    section.write_text(
        "[plate]\n"
        f'parasitic_modes_file = "{NEIGHBOURS_FILE}"\n'
        f"parasitic_detuning_hz = {detuning_hz}\n"
        f"parasitic_decay_1_s = {list(parasitic_modes.decay_1_s)}\n"
        f"finger_decay_1_s = {parasitic_modes.finger_decay_1_s}\n",
        encoding="utf-8",
    )
    return modes, shapes, section
