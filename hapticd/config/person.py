"""Participants of a plate: the friction curve of each, in `participants/NAME/hapticd.toml`.

The file has the friction of a configuration's `[plate]`, and in `[person]` name, date (YYYY-MM-DD) and finger.
"""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import date
from pathlib import Path

from ..errors import ConfigError
from ..formats.toml_file import read_table
from . import loader
from .sections import PlateConfig

CALIBRATION = Path("calibration")  # where `calibrate` writes by default
FILE = "hapticd.toml"
SECTION = "person"


def folder_of(calibration: Path, name: str) -> Path:
    """Return a participant's folder. Raises ConfigError for what is no name."""
    if not re.fullmatch(r"[A-Za-z0-9_-]{1,32}", name):
        raise ConfigError(f"{name[:40]!r} is no participant's name: give letters, digits, - and _, such as P03.")
    return calibration / "participants" / name


def find(name: str, plate: PlateConfig) -> tuple[PlateConfig, str]:
    """Return what `load` does for a participant, whose folder is in that of the plate's mode map; for no name the plate
    itself. Raises ConfigError."""
    if not name:
        return plate, ""
    path = folder_of(Path(plate.modes_file).parent if plate.modes_file else CALIBRATION, name) / FILE
    if not path.is_file():
        raise ConfigError(f"There is no file {path}: `hapticd calibrate person --participant {name}` makes it.")
    return load(path, plate)


def load(path: Path, plate: PlateConfig) -> tuple[PlateConfig, str]:
    """Return this plate with the friction curve of a file, and its speed if that was measured; and a sentence if the
    curve is of another day than today, else none. Raises ConfigError."""
    table = read_table(path, "check the path")
    about = table.pop(SECTION, {})
    own = loader.from_table(table, where=str(path), folder=None).plate
    if not (own.friction_curve and isinstance(about, dict)):
        raise ConfigError(f"{path}: holds no friction curve: measure it with `hapticd calibrate person`.")
    felt = replace(
        plate,
        friction_curve=own.friction_curve,
        friction_floor_frac=own.friction_floor_frac,
        friction_speed_mm_s=own.friction_speed_mm_s or plate.friction_speed_mm_s,
    )
    today = date.today().isoformat()
    day = about.get("date", today)
    return felt, "" if day == today else f"{path} is of {day}, and skin changes from day to day: measure it again."
