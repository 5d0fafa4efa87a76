"""The gate in front of ZeroMQ: what one connection and all of them may cost."""

from __future__ import annotations

import asyncio
import math
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, ExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import zmq
from asynchronous import PATIENCE_S, asynchronous, until
from client_sockets import GREETING, connected, frame, greeted, in_thread, raw, ready, secured

from hapticd.io.clients import gate as gate_module
from hapticd.io.clients import record_socket as record_module
from hapticd.io.clients import server as server_module
from hapticd.io.clients import sockets as sockets_module
from hapticd.io.clients.gate import UNREAD_REPLIES, Gate, Listener
from hapticd.io.clients.relay import (
    CHUNK_BYTES,
    MAX_LOCAL_BYTES,
    MAX_SUBSCRIBER_BYTES,
    ProtocolError,
    SubscriberBytes,
    UnreadBytes,
)
from hapticd.io.clients.server import ClientServer
from hapticd.io.clients.sockets import Remote

REPLY = bytes(60_000)


@pytest.mark.parametrize(("is_local", "most"), [(True, MAX_LOCAL_BYTES), (False, MAX_SUBSCRIBER_BYTES)])
def test_a_subscribers_bytes_are_bounded_at_once_and_in_all(is_local: bool, most: int) -> None:
    t_s = 0.0
    inbound, ping = SubscriberBytes(is_local=is_local, clock_s=lambda: t_s), bytes(16)
    for _ in range(most // len(ping)):
        assert inbound.feed(ping) == ping
        t_s += 0.25
    with pytest.raises(ProtocolError):
        inbound.feed(ping)
    at_once = SubscriberBytes(is_local=is_local, clock_s=lambda: t_s)
    assert at_once.feed(bytes(MAX_SUBSCRIBER_BYTES)) == bytes(MAX_SUBSCRIBER_BYTES)
    with pytest.raises(ProtocolError):
        at_once.feed(b"x")


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
async def test_a_client_with_unread_replies_is_disconnected_and_others_are_answered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with served(tmp_path) as (server, gate, _):
        unread: list[int] = []

        def noted(relay: Any, most: Any, decide: Callable[[Any, Any], bool] = gate.leaves_too_much) -> bool:
            unread.append(len(relay.to_client))
            return decide(relay, most)

        monkeypatch.setattr(gate, "leaves_too_much", noted)
        async with greeted(tmp_path / "control", frame(b"plate") * 60, Socket_Type=b"DEALER"):
            await until(lambda: server.counters["unread"] == 1, server.sweep)
            most_bytes = UNREAD_REPLIES.connection
            assert most_bytes < max(unread) <= most_bytes + CHUNK_BYTES
            assert await answered(tmp_path) == REPLY
            await until(lambda: not gate._relays, server.sweep)  # what ZeroMQ still answered was read and dropped


@asynchronous
async def test_the_unread_replies_of_all_clients_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server_module, "UNREAD_REPLIES", UnreadBytes(connection=2**40, in_all=2**20))
    async with served(tmp_path) as (server, gate, _), AsyncExitStack() as stack:
        for _ in range(4):
            await stack.enter_async_context(greeted(tmp_path / "control", frame(b"plate") * 20, Socket_Type=b"DEALER"))
        await until(lambda: server.counters["unread"] >= 1, server.sweep)
        unread = sum(len(relay.to_client) for relay in gate._relays.values())
        assert unread <= 2**20


@asynchronous
async def test_half_a_handshake_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sockets_module, "HANDSHAKE_MS", 30)
    async with served(tmp_path) as (server, gate, _):
        with raw(tmp_path / "control", GREETING[:40]), raw(tmp_path / "telemetry", GREETING, ready(A=b"")[:5]):
            await until(lambda: len(gate._relays) == 2, server.sweep)
            await until(lambda: not gate._relays, server.sweep)


@asynchronous
async def test_a_recorder_that_does_not_read_is_disconnected_within_its_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(record_module, "UNREAD_RECORDS", UnreadBytes(2**20, 2**20))
    recorders = record_module.RecordSocket(tmp_path)
    attached: list[bytes] = []
    recorders.start(asyncio.get_running_loop(), lambda topic, _: attached.append(topic))
    gate = recorders._gate
    assert gate is not None
    try:
        async with greeted(tmp_path / "record", frame(b"\x01"), Socket_Type=b"SUB"):
            longest = 0
            async with asyncio.timeout(PATIENCE_S):
                while gate.counters["unread"] == 0:
                    if attached:
                        recorders.send(bytes(170_000))
                    await asyncio.sleep(0.001)
                    recorders.sweep()
                    longest = max([longest, *(len(relay.to_client) for relay in gate._relays.values())])
            assert 0 < longest <= 2**20
    finally:
        recorders.close()
