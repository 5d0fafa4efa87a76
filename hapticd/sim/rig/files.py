"""Measurements of the simulated plate, as files."""

from __future__ import annotations

import math
from pathlib import Path

from ..plate.ground_truth import GroundTruth
from .process import MODES_FILE, PARASITIC_MODES_FILE, PLATE_FILE


def write_measured(plate: GroundTruth, seed: int, directory: Path, *, with_parasitic_modes: bool) -> tuple[Path, ...]:
    """Write the mode map and, `with_parasitic_modes`, that of the parasitic modes with a section of a configuration
    that names it. Returns the files, in `directory`."""
    modes = directory / MODES_FILE
    plate.measured_mode_map(seed).save(modes)
    if not with_parasitic_modes:
        return (modes,)
    parasitic_modes = plate.parasitic_modes(seed)
    shapes, section = directory / PARASITIC_MODES_FILE, directory / PLATE_FILE
    parasitic_modes.modes.save(shapes)
    detuning_hz = [detuning_rad_s / (2.0 * math.pi) for detuning_rad_s in parasitic_modes.detuning_rad_s]
    section.write_text(
        "[plate]\n"
        f'parasitic_modes_file = "{PARASITIC_MODES_FILE}"\n'
        f"parasitic_detuning_hz = {detuning_hz}\n"
        f"parasitic_decay_1_s = {list(parasitic_modes.decay_1_s)}\n"
        f"finger_decay_1_s = {parasitic_modes.finger_decay_1_s}\n",
        encoding="utf-8",
    )
    return modes, shapes, section
