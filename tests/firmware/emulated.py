"""The whole firmware as a process that contains its plate (`firmware/boards/host`), and a host that drives it in the
board's own time: the daemon's session and encoders, without a daemon."""

from __future__ import annotations

import selectors
import socket
import struct
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hapticd.board_protocol import BoardTime, BoardVerdict
from hapticd.board_values import BoardCommand, BoardHello, BoardMessage, BoardStatus
from hapticd.core.board.session import BoardSession
from hapticd.values import Knot, LimitReason, SafeDrive, Tick
from hapticd.wire import device
from hapticd.wire.commands import encode

STEP_US = 2500
CHUNK_US = 50
ANSWER_WITHIN_S = 30.0
READ_SIZE = 1 << 16
STEP = struct.Struct("<IH")
REPORT = struct.Struct("<IIH4f")


class BenchReport(NamedTuple):
    """The plate's ground truth at `t_us` of the board's clock, and how many bytes and steps the board has done."""

    t_us: int
    line_bytes: int
    steps: int
    plate_um: tuple[complex, complex]


class Emulator:
    """A board that runs by `step` alone, so that it is deterministic."""

    def __init__(self, program: Path, *, boot_id: int, t_start_us: int) -> None:
        self._line, line_end = socket.socketpair()
        self._bench, bench_end = socket.socketpair()
        ends = (line_end.fileno(), bench_end.fileno())
        command = [str(program), "--stepped", "--line", str(ends[0]), "--bench", str(ends[1])]
        command += ["--boot-id", str(boot_id), "--start-us", str(t_start_us)]
        with line_end, bench_end:
            self._process = subprocess.Popen(command, stdin=subprocess.DEVNULL, pass_fds=ends)
        self._steps = self._sent = self._received = 0
        self._partial_report = self._bench.recv(READ_SIZE)  # the first marks the ports as open; earlier bytes are lost

    def __enter__(self) -> Emulator:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        self._line.close()
        self._bench.close()

    def step(self, data: bytes, chunks: int) -> tuple[list[BenchReport], bytes]:
        """Send `data` and run for `chunks` of 50 us; returns bench reports and output."""
        self._line.sendall(data)
        self._sent += len(data)
        self._steps += 1
        self._bench.sendall(STEP.pack(self._sent, chunks))
        reports: list[BenchReport] = []
        output = b""
        with selectors.DefaultSelector() as selector:
            selector.register(self._line, selectors.EVENT_READ)
            selector.register(self._bench, selectors.EVENT_READ)
            while not reports or (reports[-1].steps, reports[-1].line_bytes) != (self._steps & 0xFFFF, self._received):
                ready = selector.select(ANSWER_WITHIN_S)
                assert ready, "the emulated board does not answer"
                for key, _ in ready:
                    if key.fileobj is self._bench:
                        reports += self._reports()
                    else:
                        said = self._line.recv(READ_SIZE)
                        output += said
                        self._received += len(said)
        return reports, output

    def _reports(self) -> list[BenchReport]:
        data = self._partial_report + self._bench.recv(READ_SIZE)
        whole = len(data) - len(data) % REPORT.size
        self._partial_report = data[whole:]
        return [
            BenchReport(t_us, line_bytes, steps, (complex(*parts[:2]), complex(*parts[2:])))
            for t_us, line_bytes, steps, *parts in REPORT.iter_unpack(data[:whole])
        ]


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
