"""A machine in virtual time between a pad that sends genuine reports, a board that answers as the firmware does, and
a client. For the tests of `hapticd.daemon.machine`."""

from __future__ import annotations

import logging
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import msgpack
import pytest
from pipeline_bench import MS, PLATE

from hapticd import board_protocol as protocol
from hapticd.board_values import UNCALIBRATED, BoardCalibration
from hapticd.config.sections import Config
from hapticd.core.board.supervisor import State
from hapticd.core.plate.mode_shapes import ParasiticModes
from hapticd.daemon.machine import TIMER_NS, Machine
from hapticd.daemon.observer import Observer
from hapticd.sim.fingers.pad_noise import PadNoise
from hapticd.sim.fingers.paths import Path, Rest, Touch
from hapticd.sim.fingers.sensor import SensorModel, SensorSettings
from hapticd.values import RawReport
from hapticd.wire.framing import FrameSplitter, encode_frame

START_NS = 900_000_000_000
SLIPPERY, STICKY = Rest((-30.2, 5.1)), Rest((21.3, -14.9))
QUIET, LIVE, FAULT = 0, 1, 2

NAMES = {
    protocol.MSG_HELLO_REQUEST: "hello",
    protocol.MSG_REFERENCE: "reference",
    protocol.MSG_KEEPALIVE: "keep-alive",
    protocol.MSG_TIME_REQUEST: "time",
    protocol.MSG_CLEAR_FAULT: "clear fault",
    protocol.MSG_SET_CONTROLLER: "controller",
    protocol.MSG_SET_MODEL: "model",
    protocol.MSG_SET_WIRING: "wiring",
    protocol.MSG_SET_TELEMETRY: "telemetry",
}
NUMBERS = {name: number for number, name in NAMES.items()}


@dataclass(frozen=True)
class Received:
    """One message that reached the board; `peak_um` is the largest amplitude of a reference."""

    t_ns: int
    name: str
    peak_um: float = 0.0


