"""A host that drives an emulated board in the board's own time: the daemon's session and encoders, without a daemon."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hapticd.board_protocol import BoardTime, BoardVerdict
from hapticd.board_values import BoardCommand, BoardHello, BoardMessage, BoardStatus
from hapticd.core.board.session import BoardSession
from hapticd.sim.board.emulator import CHUNK_US, BenchReport, Emulator
from hapticd.values import Knot, LimitReason, SafeDrive, Tick
from hapticd.wire import device
from hapticd.wire.commands import encode

STEP_US = 2500


class Host:
    """Host and board share one clock, 2.5 ms steps and a line without delay. `now_us` does not wrap."""

    def __init__(self, board: Emulator, *, t_start_us: int = 0) -> None:
        self.board = board
        self.now_us = self._t_start_us = t_start_us
        self.messages: list[BoardMessage] = []
        self.reports: list[BenchReport] = []
        self.line = b""  # everything the board has said
        self.session = BoardSession(link_start_ns=1_000_000, controller="pi_ff")
        self._decoder = device.Decoder()
        self._to_say = encoded(self.session.link_up(self.now_us * 1000))

    @property
    def statuses(self) -> list[BoardStatus]:
        return [message for message in self.messages if isinstance(message, BoardStatus)]

    def say(self, data: bytes) -> None:
        """Bytes for the board, at the beginning of the next step."""
        self._to_say += data

    def ask(self, *knots: tuple[int, Sequence[complex]]) -> None:
        """The next reference: knots as (us from now, amplitudes)."""
        drive = SafeDrive(
            (self.now_us + knots[0][0]) * 1000,
            tuple(Knot((us - knots[0][0]) * 1000, tuple(w)) for us, w in knots),
            LimitReason.NONE,
        )
        tick = Tick(self.now_us * 1000, 0, 0, drive, (), False)
        self.say(encoded(self.session.reference(drive, tick, self.now_us * 1000)))

    def step(self, *, timer: bool = True) -> None:
        """2.5 ms; without `timer` the host's part of the conversation stays away."""
        if timer:
            self.say(encoded(self.session.timer(self.now_us * 1000)))
        data, self._to_say = self._to_say, b""
        seen, said = self.board.step(data, STEP_US // CHUNK_US)
        self.now_us += STEP_US
        self.reports += seen
        self.line += said
        for message in self._decoder.feed(said):
            self.messages.append(message)
            self.say(answer(self.session, message, self.now_us * 1000))

    def run(self, us: int) -> None:
        for _ in range(us // STEP_US):
            self.step()

    def plate_um(self) -> tuple[np.ndarray, np.ndarray]:
        """The bench's reports: instants on the host's clock (T,) us, and the truth (T, 2) um."""
        t_us = np.array([report.t_us for report in self.reports], dtype=np.int64)
        since_us = (t_us - self._t_start_us) % (1 << 32)
        return self._t_start_us + since_us, np.array([report.plate_um for report in self.reports])


def answer(session: BoardSession, message: BoardMessage, now_ns: int) -> bytes:
    """What the session says to a message."""
    match message:
        case BoardHello():
            return encoded(session.receive_hello(message, now_ns))
        case BoardVerdict():
            return encoded(session.receive_answer(now_ns))
        case BoardTime():
            session.receive_time(message, now_ns)
        case BoardStatus():
            session.receive_status(message, now_ns)
    return b""


def encoded(commands: Sequence[BoardCommand]) -> bytes:
    return b"".join(map(encode, commands))
