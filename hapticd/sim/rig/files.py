"""Measurements of the simulated plate, as files."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path

from ...config.keys import toml
from ..plate.glasses import find_glass
from ..plate.ground_truth import GroundTruth
from .process import MODES_FILE, PARASITIC_MODES_FILE, PLATE_FILE


def write_measured(plate: GroundTruth, seed: int, directory: Path) -> tuple[Path, ...]:
    """Write the mode map and that of the parasitic modes, with a configuration of the plate's name, size and limits
    that names it. Returns the files, in `directory`."""
    modes, shapes, described = (directory / name for name in (MODES_FILE, PARASITIC_MODES_FILE, PLATE_FILE))
    plate.measured_mode_map(seed).save(modes)
    size_mm = list(find_glass(plate.settings.plate).size_mm)
    lines = [f'[sim]\nplate = "{plate.settings.plate}"\nmodes = {plate.settings.driven_modes}\n']
    lines += [f"[limits]\nw_limit_um = {list(plate.w_limit_um)}\n[plate]\nsize_mm = {size_mm}\n"]
    parasitic_modes = plate.parasitic_modes(seed)
    parasitic_modes.modes.save(shapes)
    detuning_hz = [detuning_rad_s / (2.0 * math.pi) for detuning_rad_s in parasitic_modes.detuning_rad_s]
    lines.append(
        f'parasitic_modes_file = "{PARASITIC_MODES_FILE}"\n'
        f"parasitic_detuning_hz = {detuning_hz}\n"
        f"parasitic_decay_1_s = {list(parasitic_modes.decay_1_s)}\n"
    )
    lines += ["[uncertainty]\n", *(f"{name} = {toml(value)}\n" for name, value in asdict(plate.uncertainty).items())]
    described.write_text("".join(lines), encoding="utf-8")
    return modes, shapes, described
