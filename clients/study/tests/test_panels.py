"""Keys of the panels, in a terminal and in a browser."""

from __future__ import annotations

import http.client
import io
import json
import os
import pty
import socket
import termios
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

import pytest
from people import paper

from hapticd_study import panel
from hapticd_study.browser import Browser
from hapticd_study.experiment import StudyError
from hapticd_study.keyboard import Keyboard

TRIAL, NEXT_TRIAL = (panel.trial(paper(), f"Trial {number} of 20") for number in (3, 4))


def pressed_soon(keyboard: Keyboard) -> str | None:
    """Poll: a pseudo-terminal delivers bytes with a delay."""
    return next((key for _ in range(100_000) if (key := keyboard.pressed()) is not None), None)


@pytest.fixture
def terminal() -> Iterator[tuple[int, int]]:
    ours, theirs = pty.openpty()
    yield ours, theirs
    os.close(ours)
    os.close(theirs)


@pytest.mark.parametrize(("typed", "key"), [(b"f", "high"), (b"J", "low"), (b"x p", "pause")])
def test_a_key_is_read_without_enter_and_the_terminal_restored(
    terminal: tuple[int, int], typed: bytes, key: str
) -> None:
    before = termios.tcgetattr(terminal[1])
    with Keyboard(io.StringIO(), terminal[1]) as keyboard:
        assert termios.tcgetattr(terminal[1]) != before
        keyboard.show(TRIAL)
        assert keyboard.pressed() is None
        os.write(terminal[0], typed)
        assert pressed_soon(keyboard) == key
        assert keyboard.pressed() is None
    assert termios.tcgetattr(terminal[1]) == before


def test_what_was_typed_ahead_does_not_answer_the_next_trial(terminal: tuple[int, int]) -> None:
    with Keyboard(io.StringIO(), terminal[1]) as keyboard:
        keyboard.show(TRIAL)
        os.write(terminal[0], b"fjf")
        assert pressed_soon(keyboard) == "high"
        keyboard.show(NEXT_TRIAL)
        assert keyboard.pressed() is None


def test_the_end_of_input_ends_the_session() -> None:
    read, write = os.pipe()
    os.write(write, b"j")
    os.close(write)
    with Keyboard(io.StringIO(), read) as keyboard:
        keyboard.show(TRIAL)
        assert keyboard.pressed() == "low"
        with pytest.raises(KeyboardInterrupt):
            keyboard.pressed()
    os.close(read)


@pytest.fixture
def page() -> Iterator[Browser]:
    with Browser() as running:
        yield running


def ask(page: Browser, path: str, body: bytes | None = None, **headers: str) -> tuple[int, str, Any]:
    """Status, text and headers of a request, as a browser on the page would send it unless headers say otherwise."""
    address = urlsplit(page.url)
    sent = {"Host": address.netloc, **({} if body is None else {"Origin": f"http://{address.netloc}"}), **headers}
    connection = http.client.HTTPConnection(address.netloc, timeout=10.0)
    target = f"/{path}" if "?" in path else f"/{path}?{address.query}"
    connection.request("GET" if body is None else "POST", target, body, {name: v for name, v in sent.items() if v})
    response = connection.getresponse()
    text = response.read().decode()
    connection.close()
    return response.status, text, response.headers


def press(page: Browser, number: Any, key: Any, **headers: str) -> int:
    return ask(page, "press", json.dumps({"number": number, "key": key}).encode(), **headers)[0]


def test_the_page_shows_the_screen_and_takes_its_keys_until_the_next(page: Browser) -> None:
    page.show(TRIAL)
    page.note("Touch the plate first.")
    shown = json.loads(ask(page, "screen")[1])
    assert (shown["heading"], shown["text"], shown["note"]) == (*TRIAL[:2], "Touch the plate first.")
    assert shown["keys"] == [key._asdict() for key in TRIAL.keys]
    assert press(page, shown["number"], "low") == 200
    assert (page.pressed(), page.pressed()) == ("low", None)
    page.show(NEXT_TRIAL)
    assert press(page, shown["number"], "low") == 200
    assert page.pressed() is None


@pytest.mark.parametrize("name", ["", "study.css", "study.js"])
def test_the_page_needs_nothing_from_elsewhere(page: Browser, name: str) -> None:
    status, text, headers = ask(page, name)
    assert status == 200
    assert "//" not in text.replace("// ", "")
    assert headers["Content-Security-Policy"].startswith("default-src 'none'; script-src 'self'")


@pytest.mark.parametrize("name", ["", "screen", "press"])
def test_only_the_page_that_was_printed_comes_in(page: Browser, name: str) -> None:
    body = b"{}" if name == "press" else None
    for path, headers in (
        (name, {"Host": "evil.example"}),
        (f"{name}?key=guessed", {}),
        (name, {"Origin": "http://evil.example"}),
    ):
        assert ask(page, path, body, **headers)[0] == 403
    page.show(TRIAL)
    assert press(page, 1, "low", Origin="") == 403
    assert page.pressed() is None


@pytest.mark.parametrize("body", [b"", b"{", b"[]", b"3", b'{"number": 1}', b'{"number": 1, "key": []}', b"[" * 250])
def test_a_press_that_is_none_is_refused(page: Browser, body: bytes) -> None:
    assert ask(page, "press", body)[0] == 400
    assert page.pressed() is None


def test_a_long_press_a_malformed_request_and_a_port_in_use_are_refused(
    page: Browser, caplog: pytest.LogCaptureFixture
) -> None:
    assert ask(page, "press", b"{" + b" " * 10_000 + b"}")[0] == 413
    port = urlsplit(page.url).port
    assert port is not None
    for request in (b"GET / HTTP/1.1\r\n\r\n", b"\x16\x03\x01\x02\x00\r\n\r\n"):
        with socket.create_connection(("127.0.0.1", port), timeout=10.0) as connection:
            connection.sendall(request)
            assert connection.recv(4096).partition(b"\r\n")[0].split()[1] in (b"400", b"403")
    assert caplog.text == ""
    with pytest.raises(StudyError, match=f"--page-port: {port} cannot be bound"):
        Browser(port)
