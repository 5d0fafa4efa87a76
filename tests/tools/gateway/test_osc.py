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
from webclients import KEY

from hapticd.tools.gateway import osc_clients
from hapticd.tools.gateway.server import Gateway
from hapticd.wire.osc import OscMessage, decoded, encoded
from hapticd_client.endpoint import Endpoint


class OscSender:
    """A program that speaks OSC."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self.port = self.socket.getsockname()[1]
        self._to = ("127.0.0.1", port)

    def send(self, address: str, *arguments: int | float | str) -> None:
        self.send_bytes(encoded(address, *arguments))

    def send_bytes(self, datagram: bytes) -> None:
        self.socket.sendto(datagram, self._to)

    async def next(self) -> OscMessage:
        async with asyncio.timeout(PATIENCE_S):
            return decoded(await asyncio.get_running_loop().sock_recv(self.socket, 2000))


@asynccontextmanager
async def sender(folder: Path) -> AsyncIterator[OscSender]:
    gateway = Gateway(Endpoint(folder), KEY, osc_port=0)
    runner = gateway.runner()
    await runner.setup()
    assert gateway.osc_port
    made = OscSender(gateway.osc_port)
    try:
        yield made
    finally:
        made.socket.close()
        await runner.cleanup()


@asynchronous
async def test_a_finger_is_held_while_its_sender_speaks_and_is_released_when_it_falls_silent(
    daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(osc_clients, "HOLD_S", 0.4)
    daemon.fingers = {1: (-20.5, 4.0)}
    async with sender(daemon.directory) as program:
        await until(lambda: daemon.scene.owner_of(1) is not None, lambda: program.send("/hapticd/friction", 1, 0.25))
        assert daemon.scene.owner_of(1) == f"osc-{program.port}"
        await until(lambda: daemon.released == [1])


@asynchronous
async def test_who_follows_hears_of_fingers_and_a_marker_reaches_the_daemon(daemon: FakeDaemon) -> None:
    daemon.fingers = {1: (-20.5, 4.0)}
    async with sender(daemon.directory) as program:
        await until(lambda: bool(daemon.markers), lambda: program.send("/hapticd/marker", "now"))
        assert (daemon.markers[0].client, daemon.markers[0].text) == (f"osc-{program.port}", "now")
        heard: list[OscMessage] = []

        def repeat() -> None:
            program.send("/hapticd/follow", program.port)
            with suppress(BlockingIOError):
                heard.append(decoded(program.socket.recv(2000)))

        await until(lambda: any(one.address == "/hapticd/finger" for one in heard), repeat)
        fingers = [one.arguments for one in heard if one.address == "/hapticd/finger"]
        assert fingers[0] == [1, -20.5, 4.0, -1.0, -1.0]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("/hapticd/friction", 1, 2.0), "friction: 2 is out of bounds, it must be 0 .. 1."),
        (("/hapticd/friction", 1), "needs exactly one of"),
        (("/hapticd/friction", "a", 0.5), "finger: must be the id of a finger, a whole number."),
        (("/hapticd/dance", 1), "'/hapticd/dance' with 1 arguments is none of hapticd's messages."),
        (("/hapticd/follow", 70000), "is none of hapticd's messages."),
        (("/hapticd/release", float("inf")), "is none of hapticd's messages."),
        (("/hapticd/amplitude", 1, float("nan")), "amplitude_um: nan is out of bounds"),
    ],
)
@asynchronous
async def test_a_wrong_message_is_answered_with_a_sentence(
    daemon: FakeDaemon, words: tuple[str, int | float | str], sentence: str
) -> None:
    async with sender(daemon.directory) as program:
        program.send(*words)
        heard = await program.next()
        assert heard.address == "/hapticd/error"
        assert sentence in str(heard.arguments[0])


@pytest.mark.parametrize(
    ("datagram", "sentence"),
    [
        (b"/" * 2000, "The datagram has 2000 bytes, the limit is 1024."),
        (bundle(encoded("/hapticd/release")), "is an OSC bundle: send its messages one by one."),
        (message("/hapticd/friction", 1 << 61, 0.5, times=(0,)), "finger: "),
        (b"/a", "is no OSC message of an address"),
    ],
)
@asynchronous
async def test_a_datagram_that_is_no_message_for_hapticd_is_answered_with_a_sentence(
    daemon: FakeDaemon, datagram: bytes, sentence: str
) -> None:
    async with sender(daemon.directory) as program:
        program.send_bytes(datagram)
        assert sentence in str((await program.next()).arguments[0])


@asynchronous
async def test_a_flood_is_dropped_beyond_its_rate(daemon: FakeDaemon) -> None:
    async with sender(daemon.directory) as program:
        for _ in range(10 * osc_clients.BURST):
            program.send("/hapticd/friction", 1, 2.0)
        assert (await program.next()).address == "/hapticd/error"
        await asyncio.sleep(0)
        answered = 1
        with suppress(BlockingIOError):
            while program.socket.recv(2000):
                answered += 1
        assert answered < 5 * osc_clients.BURST
