"""The daemon before a board that was written from firmware/PROTOCOL.md alone: in order, and with all its faults."""

from __future__ import annotations

import logging
import math
import struct
from collections import deque
from itertools import pairwise
from typing import Any

import machine_bench
import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from outsiders import board as outsider
from outsiders.board import Board

from hapticd.board_values import UNCALIBRATED, BoardCalibration, ModeCalibration
from hapticd.config.sections import Config, DeviceConfig
from hapticd.core.board.link import MOST_UNREAD
from hapticd.core.board.supervisor import State
from hapticd.daemon.machine import TIMER_NS, Machine
from hapticd.sim.fingers.pad_noise import PadNoise
from hapticd.sim.fingers.paths import Line, Path, Rest, Touch
from hapticd.sim.fingers.sensor import SensorModel, SensorSettings

MS = 1_000_000
START_NS = 30_000_000_000
LINK_NS = 2 * MS
SLIPPERY, STICKY = Rest((-30.2, 5.1)), Rest((21.3, -14.9))
STROKE = Line((-40.0, 5.0), (40.0, 5.0), 60.0)


@pytest.fixture(autouse=True)
def _everything_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "hapticd")


class Stand:
    """The daemon's machine and the outsider's board at either end of a line of 2 ms, with fingers on the pad."""

    def __init__(
        self, board: Board, *paths: Path, calibration: BoardCalibration = UNCALIBRATED, port: str = "/dev/ttyACM0"
    ) -> None:
        self.board, self.t_ns = board, START_NS
        self.is_cut = False  # what the host writes is lost
        self.is_stopped = False  # the host, as by SIGSTOP
        self._to_board: deque[tuple[int, bytes]] = deque()
        self._to_host: deque[tuple[int, bytes]] = deque()
        config = Config(device=DeviceConfig(port=port))
        self.machine = Machine(config, machine_bench.PLATE, write_board=self._write, calibration=calibration)
        sensor = SensorModel(SensorSettings(noise=PadNoise(0.0), stamp_jitter_ms=0.0), 1)
        self._reports = iter(sensor.reports([Touch(path, 0.3) for path in paths], 10.0))
        self._report = next(self._reports, None)
        self.machine.trackpad_link(True, "a pad", self.t_ns)
        self.machine.board_link(True, "a board", self.t_ns)

    def _write(self, line: bytes) -> int:
        self._to_board.append((self.t_ns + LINK_NS, line))
        return self.t_ns

    def run(self, milliseconds: int) -> None:
        """Half a millisecond at a time: the board's tick."""
        for step in range(2 * milliseconds):
            self.t_ns += MS // 2
            while self._to_board and self._to_board[0][0] <= self.t_ns:
                _, line = self._to_board.popleft()
                if not self.is_cut:
                    self.board.feed(line)
            self.board.advance((self.t_ns - START_NS) // 1000)
            if self.board.said:
                self._to_host.append((self.t_ns + LINK_NS, bytes(self.board.said)))
                self.board.said.clear()
            if self.is_stopped:
                continue
            if (self.t_ns - START_NS) % TIMER_NS == 0:
                self.machine.timer(self.t_ns)
            while self._to_host and self._to_host[0][0] <= self.t_ns:
                self.machine.board_bytes(self._to_host.popleft()[1], self.t_ns)
            self._touch()
            if step % 200 == 0 and self.machine.pipeline.fingers:
                self.set_targets()

    def _touch(self) -> None:
        while self._report is not None and START_NS + self._report.t_arrive_s * 1e9 <= self.t_ns:
            self.machine.reports([machine_bench.RawReport(self.t_ns, self._report.data)], self.t_ns)
            self._report = next(self._reports, None)

    def set_targets(self) -> None:
        ids = [finger.finger_id for finger in self.machine.pipeline.fingers]
        targets = [{"finger": key, "amplitude_um": float(key == ids[0])} for key in ids]
        payload = msgpack.packb({"v": 1, "client": "test", "ttl_s": 1.0, "targets": targets})
        self.machine.targets(payload, self.t_ns)

    def driven(self) -> Stand:
        self.run(600)
        assert self.machine.supervisor.state is State.ACTIVE
        assert self.peak_um(100) > 0.3
        return self

    def peak_um(self, milliseconds: int) -> float:
        """The plate's largest amplitude in the last ones."""
        return max(um for t_us, um in self.board.peaks_um if t_us > self.board.t_us - 1000 * milliseconds)

    def references(self, milliseconds: int) -> int:
        """How many the board has received in the last ones."""
        from_us = self.board.t_us - 1000 * milliseconds
        return sum(kind == outsider.REFERENCE and t_us > from_us for t_us, kind in self.board.received)

    @property
    def status(self) -> dict[str, Any]:
        return self.machine.report_status(self.t_ns)["board"]


def said(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]


def test_the_outsiders_frames_are_those_of_the_examples() -> None:
    examples = outsider.examples()
    assert len(examples) >= 8
    for line in examples.values():
        message = outsider.unframed(line[:-1])
        assert message is not None
        assert outsider.framed(*message) == line


def test_fingers_are_driven_and_nothing_that_is_sent_is_late_invalid_or_beyond_a_limit(
    caplog: pytest.LogCaptureFixture,
) -> None:
    board = Board()
    stand = Stand(board, STROKE, STICKY).driven()
    stand.run(1500)  # past the wrap of the board's clock
    assert (board.state, board.trips, board.bad_frames) == (outsider.LIVE, 0, 0)
    assert board.worst_late_us <= outsider.TICK_US  # the latency is measured: half of the frames are just late
    assert 0.3 < stand.peak_um(1500) <= 4.0
    assert stand.machine.session.ledger.late_frames == 0
    assert said(caplog) == []


def test_still_fingers_are_kept_alive_within_the_dead_man_time() -> None:
    board = Board()
    stand = Stand(board, SLIPPERY, STICKY).driven()
    stand.run(1000)
    alive = [t_us for t_us, kind in board.received if kind in (outsider.REFERENCE, outsider.KEEPALIVE)]
    assert max(after - before for before, after in pairwise(alive)) <= 25_000
    assert stand.references(500) == 0
    assert board.trips == 0


def test_a_cut_line_quiets_the_plate_within_the_dead_man_time_and_is_driven_again_afterwards() -> None:
    stand = Stand(Board(), STROKE, STICKY).driven()
    stand.is_cut = True
    stand.run(150)
    assert stand.peak_um(50) < 0.01
    assert stand.board.trips == 1
    stand.is_cut = False
    stand.run(100)
    assert stand.board.state == outsider.LIVE
    assert stand.peak_um(20) > 0.3


def test_a_stopped_daemon_blames_no_board_and_drives_again(caplog: pytest.LogCaptureFixture) -> None:
    stand = Stand(Board(), SLIPPERY, STICKY).driven()
    stand.is_stopped = True
    stand.run(4995)
    assert stand.peak_um(1000) < 0.01
    while sum(len(data) for _, data in stand._to_host) > 1024:
        stand._to_host.pop()  # of a terminal whose buffer is full the newest are lost
    stand.is_stopped = False
    stand.run(150)
    assert [line for line in said(caplog) if line.startswith("board")] == []
    assert stand.board.state == outsider.LIVE
    assert stand.peak_um(20) > 0.3


def test_a_reset_board_is_greeted_calibrated_and_driven_again() -> None:
    calibration = BoardCalibration((ModeCalibration(0, 29195.0, 500.0, 5.17, 0.1),))
    stand = Stand(Board(), STROKE, STICKY, calibration=calibration).driven()
    stand.board.reset(boot_id=9)
    stand.run(900)
    kinds = [kind for _, kind in stand.board.received]
    assert kinds.count(outsider.SET_CONTROLLER) == kinds.count(outsider.SET_MODEL) == 2
    assert stand.status["reboots"] == 1
    assert stand.board.state == outsider.LIVE
    assert stand.peak_um(50) > 0.3


MOST_WITHOUT_STATUS = 15  # references, one for each report of the pad in 165 ms (hapticd/daemon/README.md)


def only(*silent: int) -> Any:
    """A censor that keeps back some messages."""
    return lambda kind, payload: None if kind in silent else payload


def with_status_of_nan(kind: int, payload: bytes) -> bytes | None:
    return payload[:28] + struct.pack("<8f", *[math.nan] * 8) if kind == outsider.STATUS else payload


@pytest.mark.parametrize("censor", [only(outsider.STATUS), with_status_of_nan])
def test_a_board_that_answers_the_time_but_sends_no_status_is_not_driven(
    censor: Any, caplog: pytest.LogCaptureFixture
) -> None:
    stand = Stand(Board(), STROKE, STICKY).driven()
    stand.board.censor = censor
    before = len(stand.board.received)
    stand.run(170)
    sent = [kind for _, kind in stand.board.received[before:]].count(outsider.REFERENCE)
    assert 10 < sent <= MOST_WITHOUT_STATUS
    before = len(stand.board.received)
    stand.run(3830)
    later = [kind for _, kind in stand.board.received[before:]]
    assert later.count(outsider.REFERENCE) <= 2
    assert later.count(outsider.KEEPALIVE) == 0
    assert later.count(outsider.TIME_REQUEST) <= 60
    assert stand.peak_um(3700) < 0.01
    (sentence,) = said(caplog)
    assert "sends no status" in sentence
    assert stand.status["lacking"] == sentence.removeprefix("board: ")
    assert stand.machine.supervisor.state is State.IDLE
    caplog.clear()
    stand.board.censor = lambda _, payload: payload
    stand.run(200)
    assert stand.peak_um(20) > 0.3
    assert "lacking" not in stand.status


def test_a_board_that_answers_nothing_is_sent_two_references() -> None:
    stand = Stand(Board(), STROKE, STICKY).driven()
    before = len(stand.board.received)
    stand.board.censor = lambda *_: None
    stand.run(900)
    kinds = [kind for _, kind in stand.board.received[before:]]
    assert kinds.count(outsider.REFERENCE) == MOST_UNREAD
    assert kinds.count(outsider.TIME_REQUEST) >= 10
    assert stand.peak_um(800) < 0.01


def hello_with(**fields: object) -> Any:
    """A censor that changes fields of HELLO."""
    names = ["version", "hash", "modes", "name", "boot_id", "control_hz", "drive_hz", "deadman_ms", "v_limit_v"]

    def censor(kind: int, payload: bytes) -> bytes:
        if kind != outsider.HELLO:
            return payload
        head = dict(zip(names, struct.unpack_from("<HIB16sIffHf", payload), strict=True)) | fields
        limits = head.pop("limits", (4.0, 4.0))
        return struct.pack("<HIB16sIffHf", *head.values()) + struct.pack(f"<{len(limits)}f", *limits)

    return censor


def refusing(kind: int, payload: bytes) -> bytes:
    return bytes((payload[0], outsider.OUT_OF_RANGE)) if kind == outsider.VERDICT else payload


@pytest.mark.parametrize(
    ("censor", "named"),
    [
        (only(*range(0x80, 0x90)), "no HELLO"),
        (hello_with(limits=(math.nan, math.nan)), "no valid HELLO"),
        (hello_with(limits=(math.inf, 4.0)), "no valid HELLO"),
        (hello_with(modes=0), "no valid HELLO"),
        (hello_with(modes=255), "no valid HELLO"),
        (hello_with(modes=255, limits=(4.0,) * 255), "no HELLO"),
        (hello_with(modes=3, limits=(4.0,) * 3), "drives 3 modes, the mode map has 2"),
        (hello_with(control_hz=0.0), "control_hz is 0, not within 500..50000"),
        (only(outsider.VERDICT), "no VERDICT on its controller and models"),
        (only(outsider.TIME), "no TIME that continues its clock"),
        (refusing, "refuses the control law or its gains: a value is out of range"),
    ],
)
def test_a_handshake_that_cannot_end_is_one_sentence_within_two_seconds_and_in_the_status(
    censor: Any, named: str, caplog: pytest.LogCaptureFixture
) -> None:
    board = Board()
    board.censor = censor
    stand = Stand(board, SLIPPERY, STICKY)
    stand.run(2000)
    (sentence,) = said(caplog)
    assert named in sentence
    reported = stand.status.get("refused") or stand.status["lacking"]
    assert sentence.endswith(reported)
    stand.run(2000)
    assert said(caplog) == [sentence]
    assert stand.references(4000) == 0
    assert board.state == outsider.QUIET


def test_a_refused_setting_is_repeated_until_the_board_takes_it(caplog: pytest.LogCaptureFixture) -> None:
    board = Board()
    board.censor = lambda kind, p: bytes((p[0], outsider.BUSY)) if kind == outsider.VERDICT else p
    stand = Stand(board, STROKE, STICKY)
    stand.run(1000)
    assert stand.references(1000) == 0
    assert "refuses the control law or its gains: it is busy" in "".join(said(caplog))
    board.censor = lambda _, payload: payload
    stand.run(400)
    assert stand.peak_um(100) > 0.3
    assert "refused" not in stand.status


def test_a_clock_that_runs_backwards_is_said_and_the_board_is_not_driven(caplog: pytest.LogCaptureFixture) -> None:
    stand = Stand(Board(), STROKE, STICKY).driven()
    stand.board.runs_backwards = True
    stand.run(4000)
    first, *others = dict.fromkeys(said(caplog))
    assert "Clock discontinuity" in first
    assert "no TIME that continues its clock" in "".join(others)
    assert stand.peak_um(2000) < 0.01


WHIMS: dict[str, Any] = {
    "in order": lambda _, payload: payload,
    "mute": only(*range(0x80, 0x90)),
    "no HELLO": only(outsider.HELLO),
    "no TIME": only(outsider.TIME),
    "no STATUS": only(outsider.STATUS),
    "no VERDICT": only(outsider.VERDICT),
    "STATUS of NaN": with_status_of_nan,
    "HELLO of NaN": hello_with(limits=(math.nan, math.nan)),
    "HELLO of no modes": hello_with(modes=0),
    "HELLO without a dead-man": hello_with(deadman_ms=0),
    "refusing": refusing,
}


@pytest.mark.long
@settings(max_examples=40)
@given(st.lists(st.tuples(st.sampled_from([*WHIMS, "reset", "backwards"]), st.integers(1, 15)), max_size=5))
def test_a_board_of_any_whims_is_driven_only_while_it_reports_and_again_once_it_is_in_order(
    whims: list[tuple[str, int]],
) -> None:
    stand, reported_us = Stand(Board(), SLIPPERY, STICKY), [0]
    board = stand.board

    def witnessed(kind: int, payload: bytes) -> bytes | None:
        let_pass = censor(kind, payload)
        if kind == outsider.STATUS and let_pass == payload:
            reported_us.append(board.t_us)
        return let_pass

    board.censor = witnessed
    for boot_id, (whim, tenths) in enumerate([*whims, ("reset", 1), ("in order", 20)]):
        censor = WHIMS.get(whim, WHIMS["in order"])
        if whim == "reset":
            board.reset(boot_id=boot_id)
        board.runs_backwards = whim == "backwards"
        stand.run(100 * tenths)
    for t_us, kind in board.received:
        if kind == outsider.REFERENCE:
            assert t_us - max(told_us for told_us in reported_us if told_us <= t_us) <= 180_000
    assert max(um for _, um in board.peaks_um) <= 4.0
    assert board.state == outsider.LIVE
    assert stand.peak_um(20) > 0.3
    assert stand.status.keys().isdisjoint({"refused", "lacking"})
