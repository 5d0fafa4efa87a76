"""Connections to the pages' servers: strangers keep nobody out, and what they do is at most a sentence in the log."""

from __future__ import annotations

import asyncio
import errno
import json
import logging
import os
import socket
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest
from aiohttp import ClientSession, ClientWebSocketResponse, WSMsgType, web
from aiohttp.http_exceptions import BadStatusLine
from asynchronous import PATIENCE_S, asynchronous, until
from web_apps import running

from hapticd.tools.view.messages import MAX_MESSAGE_BYTES
from hapticd.tools.view.server import Viewer
from hapticd.tools.web import connections
from hapticd.tools.web.connections import PeerFilter, report

LONG_NUMBERS = ("9" * 3000, "-" + "9" * 3000)


def idle(stack: ExitStack, port: int, count: int, sent: bytes = b"") -> list[socket.socket]:
    """Connections that send this, and nothing more."""
    found = []
    for _ in range(count):
        client = stack.enter_context(socket.create_connection(("127.0.0.1", port), PATIENCE_S))
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


@pytest.fixture
def app(tmp_path: Path) -> web.Application:
    """The viewer's."""
    return Viewer(str(tmp_path), key="key").app()


@asynchronous
async def test_strangers_are_bounded_and_keep_neither_an_early_nor_a_later_client_out(
    app: web.Application, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(connections, "MAX_STRANGERS", 20)
    monkeypatch.setattr(connections, "STRANGER_S", 40.0)  # the 18th has 0.9 s, the twentieth 0.1 s
    async with running(app) as (found, port):
        request = f"GET /?key=key HTTP/1.0\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode()
        with ExitStack() as stack:
            (early,) = await asyncio.to_thread(idle, stack, port, 1)
            await until(lambda: len(found) == 1)
            clients = await asyncio.to_thread(idle, stack, port, 100)
            assert all([await asyncio.to_thread(ends, client) for client in clients[40:]])
            await until(lambda: len(found) <= 17)
            (later,) = await asyncio.to_thread(idle, stack, port, 1, request)
            early.sendall(request)
            for client in (early, later):
                assert (await asyncio.to_thread(client.recv, 100)).startswith(b"HTTP/1.0 200")
    assert caplog.text == ""


@asynchronous
async def test_a_connection_beyond_those_with_the_key_is_refused_and_closes_none(
    app: web.Application, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "MAX_KNOWN", 1)
    async with running(app) as (_, port), ClientSession() as session:
        own = f"http://127.0.0.1:{port}"
        page = await session.ws_connect(f"{own}/socket?key=key", headers={"Origin": own})
        async with session.get(f"{own}/?key=key") as response:
            assert response.status == 503
        await page.send_str("{")
        assert "not JSON" in await refusal(page)
        await page.close()


@pytest.mark.parametrize("sent", [b"", b"GET / HTTP/1.1\r\nHost: ", b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"])
@asynchronous
async def test_a_connection_without_the_key_ends_within_its_time(
    app: web.Application, monkeypatch: pytest.MonkeyPatch, sent: bytes
) -> None:
    monkeypatch.setattr(connections, "STRANGER_S", 0.05)
    async with running(app) as (found, port):
        with ExitStack() as stack:
            (client,) = await asyncio.to_thread(idle, stack, port, 1, sent)
            assert await asyncio.to_thread(ends, client)
            await until(lambda: len(found) == 0)


@asynchronous
async def test_a_page_that_brought_the_key_stays_beyond_a_strangers_time_and_leaves_no_trace(
    app: web.Application,
) -> None:
    async with running(app) as (found, port), ClientSession() as session:
        own = f"http://127.0.0.1:{port}"
        page = await session.ws_connect(f"{own}/socket?key=key", headers={"Origin": own})
        (one,) = found.known
        assert one._deadline is not None
        assert one._deadline.cancelled()
        await page.close()
    assert len(found) == 0


@asynchronous
async def test_a_message_too_long_closes_the_page_and_a_number_too_long_is_refused(
    app: web.Application, caplog: pytest.LogCaptureFixture
) -> None:
    async with running(app) as (_, port), ClientSession() as session:
        own = f"http://127.0.0.1:{port}"
        page = await session.ws_connect(f"{own}/socket?key=key", headers={"Origin": own})
        for number in LONG_NUMBERS:
            await page.send_str(f'{{"op": "set", "finger": 1, "amplitude_um": {number}}}')
            assert (await refusal(page)).startswith("amplitude_um: a whole number of 9966 bits is out of bounds")
        await page.send_str(" " * (MAX_MESSAGE_BYTES + 1))
        while (message := await page.receive()).type is WSMsgType.TEXT:
            pass
        assert message.type in (WSMsgType.CLOSE, WSMsgType.CLOSED, WSMsgType.ERROR)
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
