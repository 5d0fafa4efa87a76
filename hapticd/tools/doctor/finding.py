"""One line of the report, and the system under examination."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from hapticd_client.messages import printable

from ...config.sections import SIMULATED, Config
from .. import pads

PASS, WARN, FAIL = "pass", "warn", "FAIL"


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Result of a check; `text` is its result, `remedy` the fix, empty if none is needed; the program names it."""

    verdict: str
    check: str = field(default="", kw_only=True)
    text: str
    remedy: str = ""

    def __str__(self) -> str:
        line = f"{self.verdict}  {self.check}: {printable(self.text)}"
        return f"{line}\n      -> {self.remedy}" if self.remedy else line


@dataclass(frozen=True, slots=True)
class System:
    """A configuration and its host. `status` and `version` are the running daemon's replies, None and "" without one;
    `root` is the root of the host's file system."""

    config: Config
    directory: Path
    status: Mapping[str, Any] | None = None
    version: str = ""
    root: Path = Path("/")

    @property
    def has_pad(self) -> bool:
        """Whether a trackpad is configured, not a simulated or replayed one."""
        return self.config.trackpad.source in pads.SOURCES

    @property
    def has_board(self) -> bool:
        """Whether a board is configured, not the simulated one."""
        return self.config.device.port != SIMULATED

    @property
    def has_ruled_device(self) -> bool:
        """Whether a device is configured that udev's rule is for: a board, or a pad that is read raw."""
        return self.has_board or self.config.trackpad.source == "hid"

    def reported(self, *path: str) -> Any:
        """Return a value of the daemon's status, None if it is missing."""
        value: Any = self.status
        for key in path:
            value = value.get(key) if isinstance(value, dict) else None
        return value

    def text(self, *parts: str) -> str | None:
        """Return the text of a file of the host, stripped; None if it cannot be read."""
        try:
            return self.root.joinpath(*parts).read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError):
            return None


def is_accessible(path: Path) -> bool:
    """Return whether this user may read and write it."""
    return os.access(path, os.R_OK | os.W_OK)


def as_document(found: Sequence[CheckResult]) -> str:
    """Return the report as JSON: the findings in order, and whether one of them failed."""
    return json.dumps({"failed": has_failed(found), "findings": [asdict(one) for one in found]}, indent=2)


def has_failed(found: Sequence[CheckResult]) -> bool:
    """Return whether one finding is a failure."""
    return any(one.verdict == FAIL for one in found)
