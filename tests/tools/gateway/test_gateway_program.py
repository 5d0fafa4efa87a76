"""`hapticd gateway`: its arguments, its key, and the process."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from aiohttp import ClientSession, WSServerHandshakeError
from asynchronous import asynchronous
from clients.fake_daemon import FakeDaemon
from clients.gateway_process import gateway_process
from web_apps import running
from webclients import KEY, Program

from hapticd.errors import UsageError
from hapticd.tools.gateway import program
from hapticd.tools.view.server import Viewer


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--origin", "localhost:8000"], "--origin: 'localhost:8000' is none: give scheme, host and port"),
        (["--port", "0", "--endpoint", "/nowhere"], "--endpoint: /nowhere is not a directory"),
    ],
)
def test_a_wrong_argument_is_refused_in_a_sentence(
    refused: Callable[..., str], words: list[str], sentence: str
) -> None:
    assert sentence in refused("gateway", *words)


def test_a_key_file_is_made_for_its_user_alone_and_keeps_the_key(tmp_path: Path) -> None:
    path = tmp_path / "key"
    made = program._key(path)
    assert re.fullmatch(r"[\w-]{22}", made)
    assert path.stat().st_mode & 0o777 == 0o600
    assert program._key(path) == made


@pytest.mark.parametrize(
    ("text", "mode", "sentence"),
    [
        ("0123456789abcdef", 0o640, "other users may read"),
        ("short", 0o600, "must hold one word of 16"),
        ("two words of a key", 0o600, "must hold one word of 16"),
    ],
)
def test_a_key_that_protects_nothing_is_refused(tmp_path: Path, text: str, mode: int, sentence: str) -> None:
    path = tmp_path / "key"
    path.write_text(text)
    path.chmod(mode)
    with pytest.raises(UsageError, match=sentence):
        program._key(path)


def test_the_process_prints_a_working_address_and_ends_on_request(daemon: FakeDaemon) -> None:
    async def greet(address: str) -> str:
        async with ClientSession() as session, session.ws_connect(address) as opened:
            await opened.send_str('{"v": 1, "id": 1, "op": "hello"}')
            return str(await opened.receive_str())

    with gateway_process(daemon.directory) as address:
        assert '"ok":true' in asyncio.run(greet(address))


@asynchronous
async def test_the_viewer_is_a_gateway_too_for_programs_and_its_own_page(daemon: FakeDaemon) -> None:
    async with running(Viewer(str(daemon.directory), key=KEY).app()) as port, ClientSession() as session:
        own, address = f"http://127.0.0.1:{port}", f"ws://127.0.0.1:{port}/client"
        client = Program(await session.ws_connect(f"{address}?key={KEY}"))
        assert (await client.ask("hello"))["ok"]
        for query, headers in (("", {}), (f"?key={KEY}", {"Origin": "http://localhost:8000"})):
            with pytest.raises(WSServerHandshakeError, match="403"):
                await session.ws_connect(address + query, headers=headers)
        for path, code in (("/", 403), ("/shapes", 403), ("/main.js", 200), ("/server.py", 404), (f"/?key={KEY}", 200)):
            assert (await session.get(own + path)).status == code
