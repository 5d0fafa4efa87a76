"""The viewer as a process."""

from __future__ import annotations

import subprocess
import sys


class View:
    """`hapticd view` as a process; `address` is what it printed."""

    def __init__(self, *arguments: str) -> None:
        command = [sys.executable, "-m", "hapticd", "view", "--no-browser", "--port", "0", *arguments]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().partition(": ")[2].strip()

    def end(self) -> int:
        """As Ctrl-C does."""
        self.process.terminate()
        self.process.communicate(timeout=30)
        return self.process.returncode
