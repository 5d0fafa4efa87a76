"""Clients over TCP: served with an allowed key, refused without."""

from __future__ import annotations

import asyncio
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import zmq
from fake_daemon import FakeDaemon
from free_ports import free_ports
from PIL import Image

from hapticd.errors import HapticdError as DaemonError
from hapticd.io.clients import keys
from hapticd.io.clients.server import ClientServer
from hapticd.io.clients.sockets import Remote
from hapticd_client import Client, DaemonGoneError, HapticdError, RefusedError

REFUSED_S = 0.3  # longer than a successful handshake, which takes milliseconds
ALLOWED = ("ann", "bob")


# What Windows lacks is taken out of Python; not its name, by which pathlib would look for drives.
ELSEWHERE = """
import os, sys
import msgspec, numpy, zmq
for name in ("fcntl", "termios", "resource", "pwd", "grp", "tty", "pty"):
    sys.modules[name] = None
for name in ("O_CLOEXEC", "O_NONBLOCK", "getuid", "geteuid", "fork", "sched_getaffinity"):
    delattr(os, name)
os.name = "other"
from hapticd_client import Client, HapticdError
address, server_key, own_key, picture = sys.argv[1:]
with Client(address, timeout_s=20.0, server_key=server_key, own_key=own_key) as far:
    (finger,) = far.fingers(timeout_s=20.0)
    far.set(finger, friction=0.2)
    far.surface("disc", amplitude_um=0.5)
    far.asset(picture)
    far.marker({"trial": 1})
    print(next(state.fingers[0].target_um > 0 for state in far.states(20.0) if state.fingers[0].target_um is not None))
try:
    Client()
except HapticdError as error:
    print(error)
"""


@pytest.fixture(scope="module")
def key_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The daemon's keys, those of two clients that it allows, and those of one that it does not."""
    folder = tmp_path_factory.mktemp("keys")
    keys.make_pair(folder, "hapticd")
    for name in (*ALLOWED, "eve"):
        keys.make_pair(folder, name)
    for name in ALLOWED:
        keys.allow(folder, folder / f"{name}.key")
    return folder


@pytest.fixture
def remote(tmp_path: Path, key_files: Path) -> Iterator[FakeDaemon]:
    served = Remote("127.0.0.1", free_ports(), keys.load(key_files))
    running = FakeDaemon(tmp_path, served)
    running.start()
    yield running
    running.stop()


def address(daemon: FakeDaemon) -> str:
    return f"tcp://{daemon.remote.host}:{daemon.remote.port}"


def client(daemon: FakeDaemon, key_files: Path, key: str, name: str | None = None, timeout_s: float = 5.0) -> Client:
    server_key, own_key = key_files / "hapticd.key", key_files / f"{key}.key_secret"
    return Client(address(daemon), name, timeout_s=timeout_s, server_key=server_key, own_key=own_key)


def test_a_client_with_an_allowed_key_sets_and_reads_over_tcp(remote: FakeDaemon, key_files: Path) -> None:
    remote.fingers = {1: (3.0, 4.0)}
    with client(remote, key_files, "ann") as far:
        (finger,) = far.fingers(timeout_s=5.0)
        far.set(finger, amplitude_um=1.5)
        assert next(state for state in far.states() if state.fingers[0].target_um == 1.5)


def test_the_client_needs_nothing_that_windows_lacks(remote: FakeDaemon, key_files: Path, tmp_path: Path) -> None:
    remote.fingers = {1: (3.0, 4.0)}
    picture, own_key = tmp_path / "grey.png", tmp_path / "ann.key_secret"
    Image.new("L", (8, 8), 99).save(picture)
    shutil.copy(key_files / "ann.key_secret", own_key)
    own_key.chmod(0o666)  # as each file of Windows seems
    arguments = [address(remote), str(key_files / "hapticd.key"), str(own_key), str(picture)]
    done = subprocess.run([sys.executable, "-c", ELSEWHERE, *arguments], capture_output=True, text=True, timeout=100)
    assert done.stderr == ""
    assert done.stdout.splitlines() == [
        "True",
        "No daemon runs on this system: give the tcp:// endpoint of one, with two keys.",
    ]
    assert [one.fields for one in remote.markers] == [{"trial": 1}]


