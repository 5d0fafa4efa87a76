"""Progress: late enough to matter, with an estimate; a bar that is gone at the end, or lines in a pipe."""

from __future__ import annotations

import io

from hapticd.tools.progress import Progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class Clock:
    def __init__(self) -> None:
        self.t_s = 0.0

    def __call__(self) -> float:
        return self.t_s


def test_long_work_shows_how_much_is_done_and_what_is_left() -> None:
    clock, terminal = Clock(), Terminal()
    with Progress("measuring", stream=terminal, clock_s=clock) as progress:
        for clock.t_s, done in ((0.5, 0.1), (5.0, 0.25), (5.01, 0.26), (300.0, 0.5)):
            progress(done)
        shown = terminal.getvalue().split("\r\x1b[K")
        assert shown[1:] == [
            "measuring [######..................]  25 %, 15 s left",
            "measuring [############............]  50 %, 5 min left",
        ]
    assert terminal.getvalue().endswith("\r\x1b[K")


def test_short_work_shows_nothing() -> None:
    for stream, seconds in ((Terminal(), 0.9), (io.StringIO(), 9.0)):
        clock = Clock()
        with Progress("measuring", stream=stream, clock_s=clock) as progress:
            clock.t_s = seconds
            progress(0.5)
        assert stream.getvalue() == ""


def test_a_pipe_gets_a_line_every_ten_seconds() -> None:
    clock, pipe = Clock(), io.StringIO()
    with Progress("measuring", stream=pipe, clock_s=clock) as progress:
        for second in range(31):
            clock.t_s = float(second)
            progress(second / 40)
    assert pipe.getvalue().splitlines() == [
        "measuring: 25 %, 30 s left",
        "measuring: 50 %, 20 s left",
        "measuring: 75 %, 10 s left",
    ]
