"""One line of the report, and the patient that all the lines are about."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...config.sections import SIMULATED, Config

PASS, WARN, FAIL = "pass", "warn", "FAIL"


@dataclass(frozen=True, slots=True)
class Finding:
    """What was found of one `check`; `remedy` is the command that mends it, empty where there is nothing to do."""

    verdict: str
    check: str
    said: str
    remedy: str = ""

    def __str__(self) -> str:
        line = f"{self.verdict}  {self.check}: {self.said}"
        return f"{line}\n      -> {self.remedy}" if self.remedy else line


@dataclass(frozen=True, slots=True)
class Patient:
    """A configuration and its surroundings. `status` is the running daemon's answer, None where none answered, and
    `version` its program's; `root` is the machine's file system, for its own settings."""

    config: Config
    directory: Path
    status: Mapping[str, Any] | None = None
    version: str = ""
    root: Path = Path("/")

    @property
    def has_pad(self) -> bool:
        """A trackpad is asked for, not a simulated or replayed one."""
        return self.config.trackpad.source == "hid"

    @property
    def has_board(self) -> bool:
        """A board is asked for, not the simulated one."""
        return self.config.device.port != SIMULATED

    def told(self, *path: str) -> Any:
        """What stands there in the daemon's status; None where nothing does."""
        value: Any = self.status
        for key in path:
            value = value.get(key) if isinstance(value, dict) else None
        return value

    def text(self, *parts: str) -> str | None:
        """What a file of the machine says, stripped; None where it cannot be read."""
        try:
            return self.root.joinpath(*parts).read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError):
            return None


def is_ours(path: Path) -> bool:
    """This user may read and write it."""
    return os.access(path, os.R_OK | os.W_OK)
