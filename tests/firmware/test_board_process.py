"""The firmware as a process of its own: what stands behind its terminal, and how it ends."""

from __future__ import annotations

import os
import selectors
import signal
import subprocess
import tty
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from hapticd.board_values import BoardHello, BoardMessage
from hapticd.wire import device

pytestmark = pytest.mark.long

PATIENCE_S = 30.0


Start = Callable[..., tuple[subprocess.Popen[str], str]]


@pytest.fixture
def start(program: Path) -> Iterator[Start]:
    """Starts it; the process and its terminal's name."""
    with ExitStack() as stack:

        def started(*options: str) -> tuple[subprocess.Popen[str], str]:
            process = subprocess.Popen(
                [str(program), *options],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
            stack.enter_context(process)
            stack.callback(process.kill)
            assert process.stdout is not None
            return process, process.stdout.readline().strip()

        yield started


def greet(port: str) -> BoardHello:
    """Open the terminal as the daemon does, and ask who is there until it says so."""
    fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
    decoder = device.Decoder()
    try:
        tty.setraw(fd)
        os.write(fd, device.encode_hello_request())
        with selectors.DefaultSelector() as selector:
            selector.register(fd, selectors.EVENT_READ)
            while selector.select(PATIENCE_S):
                messages: tuple[BoardMessage, ...] = decoder.feed(os.read(fd, 4096))
                for message in messages:
                    if isinstance(message, BoardHello):
                        return message
    finally:
        os.close(fd)
    raise AssertionError("the board did not answer")


def test_it_prints_the_terminal_behind_which_the_board_answers(start: Start) -> None:
    _, terminal = start()
    device.check_hello(greet(terminal), modes=2, w_limit_um=(4.0, 4.0))


def test_a_daemon_that_leaves_does_not_end_it(start: Start) -> None:
    _, terminal = start()
    assert greet(terminal) == greet(terminal)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_quietly_and_takes_the_link_along(
    start: Start, tmp_path: Path, number: signal.Signals
) -> None:
    link = tmp_path / "board"
    process, terminal = start("--link", str(link))
    assert os.readlink(link) == terminal
    greet(str(link))
    process.send_signal(number)
    assert process.wait(PATIENCE_S) == 0
    assert process.stderr is not None
    assert process.stderr.read() == ""
    assert not link.is_symlink()


def test_it_ends_with_its_owner(start: Start) -> None:
    process, _ = start("--owned")
    assert process.stdin is not None
    process.stdin.close()
    assert process.wait(PATIENCE_S) == 0


def test_a_link_that_cannot_be_made_is_one_sentence(start: Start, tmp_path: Path) -> None:
    process, _ = start("--link", str(tmp_path / "missing" / "board"))
    assert process.wait(PATIENCE_S) == 1
    assert process.stderr is not None
    assert process.stderr.read() == f"hapticd-board: {tmp_path}/missing/board: No such file or directory\n"


def test_a_link_takes_the_place_of_an_older_one_but_of_no_file(start: Start, tmp_path: Path) -> None:
    old, precious = tmp_path / "old", tmp_path / "precious"
    old.symlink_to("gone")
    precious.write_text("mine")
    _, terminal = start("--link", str(old))
    assert os.readlink(old) == terminal
    process, _ = start("--link", str(precious))
    assert process.wait(PATIENCE_S) == 1
    assert precious.read_text() == "mine"


def test_an_option_that_it_does_not_know_is_refused_with_the_ones_it_knows(start: Start) -> None:
    process, _ = start("--loud")
    assert process.wait(PATIENCE_S) == os.EX_USAGE
    assert process.stderr is not None
    assert "usage: hapticd-board [--link PATH]" in process.stderr.read()
