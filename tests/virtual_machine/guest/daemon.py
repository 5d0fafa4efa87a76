"""`hapticd run` in the guest, as a user with no other right than the rules give, on a board outside."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import rules
from kernel import PATIENCE_S, wait_for

from hapticd_client import Client

CONFIG = Path("/run/tmp/hapticd.toml")
RUNTIME = Path("/run/tmp/hapticd")
BOARD = Path("/dev/ttyS1")  # behind it is the simulated rig, outside
LOG = Path("/run/results/daemon.log")
# An emulated machine is late: its pauses must not count as lifted fingers.
CONFIGURATION = f"""
[trackpad]
source = "hid"
silence_ms = 1000
[device]
port = "{BOARD}"
[plate]
modes_file = "{os.environ["GUEST_RIG"]}/modes.npz"
[client]
runtime_dir = "{RUNTIME}"
"""


class Daemon:
    """The service as a process; what it says goes to a file."""

    def __init__(self) -> None:
        os.chown(BOARD, rules.UID, rules.UID)  # the rules are for boards on USB
        CONFIG.write_text(CONFIGURATION, encoding="utf-8")
        with LOG.open("w") as file:
            command = [*rules.AS_USER, sys.executable, "-m", "hapticd", "run", "--config", str(CONFIG)]
            self._process = subprocess.Popen(command, stderr=file, cwd="/")
        wait_for("a serving daemon", self._is_serving)

    def _is_serving(self) -> bool:
        if (code := self._process.poll()) is not None:
            raise RuntimeError(f"the daemon ended with {code}")
        return any("serving clients" in line for line in self.lines())

    def lines(self) -> list[str]:
        """What it said, without the time of day."""
        return [line.partition(" ")[2] for line in LOG.read_text(encoding="utf-8").splitlines()]

    def client(self) -> Client:
        return Client(RUNTIME, "guest", timeout_s=PATIENCE_S)

    def end(self) -> int:
        self._process.terminate()
        return self._process.wait(PATIENCE_S)
