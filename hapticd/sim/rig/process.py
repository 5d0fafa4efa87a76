"""Starts the simulated rig as a process of its own, and ends it."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from ...errors import DeviceError

END_WITHIN_S = 10.0
# In the rig's directory: the cartography that was made of its plate, that of the modes beside the driven ones, and the
# section [plate] of a configuration which tells of those what else was measured.
MODES_FILE = "modes.npz"
NEIGHBOURS_FILE = "neighbours.npz"
PLATE_FILE = "plate.toml"


class RigProcess:
    """A running rig: `directory` holds what a daemon opens, `t_start_s` is its time zero on the monotonic clock.

    `program` puts another process behind the board's terminal (`emulator.find_program`).
    """

    def __init__(
        self,
        scenario: str,
        seed: int,
        *,
        record: Path | None = None,
        program: Path | None = None,
    ) -> None:
        self._directory = tempfile.TemporaryDirectory(prefix="hapticd-rig-")
        self.directory = Path(self._directory.name)
        command = [
            sys.executable,
            "-m",
            "hapticd.sim.rig.program",
            str(self.directory),
            "--scenario",
            scenario,
            "--seed",
            str(seed),
            "--owned",
        ]
        if record is not None:
            command += ["--record", str(record)]
        if program is not None:
            command += ["--program", str(program)]
        # Its own session: a Ctrl-C meant for the daemon must not unplug the hardware first. The pipe to its input ends
        # with this process however that ends, and the rig with it.
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
        )
        assert self.process.stdout is not None
        try:
            told = self.process.stdout.readline().split()
        except BaseException:  # a Ctrl-C, before anybody has what could be closed
            self.close()
            raise
        if len(told) != 2 or told[0] != "ready":
            self.close()
            raise DeviceError("The simulated rig did not start: its own message above says why.")
        self.t_start_s = float(told[1])

    def __enter__(self) -> RigProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the rig; it writes its recording first."""
        self.process.terminate()
        try:
            self.process.wait(END_WITHIN_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                pipe.close()
        self._directory.cleanup()
