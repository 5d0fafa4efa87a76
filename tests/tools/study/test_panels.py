"""Keys of the panels, in a terminal and in a browser."""

from __future__ import annotations

import http.client
import io
import json
import os
import pty
import termios
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

import pytest
from people import paper

from hapticd.tools.study import panel
from hapticd.tools.study.browser import Browser
from hapticd.tools.study.keyboard import Keyboard
from hapticd.tools.study.panel import Screen


def trial(number: int) -> Screen:
    return panel.trial(paper(), panel.numbered(number, 20))


TRIAL = trial(3)


def pressed_soon(keyboard: Keyboard) -> str | None:
    """Poll: a pseudo-terminal delivers bytes with a delay."""
    return next((key for _ in range(100_000) if (key := keyboard.pressed()) is not None), None)


# --- the terminal -----------------------------------------------------------------------------------------------


@pytest.fixture
def terminal() -> Iterator[tuple[int, int]]:
    ours, theirs = pty.openpty()
    yield ours, theirs
    os.close(ours)
    os.close(theirs)


@pytest.mark.parametrize(("typed", "key"), [(b"f", "high"), (b"J", "low"), (b"x p", "pause")])
def test_a_key_is_read_without_enter(terminal: tuple[int, int], typed: bytes, key: str) -> None:
    with Keyboard(io.StringIO(), terminal[1]) as keyboard:
        keyboard.show(TRIAL)
        assert keyboard.pressed() is None
        os.write(terminal[0], typed)
        assert pressed_soon(keyboard) == key
        assert keyboard.pressed() is None


def test_what_was_typed_ahead_does_not_answer_the_next_trial(terminal: tuple[int, int]) -> None:
    with Keyboard(io.StringIO(), terminal[1]) as keyboard:
        keyboard.show(TRIAL)
        os.write(terminal[0], b"fjf")
        assert pressed_soon(keyboard) == "high"
        keyboard.show(trial(4))
        assert keyboard.pressed() is None


def test_the_terminal_is_restored(terminal: tuple[int, int]) -> None:
    before = termios.tcgetattr(terminal[1])
    with Keyboard(io.StringIO(), terminal[1]):
        assert termios.tcgetattr(terminal[1]) != before
    assert termios.tcgetattr(terminal[1]) == before


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


# --- the browser ------------------------------------------------------------------------------------------------


@pytest.fixture
def page() -> Iterator[Browser]:
    with Browser() as running:
        yield running


def ask(
    page: Browser, path: str, body: bytes | None = None, **headers: str
) -> tuple[int, str, http.client.HTTPMessage]:
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


def now(page: Browser) -> dict[str, Any]:
    return dict(json.loads(ask(page, "screen")[1]))


def test_the_page_shows_the_screen_and_takes_its_keys(page: Browser) -> None:
    page.show(TRIAL)
    page.note("Touch the plate first.")
    shown = now(page)
    assert (shown["heading"], shown["text"], shown["note"]) == (*TRIAL[:2], "Touch the plate first.")
    assert shown["keys"] == [key._asdict() for key in TRIAL.keys]
    assert press(page, shown["number"], "low") == 200
    assert page.pressed() == "low"
    assert page.pressed() is None


def test_a_press_on_an_earlier_screen_does_not_count(page: Browser) -> None:
    page.show(TRIAL)
    number = now(page)["number"]
    page.show(trial(4))
    assert press(page, number, "low") == 200
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
    assert ask(page, name, body, Host="evil.example")[0] == 403
    assert ask(page, f"{name}?key=guessed", body)[0] == 403


@pytest.mark.parametrize("origin", ["http://evil.example", ""])
def test_a_foreign_origin_cannot_answer(page: Browser, origin: str) -> None:
    page.show(TRIAL)
    assert press(page, now(page)["number"], "low", Origin=origin) == 403
    assert page.pressed() is None


@pytest.mark.parametrize("body", [b"", b"{", b"[]", b"3", b'{"number": 1}', b'{"number": 1, "key": []}', b"[" * 250])
def test_a_press_that_is_none_is_refused(page: Browser, body: bytes) -> None:
    assert ask(page, "press", body)[0] == 400
    assert page.pressed() is None


def test_a_press_in_an_unknown_charset_is_refused(page: Browser) -> None:
    assert ask(page, "press", b"{}", **{"Content-Type": "application/json; charset=none"})[0] == 400


def test_a_long_press_is_not_read(page: Browser) -> None:
    assert ask(page, "press", b"{" + b" " * 10_000 + b"}")[0] == 413
