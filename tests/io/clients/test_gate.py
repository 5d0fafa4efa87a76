"""The gate in front of ZeroMQ: what one connection, one user and all of them may cost."""

from __future__ import annotations

import asyncio
import math
import socket
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AsyncExitStack, ExitStack, asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any

import pytest
import zmq
from asynchronous import PATIENCE_S, asynchronous, until
from client_sockets import GREETING, command, connected, frame, greeted, in_thread, raw, ready
from hypothesis import given
from hypothesis import strategies as st

from hapticd.io.clients import gate as gate_module
from hapticd.io.clients import record_socket as record_module
from hapticd.io.clients import server as server_module
from hapticd.io.clients import sockets as sockets_module
from hapticd.io.clients.gate import UNREAD_REPLIES, Door, Gate
from hapticd.io.clients.relay import CHUNK_BYTES, UnreadBytes
from hapticd.io.clients.server import ClientServer
from hapticd.io.clients.zmtp import (
    MAX_CHANGES,
    MAX_FRAME_BYTES,
    MAX_SUBSCRIBER_BYTES,
    LocalInbound,
    ProtocolError,
    SubscriberInbound,
)

REPLY = bytes(60_000)


# --- what passes -------------------------------------------------------------------------------------------------


def passed(*frames: bytes, piece: int = 10_000) -> bytes:
    """What ZeroMQ gets of these frames after a handshake."""
    inbound = LocalInbound(frozenset({b""}))
    data = GREETING + ready(Socket_Type=b"SUB") + b"".join(frames)
    got = b"".join(inbound.feed(data[at : at + piece]) for at in range(0, len(data), piece))
    shaken = GREETING + ready(Socket_Type=b"SUB")
    assert got.startswith(shaken)
    return got[len(shaken) :]


OTHER_TOPICS = [frame(b"\x01" + b"%d" % n + bytes(40)) for n in range(15)]
WANTED = [frame(b"\x01"), command(b"PING", b"\x00\x10"), command(b"CANCEL"), command(b"SUBSCRIBE")]


def test_of_many_subscriptions_only_those_to_the_states_reach_zeromq() -> None:
    also = [command(b"SUBSCRIBE", b"x"), command(b"ERROR"), frame(b"\x02"), frame(b""), frame(b"\x01"), frame(b"\x01x")]
    assert passed(*OTHER_TOPICS, *WANTED, *also) == b"".join(WANTED)


@given(piece=st.integers(1, 3000))
def test_any_chunking_passes_the_same(piece: int) -> None:
    assert passed(*OTHER_TOPICS[:5], *WANTED, piece=piece) == b"".join(WANTED)


@pytest.mark.parametrize(
    "data",
    [
        b"GET / HTTP/1.1\r\n",
        GREETING[:10] + b"\x01" + GREETING[11:],
        GREETING + frame(b"no command"),
        GREETING + command(b"ERROR"),
        GREETING + frame(bytes(MAX_FRAME_BYTES + 1)),
        GREETING + ready(Socket_Type=b"SUB") + frame(bytes(MAX_FRAME_BYTES + 1)),
        GREETING + ready(Socket_Type=b"SUB") + (frame(b"\x01") + frame(b"\x00")) * MAX_CHANGES,
    ],
)
def test_what_is_not_the_protocol_ends_the_connection(data: bytes) -> None:
    with pytest.raises(ProtocolError):
        LocalInbound(frozenset({b""})).feed(data)


@given(st.lists(st.binary(max_size=200)))
def test_no_bytes_raise_anything_else(pieces: list[bytes]) -> None:
    inbound = LocalInbound(frozenset({b""}))
    try:
        for piece in (GREETING, *pieces):
            inbound.feed(piece)
    except ProtocolError:
        pass


def test_a_subscriber_over_tcp_may_send_no_more_than_a_handshake_and_its_subscription() -> None:
    inbound = SubscriberInbound()
    assert inbound.feed(bytes(MAX_SUBSCRIBER_BYTES)) == bytes(MAX_SUBSCRIBER_BYTES)
    with pytest.raises(ProtocolError):
        inbound.feed(b"x")


