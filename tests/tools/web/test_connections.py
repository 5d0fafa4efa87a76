"""Connections to the pages' servers: strangers keep nobody out, and what they do is at most a sentence in the log."""

from __future__ import annotations

import asyncio
import errno
import json
import logging
import os
import socket
import sys
from collections.abc import AsyncIterator
from contextlib import ExitStack, asynccontextmanager
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from aiohttp import ClientSession, ClientWebSocketResponse, WSMsgType
from aiohttp.http_exceptions import BadStatusLine
from asynchronous import PATIENCE_S, VirtualTimeLoop, asynchronous, until

from hapticd.tools.study.browser import Browser
from hapticd.tools.view.messages import MAX_MESSAGE_BYTES
from hapticd.tools.view.server import Viewer
from hapticd.tools.web import connections
from hapticd.tools.web.connections import PeerFilter, Site, report

LONG_NUMBERS = ("9" * 3000, "-" + "9" * 3000)


@asynccontextmanager
async def served(folder: Path) -> AsyncIterator[tuple[Site, str]]:
    viewer = Viewer(str(folder), key="key")
    runner = viewer.runner()
    listener = socket.create_server(("127.0.0.1", 0))
    port = listener.getsockname()[1]
    await runner.setup()
    site = Site(runner, listener)
    await site.start()
    try:
        yield site, f"http://127.0.0.1:{port}"
    finally:
        await runner.cleanup()


def idle(stack: ExitStack, port: int, count: int, address: str = "127.0.0.1", sent: bytes = b"") -> list[socket.socket]:
    """Connections that send this, and nothing more."""
    found = []
    for _ in range(count):
        client = stack.enter_context(socket.create_connection(("127.0.0.1", port), PATIENCE_S, (address, 0)))
        client.sendall(sent)
        found.append(client)
    return found


def ends(client: socket.socket) -> bool:
    """Read until the server has closed it; TimeoutError if it does not."""
    try:
        while client.recv(65_536):
            pass
    except ConnectionResetError:
        pass
    return True


async def refusal(page: ClientWebSocketResponse) -> str:
    """The next sentence that refuses a message."""
    while (message := json.loads(await page.receive_str()))["kind"] != "refused":
        pass
    return str(message["sentence"])


