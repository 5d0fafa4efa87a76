"""`hapticd run` in the guest on a board outside: with an Apple trackpad as a user with no other right than the rules
give, and with other touch devices, which are not in the rules, as root."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
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
silence_ms = 1000
{{trackpad}}
[device]
port = "{BOARD}"
[plate]
modes_file = "{os.environ["GUEST_RIG"]}/modes.npz"
[client]
runtime_dir = "{RUNTIME}"
"""


class Daemon:
    """The service as a process; what it says goes to a file."""

    def __init__(self, trackpad: str = 'source = "hid"', user: Sequence[str] = rules.AS_USER) -> None:
        if user:
            os.chown(BOARD, rules.UID, rules.UID)  # the rules are for boards on USB
        CONFIG.write_text(CONFIGURATION.format(trackpad=trackpad), encoding="utf-8")
        with LOG.open("w") as file:
            command = [*user, sys.executable, "-m", "hapticd", "run", "--config", str(CONFIG)]
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

    def kill(self) -> None:
        """End it, if it still runs: another one may serve after it."""
        self._process.kill()
        self._process.wait(PATIENCE_S)

    def end(self) -> int:
        self._process.terminate()
        return self._process.wait(PATIENCE_S)