@dataclass
class FakeBoard:
    """The other end of the line: receives all, and answers as the firmware does."""

    bench: Bench
    protocol_hash: int
    received: list[Received] = field(default_factory=list)
    plugged: bool = True
    mute: bool = False
    boot_id: int = 7
    state: int = QUIET
    fault_code: int = 0
    trusted: int = 0
    seq: int = 0
    peak_um: float = 0.0

    def __post_init__(self) -> None:
        self._splitter = FrameSplitter(1000)

    def write(self, line: bytes) -> int | None:
        if not self.plugged:
            return None
        for message in self._splitter.feed(line):
            self._hear(NAMES[message[0]], message[1:])
        return self.bench.t_ns

    def _hear(self, name: str, payload: bytes) -> None:
        if name == "reference":
            self.peak_um = peak_um(payload)
            self.seq = protocol.REFERENCE.unpack_from(payload)[0]
            self.trusted += 1
            if self.state == QUIET and self.trusted >= 3:
                self.state = LIVE
        self.received.append(Received(self.bench.t_ns, name, self.peak_um if name == "reference" else 0.0))
        if name == "hello":
            self.reset()
            limits = struct.pack("<ff", 4.0, 4.0)
            head = (protocol.PROTOCOL_VERSION, self.protocol_hash, 2, b"9.9", self.boot_id, 2000.0, 29205.0, 50, 150.0)
            self.say(protocol.MSG_HELLO, protocol.HELLO.pack(*head) + limits)
        elif name == "time":
            (stamp,) = protocol.TIME_REQUEST.unpack(payload)
            self.say(protocol.MSG_TIME, protocol.TIME.pack(stamp, self.bench.t_ns // 1000 % 2**32, 0))
        elif name in ("controller", "model", "wiring", "telemetry"):
            self.say(protocol.MSG_VERDICT, protocol.VERDICT.pack(NUMBERS[name], 0))
        elif name == "clear fault" and self.state == FAULT:
            self.state, self.fault_code = QUIET, 0
            self.status()

    def reset(self) -> None:
        """What a dead-man trip, a greeting or a reboot does: a latched fault stays."""
        self.trusted, self.peak_um = 0, 0.0
        if self.state != FAULT:
            self.state = QUIET

    def latch(self, fault_code: int) -> None:
        """A fault that stays until it is cleared, and the status that tells of it."""
        self.state, self.fault_code = FAULT, fault_code
        self.status()

    def status(self) -> None:
        now_us = self.bench.t_ns // 1000 % 2**32
        head = (now_us, self.state, 1, self.fault_code, 2, self.seq, now_us, now_us, 0, 0, 0)
        self.say(protocol.MSG_STATUS, protocol.STATUS.pack(*head) + bytes(32))

    def say(self, message: int, payload: bytes) -> None:
        if not self.mute:
            if message == protocol.MSG_TIME:
                stamp, t_us, _ = protocol.TIME.unpack(payload)
                payload = protocol.TIME.pack(stamp, t_us, t_us)
            self.bench.from_board.append(encode_frame(bytes((message,)) + payload))


def peak_um(payload: bytes) -> float:
    _, _, knots, modes = protocol.REFERENCE.unpack_from(payload)
    width = 2 + 8 * modes
    rows = (
        struct.unpack_from(f"<H{2 * modes}f", payload, protocol.REFERENCE.size + i * width)[1:] for i in range(knots)
    )
    return max(abs(part) for row in rows for part in row)


class Bench:
    """A machine between a pad, a board and a client, and the instant they are at."""

    new_board: Callable[..., Any] = FakeBoard

    def __init__(
        self,
        *paths: Path,
        protocol_hash: int = protocol.PROTOCOL_HASH,
        calibration: BoardCalibration = UNCALIBRATED,
        config: Config | None = None,
        observer: Callable[[Machine], Observer] | None = None,
        parasitic_modes: ParasiticModes | None = None,
    ) -> None:
        self.t_ns = START_NS
        self.from_board: list[bytes] = []
        self.board = self.new_board(self, protocol_hash)
        config = Config() if config is None else config
        self.machine = Machine(
            *(config, PLATE),
            write_board=self.board.write,
            instance=4,
            calibration=calibration,
            parasitic_modes=parasitic_modes,
        )
        self.machine.observer = None if observer is None else observer(self.machine)
        self.machine.trackpad_link(True, "a pad", self.t_ns)
        self.machine.board_link(True, "a board", self.t_ns)
        self._reports = self._sense(paths)
        self._next = next(self._reports, None)
        self.pad_speaks = self.timer_runs = True

    def _sense(self, paths: tuple[Path, ...]) -> Iterator[RawReport]:
        landed = [Touch(path, 0.3) for path in paths]
        model = SensorModel(SensorSettings(noise=PadNoise(0.0), stamp_jitter_ms=0.0), 1)
        for report in model.reports(landed, 30.0):
            yield RawReport(START_NS + round(report.t_arrive_s * 1e9), report.data)

    def run(self, milliseconds: int) -> list[Received]:
        """Let time pass; what the board received meanwhile."""
        before = len(self.board.received)
        for _ in range(milliseconds):
            self.t_ns += MS
            self._step()
        return self.board.received[before:]

    def _step(self) -> None:
        waiting, self.from_board = self.from_board, []
        for data in waiting:
            if self.board.plugged:
                self.machine.board_bytes(data, self.t_ns)
        while self._next is not None and self._next.t_host_ns <= self.t_ns:
            if self.pad_speaks:
                self.machine.reports([self._next], self.t_ns)
            self._next = next(self._reports, None)
        if self.timer_runs and (self.t_ns - START_NS) % TIMER_NS == 0:
            self.machine.timer(self.t_ns)
        if (self.t_ns - START_NS) % (100 * MS) == 0:
            self.board.status()

    def set_targets(self, targets: dict[int | str, float], ttl_s: float = 5.0) -> None:
        items = [{"finger": finger, "amplitude_um": amplitude_um} for finger, amplitude_um in targets.items()]
        before = self.machine.clients.refused
        self.send(ttl_s=ttl_s, targets=items)
        assert self.machine.clients.refused == before, self.machine.clients.last_refusal

    def send(self, *, by: str = "", **message: object) -> None:
        """A message of a client, of the user `by`, on the targets socket."""
        self.machine.targets(msgpack.packb({"v": 1, "client": "test", "ttl_s": 5.0, **message}), self.t_ns, by)

    def ask(self, op: str, *, by: str = "", **body: object) -> dict[str, Any]:
        """The reply to a request of the user `by` on the control socket."""
        request = {"v": 1, "id": 3, "op": op, **({"body": body} if body else {})}
        reply = msgpack.unpackb(self.machine.request(msgpack.packb(request), self.t_ns, by))
        assert isinstance(reply, dict)
        return reply

    def published(self) -> list[dict[str, Any]]:
        """A list that gets every state from now on."""
        states: list[dict[str, Any]] = []
        self.machine.status.publish = lambda payload: states.append(msgpack.unpackb(payload))
        return states

    @property
    def state(self) -> State:
        return self.machine.supervisor.state

    def driven(self) -> Bench:
        """Two fingers are down, one slips and one sticks."""
        self.run(400)
        down = len(self.machine.pipeline.fingers)
        self.set_targets(dict([(1, 1.0), (2, 0.0)][:down]))
        self.run(60)
        assert self.state is State.ACTIVE
        assert self.board.state == LIVE
        assert self.board.peak_um > 0.5
        return self


def lines(caplog: pytest.LogCaptureFixture) -> list[str]:
    """What a journal would hold since the last call."""
    said = [record.getMessage() for record in caplog.records if record.levelno >= logging.INFO]
    caplog.clear()
    return said


def references(received: list[Received]) -> list[Received]:
    return [each for each in received if each.name == "reference"]
