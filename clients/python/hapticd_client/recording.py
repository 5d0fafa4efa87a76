"""`Client.record`: a recording while a block of a program runs, made by `hapticd record`; and the text of a marker."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import Any, Final

from hapticd_contract.requests import MAX_MARKER_CHARACTERS

from .endpoint import Endpoint
from .errors import HapticdError

BEGUN: Final = "The recording has begun."  # as `hapticd record` prints it
PROGRAM: Final = "hapticd"


class Recording:
    """Records the daemon to `path` while it is entered (`Client.record`); `summary` says afterwards what it holds."""

    def __init__(self, endpoint: Endpoint, path: Path, lsl: Sequence[str], *, replays: bool) -> None:
        if endpoint.directory is None:
            raise HapticdError("record: this daemon is on another machine: run `hapticd record` there.")
        program = _program()
        if path.exists():
            raise HapticdError(f"{path}: exists already: give another name.")
        self.path = path
        self.summary = ""
        self._command = [*program, "record", str(path), "--endpoint", str(endpoint.directory)]
        self._command += ["--owned", *([] if replays else ["--now"])]
        for name in lsl:
            self._command += ["--lsl", name]
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> Recording:
        """Return once the recording has begun."""
        pipe = subprocess.PIPE
        # A session of its own: Ctrl-C at a terminal ends the program, which ends the recording when its block is left.
        process = subprocess.Popen(
            self._command, stdin=pipe, stdout=pipe, stderr=subprocess.STDOUT, text=True, start_new_session=True
        )
        self._process = process
        assert process.stdout is not None
        said = ""
        for line in process.stdout:
            said = line.strip() or said
            if said == BEGUN:
                return self
        process.communicate()
        raise HapticdError(said.removeprefix("hapticd: ") or f"record: `{PROGRAM} record` ended at once.")

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """End the recording, and return once its file is whole."""
        process, self._process = self._process, None
        if process is None:
            return
        process.send_signal(signal.SIGINT)
        said, _ = process.communicate()
        self.summary = said.strip().rpartition("\n")[2]
        if process.returncode != 0 and error is None:
            raise HapticdError(self.summary.removeprefix("hapticd: ") or f"{self.path}: the recording was lost.")


def _program() -> list[str]:
    """Return the command `hapticd`: of this Python, or of another whose folder is in PATH. Raises HapticdError."""
    if find_spec(PROGRAM) is not None:
        return [sys.executable, "-m", PROGRAM]
    found = shutil.which(PROGRAM)
    if found is None:
        raise HapticdError(
            "record: needs hapticd, not its client alone: install it in this Python, or put its folder into PATH."
        )
    return [found]


def marker_text(fields: Mapping[str, Any]) -> str:
    """Return the text of a structured marker, for a person: name=value, cut to what a marker may have."""
    text = " ".join(f"{name}={value}" for name, value in fields.items())
    printable = "".join(one if one.isprintable() else " " for one in text)
    return printable[:MAX_MARKER_CHARACTERS]
