"""The gate in front of ZeroMQ: what one connection and all of them may cost."""

from __future__ import annotations

import asyncio
import math
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack, asynccontextmanager
from pathlib import Path

import pytest
import zmq
from asynchronous import PATIENCE_S, asynchronous, until
from client_sockets import GREETING, connected, frame, greeted, in_thread, raw, ready, secured

from hapticd.io.clients import gate as gate_module
from hapticd.io.clients import sockets as sockets_module
from hapticd.io.clients.gate import MAX_LOCAL_BYTES, MAX_SUBSCRIBER_BYTES, Gate, Listener
from hapticd.io.clients.record_socket import WHOLE, RecordSocket
from hapticd.io.clients.server import ClientServer
from hapticd.io.clients.sockets import Remote

REPLY = bytes(60_000)


@pytest.mark.parametrize(("transport", "most"), [("ipc", MAX_LOCAL_BYTES), ("tcp", MAX_SUBSCRIBER_BYTES)])
@asynchronous
async def test_a_subscriber_that_sends_too_much_loses_its_connection(tmp_path: Path, transport: str, most: int) -> None:
    remote, _ = secured(tmp_path / "keys")
    async with served(tmp_path, remote) as (server, gate, _):
        with ExitStack() as stack:
            if transport == "ipc":
                client = stack.enter_context(raw(tmp_path / "telemetry"))
            else:
                client = stack.enter_context(socket.create_connection((remote.host, remote.port + 2), PATIENCE_S))
            await until(lambda: len(gate._relays) == 1, server.sweep)
            client.sendall(bytes(most + 1))
            await until(lambda: not gate._relays, server.sweep)
            assert server.counters["broken"] == 1


# --- what it may cost --------------------------------------------------------------------------------------------


@asynccontextmanager
async def served(
    directory: Path, remote: Remote | None = None
) -> AsyncIterator[tuple[ClientServer, Gate, list[bytes]]]:
    handled: list[bytes] = []

    def answer(payload: bytes, *_: object) -> bytes:
        handled.append(payload)
        return REPLY

    server = ClientServer(directory, remote)
    server.start(asyncio.get_running_loop(), lambda *_: None, answer)
    assert server._service is not None
    try:
        yield server, server._service.gate, handled
    finally:
        server.close()


async def answered(directory: Path) -> bytes:
    """The reply to an ordinary client."""
    with connected(directory, zmq.REQ, "control") as client:
        client.send(b"please")
        reply: bytes = await in_thread(client.recv)
        return reply


@asynchronous
async def test_connections_have_a_number_and_the_next_are_closed_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gate_module, "MAX_CONNECTIONS", 4)
    async with served(tmp_path) as (server, gate, _):
        with ExitStack() as stack:
            clients = [stack.enter_context(raw(tmp_path / "targets", GREETING)) for _ in range(10)]
            await until(lambda: server.counters["crowded"] == 6, server.sweep)
            await until(lambda: len(gate._relays) == 4, server.sweep)
            closed = [client for client in clients[4:] if await asyncio.to_thread(_is_closed, client)]
            assert len(closed) == 6
        await until(lambda: not gate._relays, server.sweep)
        assert await answered(tmp_path) == REPLY


@asynchronous
async def test_connections_over_tcp_take_no_room_of_local_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gate_module, "MAX_CONNECTIONS", 2)
    remote, _ = secured(tmp_path / "keys")
    async with served(tmp_path, remote) as (server, _, _):
        with ExitStack() as stack:
            for _ in range(3):
                stack.enter_context(socket.create_connection((remote.host, remote.port + 1), PATIENCE_S))
            await until(lambda: server.counters["crowded"] == 1, server.sweep)
            assert await answered(tmp_path) == REPLY


@asynchronous
async def test_nothing_is_built_for_a_connection_that_is_closed_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wakeups = 0

    def counted(gate: Gate, listener: Listener, accept: Callable[[Gate, Listener], None] = Gate._accept) -> None:
        nonlocal wakeups
        wakeups += 1
        accept(gate, listener)

    monkeypatch.setattr(Gate, "_accept", counted)
    async with served(tmp_path) as (server, gate, _):
        for _ in range(60):
            with raw(tmp_path / "control"):
                pass
        with raw(tmp_path / "control"):
            await until(lambda: len(gate._relays) == 1, server.sweep)
            assert wakeups == math.ceil(61 / gate_module.ACCEPTS)
            assert (gate._connections, server.counters["gone_early"]) == (1, 60)


@asynchronous
async def test_connections_that_wait_at_the_end_are_closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gate_module, "ADMIT_EVERY_S", 60.0)
    async with served(tmp_path) as (server, gate, _):
        with ExitStack() as stack:
            clients = [stack.enter_context(raw(tmp_path / "control")) for _ in range(5)]
            await until(lambda: len(gate._waiting) == 4, server.sweep)
            server.close()
            assert [await asyncio.to_thread(_is_closed, client) for client in clients[1:]] == [True] * 4


def _is_closed(client: socket.socket) -> bool:
    try:
        return client.recv(100) == b""
    except ConnectionResetError:
        return True


@asynchronous
async def test_a_client_that_leaves_replies_unread_gets_no_further_ones_until_it_reads(tmp_path: Path) -> None:
    async with (
        served(tmp_path) as (server, gate, handled),
        greeted(tmp_path / "control", frame(b"plate") * 60, Socket_Type=b"DEALER") as client,
    ):
        await until(lambda: any(relay.is_behind for relay in gate._relays), server.sweep)
        assert await answered(tmp_path) == REPLY  # others are
        assert len(handled) < 60
        received = 0
        while received < 60 * len(REPLY):
            received += len(await asyncio.to_thread(client.recv, 1 << 20))
            server.sweep()
        assert len(handled) == 61


@asynchronous
async def test_half_a_handshake_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sockets_module, "HANDSHAKE_MS", 30)
    async with served(tmp_path) as (server, gate, _):
        with raw(tmp_path / "control", GREETING[:40]), raw(tmp_path / "telemetry", GREETING, ready(A=b"")[:5]):
            await until(lambda: len(gate._relays) == 2, server.sweep)
            await until(lambda: not gate._relays, server.sweep)


@asynchronous
async def test_a_recorder_that_follows_one_that_has_ended_finds_it_detached(tmp_path: Path) -> None:
    seen: list[tuple[bytes, bool]] = []
    ours = RecordSocket(tmp_path)
    ours.start(asyncio.get_running_loop(), lambda topic, is_attached: seen.append((topic, is_attached)))
    with zmq.Context() as context:
        for count in (1, 3):
            with context.socket(zmq.SUB) as recorder:
                recorder.connect(f"ipc://{tmp_path / 'record'}")
                recorder.subscribe(WHOLE)
                await until(lambda count=count: len(seen) == count, ours.sweep)  # type: ignore[misc]
            await until(lambda: not ours._gate._relays)  # libzmq closes in its own time, an ending process at once
    ours.close()
    assert seen == [(WHOLE, True), (WHOLE, False), (WHOLE, True), (WHOLE, False)]