def test_a_key_that_is_not_allowed_gets_no_answer_and_is_counted(remote: FakeDaemon, key_files: Path) -> None:
    with pytest.raises(DaemonGoneError, match="and that it allows yours"):
        client(remote, key_files, "eve", timeout_s=REFUSED_S)
    assert remote.server.counters["denied"] >= 1


def test_a_client_without_keys_gets_no_answer_on_any_port(remote: FakeDaemon) -> None:
    with zmq.Context() as context:
        for offset, kind in enumerate((zmq.PUSH, zmq.DEALER, zmq.SUB)):
            with context.socket(kind) as naked:
                naked.linger = 0
                naked.immediate = True
                if kind == zmq.SUB:
                    naked.subscribe(b"")
                naked.connect(f"tcp://127.0.0.1:{remote.remote.port + offset}")
                event = zmq.POLLIN if kind == zmq.SUB else zmq.POLLOUT
                assert naked.poll(int(REFUSED_S * 1000), event) == 0
    assert remote.messages == 0


def test_a_name_is_its_keys_and_its_users_alone(remote: FakeDaemon, key_files: Path) -> None:
    with client(remote, key_files, "ann", "study") as ann:
        ann.set(1, amplitude_um=1.0)
        with client(remote, key_files, "bob", "study") as bob, pytest.raises(RefusedError, match="in use by key ann"):
            bob.set(1, amplitude_um=2.0)
        with Client(remote.directory, "study") as local, pytest.raises(RefusedError, match="in use by key ann"):
            local.release()
        assert remote.scene.amplitude_um(1, 0.0, 0.0) == 1.0


def test_two_daemons_on_one_port_are_one_too_many(remote: FakeDaemon, tmp_path: Path, key_files: Path) -> None:

    async def start_second() -> None:
        second = ClientServer(tmp_path / "second", remote.remote)
        try:
            second.start(asyncio.get_running_loop(), lambda *_: None, lambda payload, *_: payload)
        finally:
            second.close()

    with pytest.raises(DaemonError, match=r"TCP port \d+: clients cannot be served here \(Address already in use"):
        asyncio.run(start_second())
    with client(remote, key_files, "ann") as far:
        assert far.status()["messages"] == 0


# --- what the library refuses ------------------------------------------------------------------------------------


def test_address_and_keys_belong_together(tmp_path: Path, key_files: Path) -> None:
    pair = {"server_key": key_files / "hapticd.key", "own_key": key_files / "ann.key_secret"}
    with pytest.raises(HapticdError, match="needs two keys"):
        Client("tcp://127.0.0.1:7410")
    with pytest.raises(HapticdError, match="need a tcp:// endpoint"):
        Client(tmp_path, **pair)
    for wrong in ("tcp://", "tcp://host", "tcp://:7410", "tcp://host:0", "tcp://host:65534", "tcp://host:x"):
        with pytest.raises(HapticdError, match="must be an address and a port"):
            Client(wrong, **pair)


def test_a_key_that_is_none_or_no_secret_is_refused(tmp_path: Path, key_files: Path) -> None:
    server_key = key_files / "hapticd.key"
    with pytest.raises(HapticdError, match="contains no secret"):
        Client("tcp://127.0.0.1:7410", server_key=server_key, own_key=key_files / "ann.key")
    with pytest.raises(HapticdError, match="is not a ZeroMQ certificate"):
        Client("tcp://127.0.0.1:7410", server_key=server_key, own_key=tmp_path / "gone")
    open_secret = tmp_path / "open.key_secret"
    open_secret.write_bytes((key_files / "ann.key_secret").read_bytes())
    open_secret.chmod(0o644)
    with pytest.raises(HapticdError, match="other users may read"):
        Client("tcp://127.0.0.1:7410", server_key=server_key, own_key=open_secret)