@pytest.mark.parametrize("small", [frame(b""), command(b"PING", b"\x00\x10")])
def test_a_local_subscriber_is_cut_off_before_a_flood_of_its_smallest_frames_is_parsed(small: bytes) -> None:
    inbound = LocalInbound(frozenset({b""}))
    inbound.feed(GREETING + ready(Socket_Type=b"SUB"))
    with pytest.raises(ProtocolError):
        inbound.feed(small * (CHUNK_BYTES // len(small)))


def test_a_local_subscriber_may_send_heartbeats_for_ever_but_no_flood_of_them() -> None:
    t_s, ping = 0.0, command(b"PING", b"\x00\x10")
    inbound = LocalInbound(frozenset({b""}), clock_s=lambda: t_s)
    inbound.feed(GREETING + ready(Socket_Type=b"SUB"))
    for second in range(3600):
        t_s = float(second)
        assert inbound.feed(ping) == ping
    with pytest.raises(ProtocolError):
        inbound.feed(ping * 200)


# --- what it may cost --------------------------------------------------------------------------------------------


@asynccontextmanager
async def served(directory: Path) -> AsyncIterator[tuple[ClientServer, Gate, list[bytes]]]:
    handled: list[bytes] = []

    def answer(payload: bytes, *_: object) -> bytes:
        handled.append(payload)
        return REPLY

    server = ClientServer(directory)
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
async def test_a_user_has_a_number_of_connections_and_the_next_are_closed_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gate_module, "MAX_CONNECTIONS_PER_USER", 4)
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
async def test_a_connection_that_is_closed_again_is_dropped_before_anything_is_built_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wakeups = 0

    def counted(gate: Gate, door: Door, accept: Callable[[Gate, Door], None] = Gate._accept) -> None:
        nonlocal wakeups
        wakeups += 1
        accept(gate, door)

    monkeypatch.setattr(Gate, "_accept", counted)
    async with served(tmp_path) as (server, gate, _):
        for _ in range(60):
            with raw(tmp_path / "control"):
                pass
        with raw(tmp_path / "control"):
            await until(lambda: len(gate._relays) == 1, server.sweep)
            assert wakeups == math.ceil(61 / gate_module.ACCEPTS)
            assert (gate._connections, server.counters["gone_early"]) == (1, 60)


@pytest.fixture
def claimed_users(monkeypatch: pytest.MonkeyPatch) -> None:
    """The name of a client's own socket begins with the user id that the kernel is taken to report."""

    def credentials(outer: socket.socket) -> tuple[int, int, int]:
        return 42, int(Path(outer.getpeername()).name.partition("-")[0]), 0

    monkeypatch.setattr(gate_module, "_credentials", credentials)


@contextmanager
def of_user(uid: int, directory: Path, count: int) -> Iterator[list[socket.socket]]:
    """Connections of a user, which wait to be accepted."""
    with ExitStack() as stack:
        clients = [stack.enter_context(socket.socket(socket.AF_UNIX)) for _ in range(count)]
        for client in clients:
            client.settimeout(PATIENCE_S)
            client.bind(str(directory / f"{uid}-{client.fileno()}"))
            client.connect(str(directory / "control"))
        yield clients
        for client in clients:
            Path(client.getsockname()).unlink()


@pytest.mark.usefixtures("claimed_users")
@asynchronous
async def test_a_user_that_connects_too_fast_is_refused_and_counted_and_another_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gate_module, "CONNECTIONS_HZ", 0.0)
    monkeypatch.setattr(gate_module, "MAX_CONNECTIONS", 8)
    async with served(tmp_path) as (server, gate, _):
        for _ in range(2):
            with of_user(7, tmp_path, 4):
                await until(lambda: len(gate._relays) == 4, server.sweep)
            await until(lambda: not gate._relays, server.sweep)
        with of_user(7, tmp_path, 3) as refused, of_user(8, tmp_path, 1):
            await until(lambda: len(gate._relays) == 1, server.sweep)
            assert [await asyncio.to_thread(_is_closed, client) for client in refused] == [True] * 3
            assert server.counters["connected_too_fast"] == 3
            assert [relay.user for relay in gate._relays.values()] == ["uid 8"]


@pytest.mark.usefixtures("claimed_users")
@asynchronous
async def test_of_connections_that_wait_each_user_has_its_turn(tmp_path: Path) -> None:
    async with served(tmp_path) as (server, gate, _):
        with of_user(7, tmp_path, 12), of_user(8, tmp_path, 2):
            await until(lambda: len(gate._relays) == 14, server.sweep)
            users = [gate._relays[number].user for number in sorted(gate._relays)]
            assert users == ["uid 7", "uid 8"] * 2 + ["uid 7"] * 10


@asynchronous
async def test_connections_that_wait_at_the_end_are_closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gate_module, "ADMIT_EVERY_S", 60.0)
    async with served(tmp_path) as (server, gate, _):
        with ExitStack() as stack:
            clients = [stack.enter_context(raw(tmp_path / "control")) for _ in range(5)]
            await until(lambda: sum(map(len, gate._waiting.values())) == 4, server.sweep)
            server.close()
            assert [await asyncio.to_thread(_is_closed, client) for client in clients[1:]] == [True] * 4


def _is_closed(client: socket.socket) -> bool:
    try:
        return client.recv(100) == b""
    except ConnectionResetError:
        return True


@asynchronous
async def test_a_client_that_leaves_its_replies_unread_is_disconnected_and_the_others_are_answered(
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
async def test_unread_replies_are_bounded_per_user_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server_module, "UNREAD_REPLIES", UNREAD_REPLIES._replace(connection=2**40))
    async with served(tmp_path) as (server, gate, _), AsyncExitStack() as stack:
        for _ in range(4):
            await stack.enter_async_context(greeted(tmp_path / "control", frame(b"plate") * 20, Socket_Type=b"DEALER"))
        await until(lambda: server.counters["unread"] >= 1, server.sweep)
        unread = sum(len(relay.to_client) for relay in gate._relays.values())
        assert unread <= UNREAD_REPLIES.user


@asynchronous
async def test_half_a_handshake_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sockets_module, "HANDSHAKE_MS", 30)
    async with served(tmp_path) as (server, gate, _):
        with raw(tmp_path / "control", GREETING[:40]), raw(tmp_path / "telemetry", GREETING, ready(A=b"")[:5]):
            await until(lambda: len(gate._relays) == 2, server.sweep)
            await until(lambda: not gate._relays, server.sweep)


@asynchronous
async def test_a_recorder_that_does_not_read_is_disconnected_and_costs_a_bounded_number_of_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(record_module, "UNREAD_RECORDS", UnreadBytes(2**20, 2**20, 2**20))
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
