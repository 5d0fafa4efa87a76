"""A board stops reading: its terminal would take thousands of bytes of what is past by the time it reads again."""

from __future__ import annotations

import asyncio
from collections import Counter

import pytest
from asynchronous import asynchronous
from machine_bench import LIVE, NAMES, QUIET, STICKY, Bench, FakeBoard
from terminal import Terminal

from hapticd.io.devices.serial_link import SerialLink
from hapticd.sim.fingers.paths import Line
from hapticd.wire.framing import FrameSplitter


class TerminalBench(Bench):
    """The machine's lines go through the service's own serial link and a real pseudo-terminal; time stays virtual."""

    def __init__(self, terminal: Terminal, link: SerialLink) -> None:
        super().__init__(Line((-40.0, 5.0), (40.0, 5.0), 60.0), STICKY)
        self.is_stalled = False
        self.terminal = terminal
        self.machine.board.write = link.write

    def _step(self) -> None:
        super()._step()
        named = self.board.seq
        if not self.is_stalled:
            FakeBoard.write(self.board, self.terminal.heard())
        if self.board.seq != named:
            self.board.status()  # as the firmware reports each that takes effect

    def stall(self, is_stalled: bool) -> None:
        """Stop or resume the firmware; on resuming, its dead-man has tripped."""
        self.is_stalled = self.board.mute = is_stalled
        self.board.trusted, self.board.state = 0, QUIET


@pytest.mark.long
@pytest.mark.parametrize("stalled_ms", [100, 900, 5000])
@asynchronous
async def test_a_board_that_stopped_reading_finds_two_references_at_most(stalled_ms: int) -> None:
    terminal = Terminal()
    link = SerialLink(terminal.port, 921600)
    link.start(asyncio.get_running_loop(), lambda _: None, lambda *_: None)
    try:
        bench = TerminalBench(terminal, link)
        bench.driven().run(300)
        bench.stall(True)
        bench.run(stalled_ms)
        lying = Counter(NAMES[message[0]] for message in FrameSplitter(1000).feed(terminal.heard()))
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
        terminal.close()
