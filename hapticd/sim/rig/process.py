"""The simulated rig as a child process."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...errors import DeviceError
from ..fingers.scenarios import SMOOTH
from ..plate.glasses import REFERENCE
from ..plate.wirings import IDENTITY

END_WITHIN_S = 10.0
# In the rig's directory: the mode map, the parasitic modes, and a configuration with the plate's size and limits.
MODES_FILE = "modes.npz"
PARASITIC_MODES_FILE = "neighbours.npz"
PLATE_FILE = "plate.toml"
HISTORY_FILE = "history.npz"
ENDED = "The simulated rig has ended: start this command again."


def watch(process: subprocess.Popen[str], on_end: Callable[[], None]) -> None:
    """Call `on_end`, on the running loop, when a process ends whose output is a pipe that it no longer writes to."""
    loop, pipe = asyncio.get_running_loop(), process.stdout
    assert pipe is not None

    def ended() -> None:  # only the end makes the pipe readable
        loop.remove_reader(pipe)
        on_end()

    loop.add_reader(pipe, ended)


def end(process: subprocess.Popen[str]) -> None:
    """Terminate a process, kill it if it does not end, and close its pipes."""
    process.terminate()
    try:
        process.wait(END_WITHIN_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            pipe.close()


class RigSettings(NamedTuple):
    """Settings of a rig.

    `motion` is that of strokes, one of `scenarios.MOTIONS`; `fingers` a CSV that is played in place of the scenario.
    `plate` is one of `glasses.GLASSES` or a file, `modes` the number of those that are driven, 0 for its own,
    `wiring` one of `wirings.WIRINGS`. With `record` it writes HISTORY_FILE at its end.
    """

    scenario: str
    seed: int
    motion: str = SMOOTH
    fingers: str = ""
    plate: str = REFERENCE
    modes: int = 0
    wiring: str = IDENTITY
    record: bool = False


def command(directory: Path, settings: RigSettings) -> list[str]:
    """Return the command line of a rig that ends with its standard input."""
    # -P: nothing is imported from the current directory.
    return [sys.executable, "-P", "-m", "hapticd.sim.rig.program", str(directory), json.dumps(settings._asdict())]


class RigProcess:
    """A running rig: `directory` holds what a daemon opens, `t_start_s` is its time zero on the monotonic clock.

    With `record`, `history` are the recorded arrays after `close`; until then they lie in `directory`, which the rig
    deletes if its owner dies.
    """

    def __init__(self, scenario: str, seed: int, **others: Any) -> None:
        """Start a rig of these `RigSettings`."""
        settings = RigSettings(scenario, seed, **others)
        self._directory = tempfile.TemporaryDirectory(prefix="hapticd-rig-")
        self.directory = Path(self._directory.name)
        # Its own session, so that a Ctrl-C does not stop the rig before the daemon. The pipe to its input closes with
        # this process, however that ends, and stops the rig.
        line = command(self.directory, settings)
        self.process = subprocess.Popen(
            line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
        )
        assert self.process.stdout is not None
        try:
            ready = self.process.stdout.readline().split()
        except BaseException:  # a Ctrl-C before the caller can close it
            self.close()
            raise
        if len(ready) != 2 or ready[0] != "ready":
            self.close()
            raise DeviceError("The simulated rig did not start: see its message above.")
        self.t_start_s = float(ready[1])

    def __enter__(self) -> RigProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def watch(self, on_end: Callable[[str], None]) -> None:
        """Call `on_end` with a sentence, on the running loop, if the process ends by itself or is killed."""
        watch(self.process, lambda: on_end(ENDED))

    def check(self) -> None:
        """Raise DeviceError if the process has ended by itself or was killed."""
        if self.process.poll() is not None:
            raise DeviceError(ENDED)

    def close(self) -> None:
        """Stop the rig, which first writes its recording."""
        end(self.process)
        if (self.directory / HISTORY_FILE).is_file():
            with np.load(self.directory / HISTORY_FILE) as arrays:
                self.history: dict[str, Any] = dict(arrays)
        self._directory.cleanup()
