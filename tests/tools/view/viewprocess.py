"""The viewer as a process."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from pathlib import Path
from typing import Any


def first(process: subprocess.Popen[Any]) -> None:
    """Raise the priority if permitted: other tests on few cores would delay the process."""
    with contextlib.suppress(PermissionError, ProcessLookupError):
        os.setpriority(os.PRIO_PROCESS, process.pid, -10)


class View:
    """`hapticd view` as a process; `address` is what it printed, `scratch` for its temporary files."""

    def __init__(self, *arguments: str, cwd: Path | None = None, scratch: Path | None = None) -> None:
        command = [sys.executable, "-m", "hapticd", "view", "--no-browser", "--port", "0", *arguments]
        env = os.environ if scratch is None else {**os.environ, "TMPDIR": str(scratch)}
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=cwd, env=env)
        first(self.process)
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().partition(": ")[2].strip()

    def end(self) -> int:
        """As Ctrl-C does."""
        self.process.terminate()
        self.process.communicate(timeout=30)
        return self.process.returncode
