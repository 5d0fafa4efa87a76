"""State of a commissioning, so that it can be resumed: a file in the configuration's folder, written whole."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...design.commissioning.findings import Flaw
from ...errors import CalibrationError, reason
from ...regular_file import read_bounded
from ...sim.commissioning.mistakes import Mistake
from ..outputs import write_text

STATE_FILE = "first-light.json"
VERSION = 1
MAX_BYTES = 1 << 16


@dataclass(slots=True)
class Commissioning:
    """Sentences of the steps that have passed, the outputs that were read, and a simulated rig's remaining mistakes."""

    is_simulated: bool
    passed: dict[str, str] = field(default_factory=dict)
    outputs_v: tuple[float | None, ...] = ()
    mistakes: tuple[Mistake, ...] | None = None

    def save(self, folder: Path) -> None:
        """Write the file. Raises HapticdError."""
        document = {
            "version": VERSION,
            "is_simulated": self.is_simulated,
            "passed": self.passed,
            "outputs_v": self.outputs_v,
            "mistakes": None
            if self.mistakes is None
            else [[one.cause.value, list(one.wires), one.size] for one in self.mistakes],
        }
        write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", folder / STATE_FILE)


def load(folder: Path, *, is_simulated: bool) -> Commissioning:
    """Return the state of a folder, a new one where there is none. Raises CalibrationError."""
    path = folder / STATE_FILE
    if not path.exists():
        return Commissioning(is_simulated)
    try:
        found = _read(json.loads(read_bounded(path, MAX_BYTES)))
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise CalibrationError(f"{path}: cannot be read ({reason(error)}): delete it to begin again.") from None
    if found.is_simulated != is_simulated:
        plate = "a simulated rig" if found.is_simulated else "a real rig"
        raise CalibrationError(f"{path}: is of {plate}: choose another --out.")
    return found


def _read(document: Any) -> Commissioning:
    if document["version"] != VERSION:
        raise ValueError(f"version {document['version']!r} is not {VERSION}")
    mistakes = document["mistakes"]
    outputs_v = tuple(None if value is None else float(value) for value in document["outputs_v"])
    if not all(value is None or math.isfinite(value) for value in outputs_v):
        raise ValueError("an output is not finite")
    return Commissioning(
        bool(document["is_simulated"]),
        {str(name): str(sentence) for name, sentence in dict(document["passed"]).items()},
        outputs_v,
        None
        if mistakes is None
        else tuple(Mistake(Flaw(cause), tuple(map(int, wires)), float(size)) for cause, wires, size in mistakes),
    )
