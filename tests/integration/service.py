"""The service and its hardware as processes, and bounded waits for what they do."""

from __future__ import annotations

import os
import selectors
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import asynchronous
import numpy as np
import numpy.typing as npt

from hapticd.board_protocol import BoardState
from hapticd.board_values import BoardStatus
from hapticd.sim.rig.process import HISTORY_FILE, RigSettings, command
from hapticd.wire import device
from hapticd_client import Client, PlateState

PATIENCE_S = 45.0
wait_for = partial(asynchronous.wait_for, patience_s=PATIENCE_S)
PIPE = subprocess.PIPE
ROOT = Path(__file__).parents[2]

Process = TypeVar("Process", bound="subprocess.Popen[Any]")


def first(process: Process) -> Process:
    """With other tests on few cores it would be late for reasons that are not its own: it goes first, if it may."""
    with suppress(PermissionError, ProcessLookupError):
        os.setpriority(os.PRIO_PROCESS, process.pid, -10)
    return process


class Rig:
    """The simulated rig as a process, in a directory that outlives it."""

    def __init__(self, directory: Path, settings: RigSettings) -> None:
        self._record = directory / HISTORY_FILE
        line = command(directory, settings)
        self.process = first(subprocess.Popen(line, stdin=PIPE, stdout=PIPE, text=True))
        assert self.process.stdout is not None
        self.t_start_s = float(self.process.stdout.readline().split()[1])

    def recording(self) -> dict[str, npt.NDArray[np.complex128]]:
        """End it, and what the plate did."""
        self.process.terminate()
        self.close()
        with np.load(self._record) as arrays:
            return dict(arrays)

    def close(self) -> None:
        self.process.communicate(timeout=PATIENCE_S)


class Service:
    """`hapticd run` as a process; with its log in a file."""

    def __init__(self, config: Path, runtime_dir: Path, log: Path) -> None:
        self._log = log
        environ = {**os.environ, "HAPTICD_RUNTIME_DIR": str(runtime_dir)}
        with log.open("w") as file:
            command = [sys.executable, "-m", "hapticd", "run", "--config", str(config)]
            self.process = first(subprocess.Popen(command, env=environ, stderr=file))

    @property
    def lines(self) -> list[str]:
        """Its log lines without the time."""
        return [line.partition(" ")[2] for line in self._log.read_text().splitlines()]

    def lines_with(self, *words: str) -> list[str]:
        """Its lines that hold all these words."""
        return [line for line in self.lines if all(word in line for word in words)]

    def end(self, number: signal.Signals) -> int:
        self.process.send_signal(number)
        return self.process.wait(PATIENCE_S)


class Bench:
    """A folder in which a rig, a service and clients run; `close` ends what is left of them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.rig_dir = folder / "rig"
        self.rig_dir.mkdir()
        self.runtime_dir = folder / "run"
        self.config = folder / "hapticd.toml"
        self.config.write_text(f'[sim]\nrig_dir = "{self.rig_dir}"\n', encoding="utf-8")
        self._running: list[subprocess.Popen[str] | subprocess.Popen[bytes]] = []
        self._clients: list[Client] = []
        self._services = 0

    def rig(self, scenario: str = "circles", **others: Any) -> Rig:
        rig = Rig(self.rig_dir, RigSettings(scenario, 1, **others))
        self._running.append(rig.process)
        return rig

    def service(self) -> Service:
        self._services += 1
        service = Service(self.config, self.runtime_dir, self.folder / f"log-{self._services}")
        self._running.append(service.process)
        return service

    def client(self, name: str = "test") -> Client:
        client = Client(self.runtime_dir, name, timeout_s=PATIENCE_S)
        self._clients.append(client)
        return client

    def program(self, *arguments: str) -> subprocess.Popen[str]:
        """A Python program of a client's."""
        environ = {**os.environ, "PYTHONPATH": str(ROOT / "clients" / "python"), "PYTHONUNBUFFERED": "1"}
        process = subprocess.Popen([sys.executable, *arguments], env=environ, stdout=PIPE, stderr=PIPE, text=True)
        self._running.append(process)
        return process

    def driven(self, scenario: str = "circles", *, record: bool = False) -> tuple[Rig, Service, Client, PlateState]:
        """A rig, a service and a client that has one finger slip and one stick, and the first state with both."""
        rig, service, client = self.rig(scenario, record=record), self.service(), self.client()
        return rig, service, client, drive(client)

    def configure(self, text: str) -> None:
        """Add sections to the configuration."""
        with self.config.open("a", encoding="utf-8") as file:
            file.write(text)

    def close_clients(self) -> None:
        for client in self._clients:
            client.close()

    def close(self) -> None:
        self.close_clients()
        for process in reversed(self._running):
            if process.poll() is None:
                process.kill()
            for pipe in (process.stdin, process.stdout, process.stderr):
                if pipe is not None:
                    pipe.close()
            process.wait(PATIENCE_S)


