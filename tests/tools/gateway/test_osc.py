"""OSC for those who have nothing else: hostile datagrams are sentences, and what was set ends with its sender."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import pytest
from asynchronous import PATIENCE_S, asynchronous, until
from clients.fake_daemon import FakeDaemon
from datagrams import bundle, message
from web_apps import running
from webclients import KEY

from hapticd.tools.gateway import osc_clients
from hapticd.tools.gateway.server import Gateway
from hapticd.tools.web.application import application
from hapticd.wire.osc import OscMessage, decoded, encoded
from hapticd_client.endpoint import Endpoint


class OscSender:
    """A program that speaks OSC."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.port = self.socket.getsockname()[1]
        self.to = ("127.0.0.1", port)

    def send(self, address: str, *arguments: int | float | str) -> None:
        self.socket.sendto(encoded(address, *arguments), self.to)

    async def next(self) -> OscMessage:
        async with asyncio.timeout(PATIENCE_S):
            return decoded(await asyncio.get_running_loop().sock_recv(self.socket, 2000))


@asynccontextmanager
async def senders(folder: Path, count: int) -> AsyncIterator[list[OscSender]]:
    app, gateway = application("gateway", KEY), Gateway(lambda: Endpoint(folder), osc_port=0)
    gateway.add_to(app)
    async with running(app):
        assert gateway.osc_port
        made = [OscSender(gateway.osc_port) for _ in range(count)]
        try:
            yield made
        finally:
            for one in made:
                one.socket.close()


@asynccontextmanager
async def sender(folder: Path) -> AsyncIterator[OscSender]:
    async with senders(folder, 1) as (one,):
        yield one


@asynchronous
async def test_a_finger_is_held_while_its_sender_sends_and_then_released(
    daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(osc_clients, "HOLD_S", 0.4)
    daemon.fingers = {1: (-20.5, 4.0)}
    async with sender(daemon.directory) as program:
        await until(lambda: daemon.scene.owner_of(1) is not None, lambda: program.send("/hapticd/friction", 1.0, 0.25))
        assert daemon.scene.owner_of(1) == f"osc-{program.port}"
        await until(lambda: daemon.released == [1])


@asynchronous
async def test_a_follower_gets_fingers_and_a_marker_reaches_the_daemon(daemon: FakeDaemon) -> None:
    daemon.fingers = {1: (-20.5, 4.0)}
    async with sender(daemon.directory) as program:
        await until(lambda: bool(daemon.markers), lambda: program.send("/hapticd/marker", "now"))
        assert (daemon.markers[0].client, daemon.markers[0].text) == (f"osc-{program.port}", "now")
        received: list[OscMessage] = []

        def repeat() -> None:
            program.send("/hapticd/follow", program.port)
            with suppress(BlockingIOError):
                received.append(decoded(program.socket.recv(2000)))

        await until(lambda: any(one.address == "/hapticd/finger" for one in received), repeat)
        fingers = [one.arguments for one in received if one.address == "/hapticd/finger"]
        assert fingers[0] == [1, -20.5, 4.0, -1.0, -1.0]


@pytest.mark.parametrize(
    ("datagram", "sentence"),
    [
        (encoded("/hapticd/friction", 1, 2.0), "friction: 2 is out of bounds, it must be 0 .. 1."),
        (encoded("/hapticd/friction", 1), "takes finger and friction, not 1 arguments."),
        (encoded("/hapticd/friction", "a", 0.5), "finger: must be a whole number, not a text."),
        (encoded("/hapticd/friction", 1.5, 0.5), "finger: must be a whole number, not 1.5."),
        (encoded("/hapticd/dance", 1), "'/hapticd/dance' is none of hapticd's messages."),
        (encoded("/hapticd/follow", 70000), "port: 70000 is out of bounds, it must be 1 .. 65535."),
        (encoded("/hapticd/release", float("inf")), "finger: must be a whole number, not inf."),
        (encoded("/hapticd/amplitude", 1, float("nan")), "amplitude_um: nan is out of bounds"),
        (encoded("/hapticd/marker", 1.5), "text: must be a text, not 1.5."),
        (b"/" * 2000, "The datagram has 2000 bytes, the limit is 1024."),
        (bundle(encoded("/hapticd/release")), "is an OSC bundle: send its messages one by one."),
        (message("/hapticd/friction", 1 << 61, 0.5, times=(0,)), "finger: "),
        (b"/a", "is no OSC message of an address"),
    ],
)
@asynchronous
async def test_a_wrong_datagram_is_answered_with_a_sentence(daemon: FakeDaemon, datagram: bytes, sentence: str) -> None:
    async with sender(daemon.directory) as program:
        program.socket.sendto(datagram, program.to)
        received = await program.next()
        assert received.address == "/hapticd/error"
        assert sentence in str(received.arguments[0])


@asynchronous
async def test_fingers_go_neither_to_the_gateway_itself_nor_are_its_own_messages_answered(daemon: FakeDaemon) -> None:
    async with sender(daemon.directory) as program:
        for own in ("/hapticd/finger", "/hapticd/error"):
            program.send(own, "sentence")
        program.send("/hapticd/follow", program.to[1])
        (sentence,) = (await program.next()).arguments
        assert str(sentence).startswith(f"port: {program.to[1]} is the gateway's own")


@asynchronous
async def test_a_flood_is_dropped_beyond_its_rate_and_keeps_no_other_sender_out(daemon: FakeDaemon) -> None:
    async with senders(daemon.directory, 2) as (flooding, other):
        for _ in range(4 * osc_clients.BURST):
            flooding.send("/hapticd/friction", 1, 2.0)
        other.send("/hapticd/friction", 1, 2.0)
        assert (await other.next()).address == "/hapticd/error"
        answered = 0
        with suppress(BlockingIOError):
            while flooding.socket.recv(2000):
                answered += 1
        assert 0 < answered < 3 * osc_clients.BURST
