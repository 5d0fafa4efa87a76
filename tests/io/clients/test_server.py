"""The daemon's sockets: who gets in, that nothing is left unread, and that two daemons never share a directory."""

from __future__ import annotations

import asyncio
import dataclasses
import os
import stat
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import zmq
from asynchronous import asynchronous, until
from client_sockets import Served, connected, in_thread, secured, served

from hapticd.errors import HapticdError
from hapticd.io.clients import server as server_module
from hapticd.io.clients.inbox import MAX_READS
from hapticd.io.clients.record_socket import RecordSocket
from hapticd.io.clients.runtime_dir import own_directory
from hapticd.io.clients.server import BREAK_S, MAX_MESSAGE_BYTES, ClientServer, runtime_directory
from hapticd.io.clients.sockets import Remote

# --- targets ----------------------------------------------------------------------------------------------------


@asynchronous
async def test_of_messages_that_wait_the_newest_of_each_client_is_handled(tmp_path: Path) -> None:
    async with held(tmp_path, zmq.PUSH, 2) as (running, clients):
        for n in range(MAX_READS - 1):
            for name, client in zip("ab", clients, strict=True):
                client.send(f"{name}{n}".encode())
        newest = [f"{name}{MAX_READS - 2}".encode() for name in "ab"]
        await until(lambda: sorted(running.waiting()) == newest)
        running.resume()
        await until(lambda: sorted(running.messages) == newest)  # the second may come after a break
        assert running.server.counters["too_fast"] == 0


@asynchronous
async def test_clients_with_expensive_messages_are_handled_alternately(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server_module, "BUDGET_S", 0.0)  # each message takes too long
    async with held(tmp_path, zmq.DEALER, 3) as (running, clients):
        for n in range(4):
            for client in clients:
                client.send(b"%d" % n)
        await until(lambda: len(running.waiting()) == 12)
        running.resume()
        await until(lambda: len(running.requests) == 12)
        assert running.requests == [b"%d" % n for n in range(4) for _ in clients]


