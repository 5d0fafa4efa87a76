"""Participants of a plate: the friction curve of each, in `participants/NAME/hapticd.toml`.

The file has the friction of a configuration's `[plate]`, and in `[person]` name, date (YYYY-MM-DD) and finger.
"""

from __future__ import annotations

import datetime
import re
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from ..errors import ConfigError
from ..formats.toml_file import read_table
from . import loader
from .sections import PlateConfig

CALIBRATION = Path("calibration")  # where `calibrate` writes unless told otherwise
FILE = "hapticd.toml"
SECTION = "person"


class Person(NamedTuple):
    """A plate with the person's friction, and the date of that; empty if the file has none."""

    plate: PlateConfig
    date: str

    def aged(self, today: datetime.date) -> str:
        """Return a sentence if the curve is of another day than today; empty otherwise."""
        if self.date in ("", today.isoformat()):
            return ""
        return f"This friction curve is of {self.date}, and skin changes from day to day: measure it again."


def folder_of(calibration: Path, name: str) -> Path:
    """Return a participant's folder. Raises ConfigError for what is no name."""
    if not re.fullmatch(r"[A-Za-z0-9_-]{1,32}", name):
        raise ConfigError(f"{name[:40]!r} is no participant's name: give letters, digits, - and _, such as P03.")
    return calibration / "participants" / name


def find(name: str, plate: PlateConfig) -> Person:
    """Return a participant of a plate, whose folder is beside the plate's mode map. Raises ConfigError."""
    path = folder_of(Path(plate.modes_file).parent if plate.modes_file else CALIBRATION, name) / FILE
    if not path.is_file():
        raise ConfigError(f"There is no file {path}: `hapticd calibrate person --participant {name}` makes it.")
    return load(path, plate)


def load(path: Path, plate: PlateConfig) -> Person:
    """Return this plate with the friction curve of a file, and its speed if that was measured. Raises ConfigError."""
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
    return Person(felt, str(about.get("date", "")))
