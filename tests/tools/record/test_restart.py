"""A recorder that attaches in mid-session gets a recording that replays: the core restarts while idle.

The daemon runs on this process's loop, over a simulated rig in real time that a person's fingers touch; recorders and
clients are threads, and one that is killed a process.
"""

from __future__ import annotations

import asyncio
import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import zmq
from asynchronous import PATIENCE_S, until

from hapticd.config.sections import Config
from hapticd.daemon import recorder as recorders
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.io.host.systemd import Notifier
from hapticd.sim.rig.process import RigProcess
from hapticd.tools import service
from hapticd.tools.record.attach import BEGUN, LATE, WAITING, record
from hapticd.tools.record.replay import replay
from hapticd.tools.service import ConfigLoader
from hapticd.tools.view.rig import PadSender
from hapticd_client import Client
from hapticd_contract.simulated import SimulatedTouch

pytestmark = pytest.mark.long

BEAT_S = 0.015
STATES = 120  # more than a second of touching


@pytest.fixture(scope="module")
def rig() -> Iterator[RigProcess]:
    with RigProcess("hands", 1) as running:
        yield running


@pytest.fixture
def configuration(rig: RigProcess, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Config:
    monkeypatch.setenv("HAPTICD_RUNTIME_DIR", str(tmp_path / "run"))
    return replace(Config(), sim=replace(Config().sim, rig_dir=str(rig.directory)))


@contextmanager
def hands(rig_dir: Path) -> Iterator[None]:
    """Two fingers circle on the plate meanwhile."""
    lifted = threading.Event()

    def move() -> None:
        with zmq.Context() as context:
            hand = PadSender(context, rig_dir)
            while not lifted.wait(BEAT_S):
                turn = 6.0 * time.monotonic()
                x_mm, y_mm = 15.0 * math.cos(turn), 15.0 * math.sin(turn)
                right = SimulatedTouch(30.0 + x_mm, y_mm - 5.0)
                hand.hold({"left": SimulatedTouch(x_mm - 30.0, y_mm), "right": right})
            hand.hold({})
            lifted.wait(BEAT_S)
            hand.close()

    moving = threading.Thread(target=move)
    moving.start()
    try:
        yield
    finally:
        lifted.set()
        moving.join()


def runtime_dir() -> Path:
    return Path(os.environ["HAPTICD_RUNTIME_DIR"])


def new_client() -> Client:
    return Client(runtime_dir(), timeout_s=PATIENCE_S)


def work(config: Config, states: int = STATES, begun: threading.Event | None = None) -> set[int]:
    """A client sets targets of two fingers, then `begun`, and releases them in the end; returns the daemon's instances
    that it saw."""
    with new_client() as client, hands(Path(config.sim.rig_dir)):
        seen: set[int] = set()
        for count, state in enumerate(client.states(timeout_s=PATIENCE_S)):
            seen.add(state.instance)
            free = [finger for finger in state.fingers if finger.target_um is None]
            for number, finger in enumerate(free):
                client.set(finger, amplitude_um=float(number))
            if begun is not None and free:
                begun.set()
            if count > states and len(state.fingers) == 2:
                break
        client.release()
    return seen


class Recorder(threading.Thread):
    """`hapticd record` on a thread of its own, with its notes to the person."""

    def __init__(self, out: Path, seconds: float) -> None:
        super().__init__()
        self.out = out
        self.notes: list[str] = []
        self._arguments = out, runtime_dir(), seconds
        self.start()

    def run(self) -> None:
        self.notes.append(record(*self._arguments, notify=self.notes.append))


def run(config: Config, scenario: Callable[[], Any], reread: Callable[[], Config] | None = None) -> None:
    """`hapticd run` with this configuration, until the scenario ends."""

    async def served() -> None:
        with ConfigLoader() as config_loader:
            prepared = await asyncio.to_thread(config_loader.prepare, config)
            serving = asyncio.create_task(service._serve(config_loader, prepared, Notifier({}), reread))
            try:
                await until(lambda: (runtime_dir() / "control").is_socket() or serving.done())
                await scenario()
            finally:
                os.kill(os.getpid(), signal.SIGTERM)
                await asyncio.wait_for(serving, PATIENCE_S)

    asyncio.run(served())


def judged(path: Path) -> Counter[str]:
    """The kinds of its records, after it was replayed bit for bit."""
    recording = open_recording(path)
    outcome = replay(recording)
    assert recording.is_whole
    assert outcome.is_identical, outcome
    return Counter(one.kind for one in recording.records())


@pytest.mark.alone  # what is recorded in 2.5 s of real time needs a rig that is on time
def test_a_recorder_in_mid_session_waits_for_a_free_plate_and_replays(configuration: Config, tmp_path: Path) -> None:
    instances: list[set[int]] = []

    async def scenario() -> None:
        begun = threading.Event()
        touching = asyncio.create_task(asyncio.to_thread(work, configuration, STATES, begun))
        await until(begun.is_set)
        late = Recorder(tmp_path / "a.mcap", 2.5)
        await until(lambda: WAITING in late.notes)
        instances.append(await touching)
        await until(lambda: BEGUN in late.notes)
        instances.append(await asyncio.to_thread(work, configuration))
        await until(lambda: not late.is_alive())
        assert late.notes[:2] == [WAITING, BEGUN]

    run(configuration, scenario)
    kinds = judged(tmp_path / "a.mcap")
    assert kinds["reports"] > 20
    assert kinds["targets"] + kinds["request"] > 0
    assert kinds["watched"] > 0
    assert len(instances[0]) == 1
    assert not instances[0] & instances[1]


def test_one_after_another_and_one_that_is_killed_all_replay(
    configuration: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorders, "RESTART_EVERY_NS", 0)
    endpoint = ["--endpoint", str(runtime_dir())]
    command = [sys.executable, "-m", "hapticd", "record", str(tmp_path / "killed.mcap"), *endpoint]
    reported: list[dict[str, Any]] = []

    def recording() -> dict[str, Any]:
        with new_client() as client:
            return dict(client.status().get("recording", {}))

    async def scenario() -> None:
        for name in ("a", "b"):
            whole = Recorder(tmp_path / f"{name}.mcap", 1.0)
            await until(lambda whole=whole: BEGUN in whole.notes)  # type: ignore[misc]
            await asyncio.to_thread(work, configuration, 25)
            await until(lambda whole=whole: not whole.is_alive())  # type: ignore[misc]
        with subprocess.Popen(command, stdout=subprocess.PIPE) as killed:
            assert killed.stdout is not None
            assert (await asyncio.to_thread(killed.stdout.readline)).decode().strip() in (WAITING, BEGUN)
            await until(lambda: (tmp_path / "killed.mcap").exists())
            await asyncio.to_thread(work, configuration, 2 * STATES)
            joined = Recorder(tmp_path / "joined.mcap", 0.2)
            reported.append(await asyncio.to_thread(recording))
            await until(lambda: not joined.is_alive())
            assert LATE in joined.notes
            killed.kill()
        while "attached" in await asyncio.to_thread(recording):
            pass
        last = Recorder(tmp_path / "last.mcap", 0.5)
        await until(lambda: not last.is_alive())
        assert BEGUN in last.notes

    run(configuration, scenario)
    for name in ("a", "b", "killed", "last"):
        assert judged(tmp_path / f"{name}.mcap")["written"] > 10
    assert not open_recording(tmp_path / "joined.mcap").is_whole
    attached = reported[0]["attached"]
    assert (attached["is_whole"], attached["dropped"]) == (True, 0)
    assert attached["bytes"] > 10_000


def test_a_new_configuration_ends_the_recording_and_it_replays_to_its_end(
    configuration: Config, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "hapticd")

    async def scenario() -> None:
        whole = Recorder(tmp_path / "a.mcap", 60.0)
        await until(lambda: BEGUN in whole.notes)
        await asyncio.to_thread(work, configuration, 25)
        os.kill(os.getpid(), signal.SIGHUP)
        await until(lambda: not whole.is_alive())
        await until(lambda: caplog.text.count("serving clients in") == 2)

    run(configuration, scenario, lambda: configuration)
    kinds = judged(tmp_path / "a.mcap")
    assert (kinds["stop"], kinds["disconnect"], kinds["end"]) == (1, 1, 1)
