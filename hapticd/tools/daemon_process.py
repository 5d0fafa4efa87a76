"""`hapticd run` as a process of its own, on a simulated rig."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

from . import owned_process

END_WITHIN_S = 10.0


class DaemonProcess:
    """A service from `__enter__` to `__exit__`; `runtime_dir` is where its clients connect.

    `sim` are the lines of its [sim] table: the rig that runs already, or what its own plays; `settings` are more of its
    configuration, as TOML. Clients give it some seconds to start.
    """

    def __init__(self, sim: str, settings: str = "", *, log_level: str = "warning") -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="hapticd-run-")
        self.runtime_dir = Path(self._folder.name, "run")
        self._config = Path(self._folder.name, "hapticd.toml")
        self._config.write_text(
            f'[sim]\n{sim}\n[client]\nruntime_dir = "{self.runtime_dir}"\n[log]\nlevel = "{log_level}"\n{settings}',
            encoding="utf-8",
        )

    def __enter__(self) -> DaemonProcess:
        self.process = owned_process.start(["run", "--config", str(self._config)], scratch=Path(self._folder.name))
        return self

    def __exit__(self, *_: object) -> None:
        self.process.terminate()
        try:
            self.process.wait(END_WITHIN_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        if self.process.stdin is not None:
            self.process.stdin.close()
        self._folder.cleanup()
