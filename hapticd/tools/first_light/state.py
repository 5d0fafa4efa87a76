"""State of a commissioning, so that it can be resumed: a file in the configuration's folder, written whole."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import msgspec

from ...design.commissioning.findings import Flaw
from ...errors import CalibrationError, reason
from ...regular_file import read_bounded
from ...sim.commissioning.mistakes import Mistake
from ..outputs import write_text

STATE_FILE = "first-light.json"
MAX_BYTES = 1 << 16


class _Document(msgspec.Struct, kw_only=True):
    """The file; a mistake is its cause, wires and size."""

    version: Literal[1] = 1
    is_simulated: bool
    passed: dict[str, str]
    outputs_v: tuple[float | None, ...]
    mistakes: tuple[tuple[Flaw, tuple[int, ...], float], ...] | None


@dataclass(slots=True)
class Commissioning:
    """Sentences of the steps that have passed, the outputs that were read, and a simulated rig's remaining mistakes."""

    is_simulated: bool
    passed: dict[str, str] = field(default_factory=dict)
    outputs_v: tuple[float | None, ...] = ()
    mistakes: tuple[Mistake, ...] | None = None

    def save(self, folder: Path) -> None:
        """Write the file. Raises HapticdError."""
        left = None if self.mistakes is None else tuple((one.cause, one.wires, one.size) for one in self.mistakes)
        document = _Document(
            is_simulated=self.is_simulated, passed=self.passed, outputs_v=self.outputs_v, mistakes=left
        )
        text = msgspec.json.format(msgspec.json.encode(document), indent=1).decode()
        write_text(text + "\n", folder / STATE_FILE)


def load(folder: Path, *, is_simulated: bool) -> Commissioning:
    """Return the state of a folder, a new one where there is none. Raises CalibrationError."""
    path = folder / STATE_FILE
    if not path.exists():
        return Commissioning(is_simulated)
    try:
        found = msgspec.json.decode(read_bounded(path, MAX_BYTES), type=_Document)
    except (OSError, msgspec.DecodeError, RecursionError) as error:
        raise CalibrationError(f"{path}: cannot be read ({reason(error)}): delete it to begin again.") from None
    if found.is_simulated != is_simulated:
        plate = "a simulated rig" if found.is_simulated else "a real rig"
        raise CalibrationError(f"{path}: is of {plate}: choose another --out.")
    mistakes = None if found.mistakes is None else tuple(Mistake(*one) for one in found.mistakes)
    return Commissioning(found.is_simulated, found.passed, found.outputs_v, mistakes)
