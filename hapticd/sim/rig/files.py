"""Measurements of the simulated plate, as files."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np

from ...config.keys import toml
from ..plate.glasses import find_glass
from ..plate.ground_truth import GroundTruth
from .process import MODES_FILE, PARASITIC_MODES_FILE, PLATE_FILE


def write_measured(plate: GroundTruth, seed: int, directory: Path) -> tuple[Path, ...]:
    """Write the mode map, the parasitic modes, and a configuration of the plate's name, size and limits. Returns the
    files, in `directory`."""
    modes, shapes, described = (directory / name for name in (MODES_FILE, PARASITIC_MODES_FILE, PLATE_FILE))
    plate.measured_mode_map(seed).save(modes)
    size_mm = list(find_glass(plate.settings.plate).size_mm)
    lines = [f'[sim]\nplate = "{plate.settings.plate}"\nmodes = {plate.settings.driven_modes}\n']
    lines += [f"[limits]\nw_limit_um = {list(plate.w_limit_um)}\n[plate]\nsize_mm = {size_mm}\n"]
    parasitic = plate.parasitic_modes(seed)
    grid = {name: getattr(parasitic.modes, name) for name in ("x_mm", "y_mm", "shapes")}
    np.savez(shapes, **grid, decay_1_s=parasitic.decay_1_s, detuning_rad_s=parasitic.detuning_rad_s)
    lines += ["[uncertainty]\n", *(f"{name} = {toml(value)}\n" for name, value in asdict(plate.uncertainty).items())]
    described.write_text("".join(lines), encoding="utf-8")
    return modes, shapes, described
