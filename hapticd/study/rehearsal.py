"""`--sim`: the service on the simulated plate, as a process, for a rehearsal without hardware."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from types import TracebackType

SCENARIO = "virtual-finger"  # its one finger on the plate explores in strokes; the virtual one is the client's own
END_WITHIN_S = 10.0


class Rehearsal:
    """A running `hapticd run` on its own simulated rig; `runtime_dir` is where its clients connect.

    As a context manager; clients give it some seconds to start. It is ended with the context.
    """

    def __init__(self, scenario: str = SCENARIO) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="hapticd-study-")
        self.runtime_dir = Path(self._folder.name, "run")
        config = Path(self._folder.name, "hapticd.toml")
        config.write_text(
            f'[sim]\nscenario = "{scenario}"\n[client]\nruntime_dir = "{self.runtime_dir}"\n[log]\nlevel = "error"\n'
            "[trackpad]\nsilence_ms = 1000\n",  # a computer that stalls must not lift the simulated finger
            encoding="utf-8",
        )
        self._command = [sys.executable, "-m", "hapticd", "run", "--config", str(config)]

    def __enter__(self) -> Rehearsal:
        # Its own session: a Ctrl-C ends the study first, and the study ends the service.
        self._process = subprocess.Popen(self._command, start_new_session=True)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._process.terminate()
        try:
            self._process.wait(END_WITHIN_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._folder.cleanup()