@asynchronous
async def test_three_hundred_idle_connections_are_bounded_and_the_page_is_served(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with served(tmp_path) as (site, own):
        port = urlsplit(own).port
        assert port is not None
        with ExitStack() as stack:
            clients = await asyncio.to_thread(idle, stack, port, 300)
            await until(lambda: len(site.connections) == connections.MAX_CONNECTIONS_PER_ADDRESS)
            excess = clients[: 300 - connections.MAX_CONNECTIONS_PER_ADDRESS]
            assert all([await asyncio.to_thread(ends, client) for client in excess])
            async with ClientSession() as session, session.get(f"{own}/?key=key") as response:
                assert response.status == 200
            assert len(site.connections) <= connections.MAX_CONNECTIONS_PER_ADDRESS
    assert caplog.text == ""


@asynchronous
async def test_strangers_of_many_addresses_are_bounded_too_and_a_page_that_is_open_stays(tmp_path: Path) -> None:
    async with served(tmp_path) as (site, own), ClientSession(headers={"Origin": own}) as session:
        page = await session.ws_connect(f"{own}/socket?key=key")
        port = urlsplit(own).port
        assert port is not None
        with ExitStack() as stack:
            for host in range(2, 6):
                await asyncio.to_thread(idle, stack, port, 30, f"127.0.0.{host}")
            await until(lambda: len(site.connections) == connections.MAX_CONNECTIONS)
            await page.send_str("{")
            assert "not JSON" in await refusal(page)
        await page.close()


@pytest.mark.parametrize("sent", [b"", b"GET / HTTP/1.1\r\nHost: ", b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"])
@asynchronous
async def test_a_connection_without_the_key_ends_within_its_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sent: bytes
) -> None:
    monkeypatch.setattr(connections, "STRANGER_S", 0.05)
    async with served(tmp_path) as (site, own):
        port = urlsplit(own).port
        assert port is not None
        with ExitStack() as stack:
            (client,) = await asyncio.to_thread(idle, stack, port, 1, "127.0.0.1", sent)
            assert await asyncio.to_thread(ends, client)
            await until(lambda: len(site.connections) == 0)


@asynchronous
async def test_a_page_that_brought_the_key_stays_beyond_a_strangers_time_and_leaves_no_trace(tmp_path: Path) -> None:
    async with served(tmp_path) as (site, own), ClientSession(headers={"Origin": own}) as session:
        page = await session.ws_connect(f"{own}/socket?key=key")
        for one in (*site.connections._known, *site.connections._strangers):
            one._give_up()
        await page.send_str("{")
        assert "not JSON" in await refusal(page)
        await page.close()
    assert len(site.connections) == 0


def test_a_pages_messages_are_read_at_a_rate() -> None:
    async def paced() -> float:
        loop, pace = asyncio.get_running_loop(), connections.Pace()
        t_begin_s = loop.time()
        for _ in range(connections.BURST + 400):
            await pace.wait()
        return loop.time() - t_begin_s

    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        assert runner.run(paced()) == pytest.approx(400 / connections.MESSAGES_HZ)


@asynchronous
async def test_a_message_too_long_closes_the_page_and_a_number_too_long_is_refused(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with served(tmp_path) as (_, own), ClientSession(headers={"Origin": own}) as session:
        page = await session.ws_connect(f"{own}/socket?key=key")
        for number in LONG_NUMBERS:
            await page.send_str(f'{{"op": "set", "finger": 1, "amplitude_um": {number}}}')
            assert (await refusal(page)).startswith("amplitude_um: a whole number of 9966 bits is out of bounds")
        await page.send_str(" " * (MAX_MESSAGE_BYTES + 1))
        while (message := await page.receive()).type is WSMsgType.TEXT:
            pass
        assert message.type in (WSMsgType.CLOSE, WSMsgType.CLOSED, WSMsgType.ERROR)
    assert caplog.text == ""


def test_idle_connections_do_not_keep_a_participant_from_the_studys_page(caplog: pytest.LogCaptureFixture) -> None:
    with Browser() as page, ExitStack() as stack:
        address = urlsplit(page.url)
        assert address.port is not None
        clients = idle(stack, address.port, 100)
        (own,) = idle(
            stack, address.port, 1, sent=f"GET /?{address.query} HTTP/1.0\r\nHost: {address.netloc}\r\n\r\n".encode()
        )
        assert own.recv(100).startswith(b"HTTP/1.0 200")
        assert all(ends(client) for client in clients[: 100 - connections.MAX_CONNECTIONS_PER_ADDRESS])
    assert caplog.text == ""


# --- the log -----------------------------------------------------------------------------------------------------


def failed(error: Exception) -> logging.LogRecord:
    try:
        raise error
    except Exception:
        return logging.LogRecord("x", logging.ERROR, __file__, 1, "Error handling request", None, sys.exc_info())


def test_what_a_peer_does_is_one_sentence_at_a_time_and_no_traceback() -> None:
    t_s = 5.0
    peer_filter = PeerFilter(lambda: t_s)
    passed = []
    for n in range(4000):
        t_s = 5.0 + n * 1e-2
        record = failed(ConnectionResetError(f"{n}\nmore"))
        if peer_filter.filter(record):
            passed.append(logging.Formatter().format(record))
    assert passed == [f"page: Error handling request (ConnectionResetError: {n})" for n in (0, 1000, 2000, 3000)]
    assert not peer_filter.filter(failed(BadStatusLine("?")))


def test_a_host_without_a_free_descriptor_is_one_sentence_and_a_defect_is_not_hidden(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "_FILTER", PeerFilter(lambda: 0.0))
    log = logging.getLogger("aiohttp.server")
    monkeypatch.setattr(log, "filters", [])
    loop = asyncio.new_event_loop()
    for _ in range(500):
        context = {"message": "socket.accept() out of system resource"}
        report(loop, context | {"exception": OSError(errno.EMFILE, os.strerror(errno.EMFILE))})  # type: ignore[arg-type]
    assert len(caplog.records) == 1
    assert "Traceback" not in caplog.text
    report(loop, {"message": "a defect", "exception": ValueError("of ours")})
    assert "of ours" in caplog.text
    loop.close()
