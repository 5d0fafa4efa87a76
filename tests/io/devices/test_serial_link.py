"""The serial link over a pseudo-terminal: open, lose, find again, and never queue what is stale."""

from __future__ import annotations

import asyncio
import functools
import os
import termios
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest
from asynchronous import until
from terminal import Terminal
from virtual_board import in_virtual_time

from hapticd.io.devices import serial_link
from hapticd.io.devices.serial_link import SerialLink
from hapticd.io.time_budget import TimeBudget


class Port:
    """A board's port: a link in the file system to a pseudo-terminal that can be pulled and put back."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._terminal: Terminal | None = None

    def plug(self) -> None:
        self._terminal = Terminal()
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(self._terminal.port)

    def pull(self) -> None:
        if self._terminal is not None:
            self._terminal.close()
            self._terminal = None
        self.path.unlink(missing_ok=True)

    @property
    def terminal(self) -> Terminal:
        assert self._terminal is not None
        return self._terminal

    def say(self, data: bytes) -> None:
        os.write(self.terminal.master, data)

    def received(self) -> bytes:
        return self.terminal.received()

    @property
    def speed(self) -> int:
        found: int = termios.tcgetattr(self.terminal.slave)[5]
        return found


class Bench:
    """A link on a port, with its events."""

    def __init__(self, path: Path) -> None:
        self.port = Port(path)
        self.link = SerialLink(str(path), 921600)
        self.links: list[tuple[bool, str]] = []
        self.data = b""

    def open(self) -> None:
        """Start it on a port that is there."""
        self.port.plug()
        self.start()

    def start(self) -> None:
        self.link.start(asyncio.get_running_loop(), self._on_bytes, lambda up, reason: self.links.append((up, reason)))

    def _on_bytes(self, data: bytes) -> None:
        self.data += data

    async def tried_again(self) -> None:
        """Wait for another attempt to open the port."""
        planned = self.link._retry
        await until(lambda: self.link._retry is not planned)


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(serial_link, "RETRY_S", 0.01)
    bench = Bench(tmp_path / "board")
    yield bench
    bench.port.pull()


def played(scenario: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """Run a test coroutine on an event loop, and close the link on that loop."""

    @functools.wraps(scenario)
    def test(bench: Bench, **fixtures: Any) -> None:
        async def run() -> None:
            try:
                await scenario(bench, **fixtures)
            finally:
                bench.link.close()

        asyncio.run(run())

    return test


@played
async def test_another_speed_lasts_until_the_port_is_opened_again(bench: Bench) -> None:
    bench.open()
    assert bench.port.speed == termios.B921600
    bench.link.set_baud(3_000_000)
    assert bench.port.speed == termios.B3000000
    assert bench.link.write(b"still here")
    assert bench.port.received() == b"still here"
    bench.port.say(b"there too")
    await until(lambda: bench.data == b"there too")
    bench.port.pull()
    bench.link.set_baud(921600)
    await until(lambda: not bench.links[-1][0])
    bench.port.plug()
    await until(lambda: bench.links[-1][0])
    assert bench.port.speed == termios.B921600


@played
async def test_a_missing_port_is_reported_once_and_opened_when_it_appears(bench: Bench) -> None:
    bench.start()
    assert bench.links == [(False, f"{bench.port.path} cannot be opened: No such file or directory")]
    assert not bench.link.write(b"not open")
    await bench.tried_again()
    bench.port.plug()
    await until(lambda: len(bench.links) == 2)
    assert bench.links[1][0]


@pytest.mark.parametrize("gone_s", [0.3, 2.0, 20.0])
def test_a_port_that_is_back_is_opened_within_a_quarter_of_a_second(gone_s: float, tmp_path: Path) -> None:
    bench = Bench(tmp_path / "board")

    async def scenario() -> float:
        loop = asyncio.get_running_loop()
        bench.start()
        await asyncio.sleep(gone_s)
        bench.port.plug()
        t_back_s = loop.time()
        while len(bench.links) < 2:
            await asyncio.sleep(0.005)
        bench.link.close()
        return loop.time() - t_back_s

    assert in_virtual_time(scenario()) <= 0.26
    bench.port.pull()


@played
async def test_unplugging_is_reported_once_and_the_board_is_reopened(bench: Bench) -> None:
    bench.open()
    bench.port.pull()
    await until(lambda: len(bench.links) == 2)
    assert not bench.links[1][0]
    assert bench.links[1][1].startswith(f"{bench.port.path} lost: ")
    await bench.tried_again()
    assert len(bench.links) == 2
    bench.port.plug()
    await until(lambda: len(bench.links) == 3)
    assert bench.link.write(b"again")
    assert bench.port.received() == b"again"


@played
async def test_a_board_that_stalls_loses_frames_and_finds_no_queue_of_stale_ones(bench: Bench) -> None:
    bench.open()
    frame = bytes(4000)
    written = [bench.link.write(frame) for _ in range(64)]
    assert written[0]
    assert False in written
    while bench.port.received():
        pass
    bench.link.write(bytes(70_000))  # more than a pty takes: torn
    while bench.port.received():
        pass
    assert bench.link.write(b"fresh")
    assert bench.port.received() == b"\0fresh"
    assert bench.link.write(b"whole")
    assert bench.port.received() == b"whole"


@played
async def test_a_port_in_use_is_reported(bench: Bench) -> None:
    bench.port.plug()
    other = SerialLink(str(bench.port.path), 921600)
    other.start(asyncio.get_running_loop(), lambda _: None, lambda *_: None)
    try:
        bench.start()
        assert bench.links == [(False, f"{bench.port.path} cannot be opened: another program holds it")]
    finally:
        other.close()


@played
async def test_bytes_that_may_wait_do_so_until_they_are_read(bench: Bench) -> None:
    bench.open()
    bench.link.wait(True)
    for data in (b"one", b"two"):
        bench.port.say(data)
    await until(lambda: bench.port.terminal.waiting == len(b"onetwo"))
    for _ in range(3):
        await asyncio.sleep(0)  # the loop looks at its descriptors each time
    assert bench.data == b""
    bench.link.read()
    assert bench.data == b"onetwo"
    bench.link.read()  # there is nothing
    bench.port.say(b"late")
    await until(lambda: bench.port.terminal.waiting == len(b"late"))
    assert bench.data == b"onetwo"
    bench.link.wait(False)  # the loop does
    await until(lambda: bench.data == b"onetwolate")


@played
async def test_bytes_beyond_the_time_budget_are_dropped_and_counted(bench: Bench) -> None:
    bench.link._budget = TimeBudget(1e-9, 1)
    bench.open()
    bench.port.say(b"first")
    await until(lambda: bench.data == b"first")
    bench.port.say(b"second")
    await until(lambda: bench.link.left_out > 0)
    bench.link._budget = TimeBudget(1.0, 1_000_000)
    bench.port.say(b"third")
    await until(lambda: bench.data == b"firstthird")
