"""`hapticd run` as a child process on a simulated rig, for demo, view and tests."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path
from typing import Self

from ..sim.rig.process import end
from ..tools import owned_process


class DaemonProcess:
    """Context manager of a service whose clients connect at `runtime_dir`; it takes some seconds to start.

    `sim` are the lines of its [sim] table: a running rig, or the scenario of a rig of its own; `settings` are further
    sections of its configuration, as TOML.
    """

    def __init__(self, sim: str, settings: str = "", *, log_level: str = "warning") -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="hapticd-run-")
        self.runtime_dir = Path(self._folder.name, "run")
        self._config = Path(self._folder.name, "hapticd.toml")
        self._config.write_text(f'[sim]\n{sim}\n[log]\nlevel = "{log_level}"\n{settings}', encoding="utf-8")

    def __enter__(self) -> Self:
        command = ["run", "--sim", "--config", str(self._config)]
        self.process = owned_process.start(
            command, scratch=Path(self._folder.name), stdout=subprocess.PIPE, runtime_dir=self.runtime_dir
        )
        return self

    def __exit__(self, *_: object) -> None:
        end(self.process)
        self._folder.cleanup()
