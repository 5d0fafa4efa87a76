"""What a laboratory knows of the simulated plate, as the files that it would have written."""

from __future__ import annotations

import math
from pathlib import Path

from .plate import PlateTruth
from .rigprocess import MODES_FILE, NEIGHBOURS_FILE, PLATE_FILE


def write_measured(plate: PlateTruth, seed: int, directory: Path, *, with_neighbours: bool) -> tuple[Path, ...]:
    """The cartography and, `with_neighbours`, the map of the modes beside the driven ones with the section of a
    configuration that names it. Returns the files, in `directory`."""
    modes = directory / MODES_FILE
    plate.cartography(seed).save(modes)
    if not with_neighbours:
        return (modes,)
    neighbours = plate.neighbours(seed)
    shapes, section = directory / NEIGHBOURS_FILE, directory / PLATE_FILE
    neighbours.modes.save(shapes)
    detuning_hz = [detuning_rad_s / (2.0 * math.pi) for detuning_rad_s in neighbours.detuning_rad_s]
    section.write_text(
        "[plate]\n"
        f'neighbours_file = "{NEIGHBOURS_FILE}"\n'
        f"neighbours_detuning_hz = {detuning_hz}\n"
        f"neighbours_decay_1_s = {list(neighbours.decay_1_s)}\n"
        f"finger_decay_1_s = {neighbours.finger_decay_1_s}\n",
        encoding="utf-8",
    )
    return modes, shapes, section
