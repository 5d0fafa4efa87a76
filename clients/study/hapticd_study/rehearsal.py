"""`hapticd run --sim` as a child process, for a session without hardware."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import Self

from .experiment import StudyError

SCENARIO = "virtual-finger"  # its finger explores in strokes; the virtual one is the client's own
# The service ends with its owner, however the owner dies: the kernel then closes the standard input that is read here.
OWNED = '"$@" & read -r _; kill $! 2>/dev/null; wait'


class Rehearsal:
    """Context manager of a service on the simulated plate, whose clients connect at `runtime_dir`; it starts in some
    seconds. Raises StudyError where hapticd is not installed."""

    def __init__(self) -> None:
        if find_spec("hapticd") is None:
            raise StudyError("--sim needs hapticd in this Python: install its checkout too, or omit --sim.")
        self._folder = tempfile.TemporaryDirectory(prefix="hapticd-study-")
        self.runtime_dir = Path(self._folder.name, "run")

    def __enter__(self) -> Self:
        config = Path(self._folder.name, "hapticd.toml")
        config.write_text('[log]\nlevel = "error"\n', encoding="utf-8")
        hapticd = [sys.executable, "-P", "-m", "hapticd"]
        self._process = subprocess.Popen(
            ["/bin/sh", "-c", OWNED, "sh", *hapticd, "run", "--sim", "--scenario", SCENARIO, "--config", str(config)],
            env=os.environ | {"HAPTICD_RUNTIME_DIR": str(self.runtime_dir)},
            stdin=subprocess.PIPE,
            start_new_session=True,  # a Ctrl-C reaches only the owner
        )
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()
        self._folder.cleanup()