@contextmanager
def opened() -> Iterator[Bench]:
    """A bench in a folder with a short name, for a socket allows 107 bytes, and an end to all that runs in it."""
    with tempfile.TemporaryDirectory(prefix="hd-") as folder:
        bench = Bench(Path(folder))
        try:
            yield bench
        finally:
            bench.close()


def wait_state(client: Client, condition: Callable[[PlateState], bool]) -> PlateState:
    """The first state from now on that meets the condition."""
    t_end_s = time.monotonic() + PATIENCE_S
    for state in client.states(timeout_s=PATIENCE_S):
        if condition(state):
            return state
        assert time.monotonic() < t_end_s, f"still {state}"
    raise AssertionError("the states ended")


def wait_board(rig_dir: Path, state: BoardState, statuses: int) -> BoardStatus:
    """Read the board in place of the daemon until it has reported this state so many times."""
    fd = os.open(rig_dir / "board", os.O_RDWR | os.O_NOCTTY)
    decoder = device.Decoder()
    try:
        with selectors.DefaultSelector() as selector:
            selector.register(fd, selectors.EVENT_READ)
            while selector.select(PATIENCE_S):
                for message in decoder.feed(os.read(fd, 4096)):
                    statuses -= isinstance(message, BoardStatus) and message.state is state
                    if isinstance(message, BoardStatus) and statuses <= 0:
                        return message
    finally:
        os.close(fd)
    raise AssertionError("the board is silent")


def resident_mb(pid: int) -> float:
    """The memory that a process holds."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii").split()
    return int(status[status.index("VmRSS:") + 1]) / 1024


def is_driven(state: PlateState) -> bool:
    """Two fingers are down, one slips and one sticks, and the plate moves."""
    targets_um = sorted(finger.target_um for finger in state.fingers if finger.target_um is not None)
    is_served = len(targets_um) == 2 and targets_um[0] == 0.0 < targets_um[1]
    return state.state == "ACTIVE" and is_served and any(map(abs, state.modal_um))


def is_quiet(state: PlateState) -> bool:
    """No finger gets anything."""
    return not any(state.modal_um) and not any(finger.target_um for finger in state.fingers)


def drive(client: Client) -> PlateState:
    """Ask for a slippery and a sticky finger, until the board follows."""
    asked: list[int | str] = []

    def is_followed(state: PlateState) -> bool:
        fingers = sorted(state.fingers, key=lambda finger: finger.x_mm)
        ids = [finger.id for finger in fingers]
        if len(ids) == 2 and ids != asked:  # a machine that stood still lifts them, and others land
            asked[:] = ids
            for finger, amplitude_um in zip(fingers, (1.0, 0.0), strict=True):
                client.set(finger, amplitude_um=amplitude_um)
        return is_driven(state)

    wait_state(client, is_followed)
    wait_for(lambda: bool(client.status()["board"].get("state") == "LIVE"))
    return wait_state(client, is_followed)
