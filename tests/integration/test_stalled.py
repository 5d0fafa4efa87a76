"""A board stops reading: its terminal would take thousands of bytes of what is past by the time it reads again."""

from __future__ import annotations

import asyncio
import os
import pty
import sys
import tty
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from asynchronous import asynchronous

sys.path.insert(0, str(Path(__file__).parents[1]))

from machine_bench import LIVE, NAMES, QUIET, STICKY, Bench, FakeBoard

from hapticd.io.devices.serial_link import SerialLink
from hapticd.sim.fingers.paths import Line
from hapticd.wire.framing import FrameSplitter


class TerminalBench(Bench):
    """The machine's lines go through the service's own serial link and a real pseudo-terminal; time stays virtual."""

    def __init__(self, master: int, link: SerialLink) -> None:
        super().__init__(Line((-40.0, 5.0), (40.0, 5.0), 60.0), STICKY)
        self.is_stalled = False
        self._master = master
        self.machine.board.write = link.write

    def _step(self) -> None:
        super()._step()
        named = self.board.seq
        if not self.is_stalled:
            FakeBoard.write(self.board, self.unread())
        if self.board.seq != named:
            self.board.status()  # as the firmware reports each that takes effect

    def stall(self, is_stalled: bool) -> None:
        """Stop or resume the firmware; on resuming, its dead-man has tripped."""
        self.is_stalled = self.board.mute = is_stalled
        self.board.trusted, self.board.state = 0, QUIET

    def unread(self) -> bytes:
        """All that lies in the terminal."""
        try:
            return os.read(self._master, 1 << 16)
        except BlockingIOError:
            return b""


@pytest.fixture
def terminal() -> Iterator[tuple[int, Path]]:
    master, slave = pty.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    yield master, Path(os.ttyname(slave))
    os.close(master)
    os.close(slave)


@pytest.mark.long
@pytest.mark.parametrize("stalled_ms", [100, 900, 5000])
@asynchronous
async def test_a_board_that_stopped_reading_finds_two_references_at_most(
    terminal: tuple[int, Path], stalled_ms: int
) -> None:
    master, port = terminal
    link = SerialLink(str(port), 921600)
    link.start(asyncio.get_running_loop(), lambda _: None, lambda *_: None)
    try:
        bench = TerminalBench(master, link)
        bench.driven().run(300)
        bench.stall(True)
        bench.run(stalled_ms)
        lying = Counter(NAMES[message[0]] for message in FrameSplitter(1000).feed(bench.unread()))
        assert 1 <= lying["reference"] <= 2
        assert lying["keep-alive"] <= 1
        assert link.dropped_writes == 0  # the terminal would have taken more
        bench.stall(False)
        bench.want({1: 1.0, 2: 0.0})
        bench.run(600)
        assert bench.board.state == LIVE
        assert bench.board.peak_um > 0.5
    finally:
        link.close()