@asynchronous
async def test_after_expensive_messages_the_loop_is_free_for_as_long_as_they_took(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with held(tmp_path, zmq.PUSH, 3) as (running, clients):
        loop, late_s, breaks_s = asyncio.get_running_loop(), 0.0, list[float]()
        now, later = loop.time, loop.call_later

        def slow(payload: bytes, *_: object) -> None:
            nonlocal late_s
            late_s += 4 * BREAK_S  # a clock that is moved: nothing is waited for
            running.messages.append(payload)

        def call_later(delay_s: float, callback: Any, *args: Any) -> asyncio.TimerHandle:
            if callback == running.server._resume:
                breaks_s.append(delay_s)
            return later(0.0, callback, *args)

        for client in clients:
            client.send(b"expensive")
        await until(lambda: len(running.waiting()) == 3)
        monkeypatch.setattr(loop, "time", lambda: now() + late_s)
        monkeypatch.setattr(loop, "call_later", call_later)
        assert running.server._service is not None
        monkeypatch.setattr(running.server, "_service", dataclasses.replace(running.server._service, on_message=slow))
        running.resume()
        await until(lambda: len(running.messages) == 3)
        assert len(breaks_s) == 3  # after the last one too
        assert min(breaks_s) >= 4 * BREAK_S


@pytest.mark.parametrize("kind", [zmq.PUSH, zmq.DEALER])
@asynchronous
async def test_a_message_comes_with_the_time_for_which_it_has_waited(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: int
) -> None:
    async with held(tmp_path, kind, 1) as (running, (client,)):
        client.send(b"message")
        await until(lambda: running.waiting() == [b"message"])
        (box,) = running.inboxes
        monkeypatch.setattr(asyncio.get_running_loop(), "time", lambda: box._t_arrived_s + 0.25)
        running.resume()
        monkeypatch.undo()
        assert running.waited_ns == [pytest.approx(0.25e9)]


@pytest.mark.parametrize("transport", ["ipc", "tcp"])
@pytest.mark.parametrize("kind", [zmq.PUSH, zmq.DEALER])
@pytest.mark.parametrize("waits_in", ["the daemon", "ZeroMQ"])
@asynchronous
async def test_after_the_end_of_a_client_none_of_its_messages_is_handled(
    tmp_path: Path, kind: int, transport: str, waits_in: str
) -> None:
    remote, options = (None, {}) if transport == "ipc" else secured(tmp_path / "keys")
    async with held(tmp_path, kind, 2, remote, **options) as (running, (dead, living)):
        for n in range(100):
            dead.send(b"%d" % n, zmq.NOBLOCK)
        await until(lambda: any(box.has_more for box in running.inboxes))
        if waits_in == "the daemon":
            assert len(running.waiting()) > 0
        dead.close()
        await until(lambda: len(running.inboxes) == 1)
        living.send(b"living")
        await until(lambda: running.waiting() == [b"living"])
        running.resume()
        await until(lambda: bool(running.messages + running.requests))
        assert running.messages + running.requests == [b"living"]


@asynccontextmanager
async def held(
    directory: Path, kind: int, count: int, remote: Remote | None = None, **options: Any
) -> AsyncIterator[tuple[Served, list[zmq.Socket[bytes]]]]:
    """Connected clients of a server that handles nothing until it resumes."""
    name = "targets" if kind == zmq.PUSH else "control"
    async with served(directory, remote) as running, AsyncExitStack() as stack:
        running.hold()
        clients = [stack.enter_context(connected(directory, kind, name, remote, **options)) for _ in range(count)]
        await until(lambda: len(running.inboxes) == count)
        yield running, clients


@asynchronous
async def test_a_message_in_parts_is_dropped_and_counted(tmp_path: Path) -> None:
    async with served(tmp_path) as running:
        with connected(tmp_path, zmq.PUSH, "targets") as client:
            client.send_multipart([b"a", b"b"])
            client.send_multipart([b"x"] * 1000)
            client.send(b"whole")
            await running.until(lambda: running.messages == [b"whole"])
            assert running.server.counters["misshapen"] == 2


@asynchronous
async def test_an_oversize_message_costs_its_sender_only_that_message(tmp_path: Path) -> None:
    async with served(tmp_path) as running:
        with (
            connected(tmp_path, zmq.PUSH, "targets", reconnect_ivl=10) as rude,
            connected(tmp_path, zmq.PUSH, "targets") as polite,
        ):
            rude.send(bytes(MAX_MESSAGE_BYTES + 1))
            polite.send(b"polite")
            await running.until(lambda: b"polite" in running.messages)
            service = running.server._service
            assert service is not None
            await running.until(lambda: service.gate._connections == 3)  # it has reconnected
            assert await in_thread(lambda: rude.poll(4000, zmq.POLLOUT))
            rude.send(bytes(MAX_MESSAGE_BYTES))
            await running.until(lambda: bytes(MAX_MESSAGE_BYTES) in running.messages)
            assert len(running.messages) == 2


# --- control ----------------------------------------------------------------------------------------------------


@asynchronous
async def test_a_request_in_several_parts_is_refused_and_the_next_is_answered(tmp_path: Path) -> None:
    async with served(tmp_path) as running:
        with connected(tmp_path, zmq.DEALER, "control") as client:
            client.send_multipart([b"a", b"b"])
            assert await in_thread(client.recv_multipart) == [b"one part, please"]
            client.send_multipart([b""] * 100)
            assert await in_thread(client.recv_multipart) == [b"", b"one part, please"]
            client.send(b"fine")
            assert await in_thread(client.recv) == b"answer to fine"
            assert running.server.counters["misshapen"] == 2


# --- telemetry --------------------------------------------------------------------------------------------------


@asynchronous
async def test_the_last_of_several_listeners_ends_the_telemetry(tmp_path: Path) -> None:
    loop = asyncio.get_running_loop()
    async with served(tmp_path) as running:
        server = running.server

        def received_while(listener: zmq.Socket[bytes]) -> bytes:
            while listener.poll(10) == 0:
                loop.call_soon_threadsafe(server.publish, b"state")
            return listener.recv()

        with connected(tmp_path, zmq.SUB, "telemetry") as stays:
            stays.subscribe(b"")
            await running.until(lambda: server.has_subscribers)
            with connected(tmp_path, zmq.SUB, "telemetry") as leaves:
                leaves.subscribe(b"")
                await in_thread(lambda: received_while(leaves))
            await in_thread(lambda: received_while(stays))
            assert server.has_subscribers
        await running.until(lambda: not server.has_subscribers)


# --- the directory ----------------------------------------------------------------------------------------------


@asynchronous
async def test_only_owner_and_group_may_connect_and_the_umask_is_as_before(tmp_path: Path) -> None:
    umask = os.umask(0o022)
    try:
        async with served(tmp_path):
            for name in ("targets", "control", "telemetry"):
                mode = (tmp_path / name).stat().st_mode
                assert stat.S_ISSOCK(mode)
                assert stat.S_IMODE(mode) == 0o660
            assert stat.S_IMODE((tmp_path / "lock").stat().st_mode) == 0o600
        assert os.umask(0o022) == 0o022
    finally:
        os.umask(umask)


@asynchronous
async def test_sockets_left_by_a_killed_daemon_are_taken_over(tmp_path: Path) -> None:
    with zmq.Context() as context, context.socket(zmq.PULL) as killed:
        killed.bind(f"ipc://{tmp_path / 'targets'}")
        async with served(tmp_path) as running:
            with connected(tmp_path, zmq.PUSH, "targets") as client:
                client.send(b"for the living")
                await running.until(lambda: running.messages == [b"for the living"])


def test_a_directory_too_deep_for_a_socket_is_refused_before_anything_is_touched(tmp_path: Path) -> None:
    deep = tmp_path / ("d" * 100)
    with pytest.raises(HapticdError, match="a socket allows 107"):
        asyncio.run(_start_and_stop(deep))
    assert list(deep.iterdir()) == []


def test_a_directory_where_nothing_can_be_bound_is_refused_and_left_unlocked(tmp_path: Path) -> None:
    (tmp_path / "control").mkdir()
    with pytest.raises(HapticdError, match=str(tmp_path)):
        asyncio.run(_start_and_stop(tmp_path))
    (tmp_path / "control").rmdir()
    asyncio.run(_start_and_stop(tmp_path))


async def _start_and_stop(directory: Path) -> None:
    async with served(directory):
        pass


@pytest.mark.parametrize(
    ("environ", "directory"),
    [
        ({"HAPTICD_RUNTIME_DIR": "/a/b", "RUNTIME_DIRECTORY": "/run/x", "XDG_RUNTIME_DIR": "/run/user/7"}, "/a/b"),
        ({"RUNTIME_DIRECTORY": "/run/hapticd:/run/other", "XDG_RUNTIME_DIR": "/run/user/7"}, "/run/hapticd"),
        ({"XDG_RUNTIME_DIR": "/run/user/7", "HAPTICD_RUNTIME_DIR": ""}, "/run/user/7/hapticd"),
        ({}, f"/tmp/hapticd-{os.getuid()}"),
    ],
)
def test_the_runtime_directory_is_the_nearest_that_is_named(environ: dict[str, str], directory: str) -> None:
    assert runtime_directory(environ) == Path(directory)


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o702])
def test_a_directory_that_others_may_write_to_is_refused(tmp_path: Path, mode: int) -> None:
    tmp_path.chmod(mode)
    with pytest.raises(HapticdError, match="chmod go-w"):
        own_directory(tmp_path)


@pytest.mark.parametrize("name", ["control", "record"])
def test_a_file_of_the_name_of_a_socket_is_kept_and_named(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("results of a week")

    async def start() -> None:
        loop = asyncio.get_running_loop()
        if name == "record":
            RecordSocket(tmp_path).start(loop, lambda *_: None)
        else:
            ClientServer(tmp_path).start(loop, lambda *_: None, lambda payload, *_: payload)

    with pytest.raises(HapticdError, match=f"{name}: is not a socket"):
        asyncio.run(start())
    assert (tmp_path / name).read_text() == "results of a week"
    assert not (tmp_path / "targets").exists()


def test_another_users_directory_or_link_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    link = tmp_path / "link"
    link.symlink_to(tmp_path)
    own_directory(link)
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    for path in (tmp_path, link):
        with pytest.raises(HapticdError, match="belongs to another user"):
            own_directory(path)
