"""Other users of this computer: they do not see the page's key, and their requests leave no traceback."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import stat
import webbrowser
from collections.abc import Iterator
from html import escape
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from asynchronous import asynchronous
from web_apps import running

from hapticd.__main__ import main
from hapticd.tools.view.server import Viewer


@pytest.fixture(autouse=True)
def _own_signals() -> Iterator[None]:
    """The command installs handlers of its own."""
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def test_the_browsers_command_line_has_a_private_file_and_no_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found: list[tuple[Path, int, int, str]] = []

    def browser(address: str) -> bool:
        file = Path(unquote(urlsplit(address).path))
        modes = [stat.S_IMODE(path.stat().st_mode) for path in (file, file.parent)]
        found.append((file, modes[0], modes[1], file.read_text()))
        os.kill(os.getpid(), signal.SIGTERM)
        return True

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(webbrowser, "open", browser)
    assert main(["view", "--port", "0", "--endpoint", str(tmp_path)]) == 0
    address = capsys.readouterr().out.partition("the plate: ")[2].split()[0]
    ((file, file_mode, folder_mode, text),) = found
    assert address.partition("key=")[2] not in str(file)
    assert (file_mode, folder_mode) == (0o600, 0o700)
    assert f'url={escape(address)}"' in text
    assert not file.parent.exists()


MALFORMED = (
    b"GET / HTTP/1.1\r\n\r\n",  # no Host
    b"GET /?" + b"a" * 9000 + b" HTTP/1.1\r\nHost: localhost\r\n\r\n",
    b"GET http://[ HTTP/1.1\r\nHost: localhost\r\n\r\n",
    b"\x16\x03\x01\x02\x00\r\n\r\n",  # https
)


def answers(port: int) -> list[bytes]:
    """First line of each answer to a malformed request."""
    lines = []
    for request in MALFORMED:
        with socket.create_connection(("127.0.0.1", port), timeout=10.0) as connection:
            connection.sendall(request)
            lines.append(connection.recv(4096).partition(b"\r\n")[0])
    return lines


@asynchronous
async def test_a_malformed_request_to_the_viewer_is_refused_without_a_traceback(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with running(Viewer(str(tmp_path)).app()) as port:
        lines = await asyncio.to_thread(answers, port)
    assert all(b" 400 " in line for line in lines)
    assert caplog.text == ""
