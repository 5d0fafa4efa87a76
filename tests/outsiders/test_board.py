"""The daemon before a board that was written from firmware/PROTOCOL.md alone: in order, and with all its faults."""

from __future__ import annotations

import logging
import math
import struct
from typing import Any

import machine_bench
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from machine_bench import MS, SLIPPERY, STICKY
from outsiders import board as outsider
from outsiders.board import Board

from hapticd.board_values import UNCALIBRATED, BoardCalibration, ModeCalibration
from hapticd.config.sections import Config, DeviceConfig
from hapticd.core.board.supervisor import State
from hapticd.sim.fingers.paths import Line, Path

STROKE = Line((-40.0, 5.0), (40.0, 5.0), 60.0)


@pytest.fixture(autouse=True)
def _everything_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "hapticd")


class Port:
    """The outsider's board in place of `machine_bench.FakeBoard`."""

    plugged, received = True, ()

    def __init__(self, bench: Stand, _protocol_hash: int) -> None:
        self.bench = bench

    def write(self, line: bytes) -> int:
        self.bench.outsider.feed(line)
        return self.bench.t_ns

    def status(self) -> None:
        """It sends its own."""


class Stand(machine_bench.Bench):
    """The daemon's machine and the outsider's board, with fingers on the pad."""

    new_board = Port

    def __init__(self, *paths: Path, calibration: BoardCalibration = UNCALIBRATED, censor: Any = None) -> None:
        self.outsider = Board()
        self.outsider.censor = censor or self.outsider.censor
        super().__init__(*paths, calibration=calibration, config=Config(device=DeviceConfig(port="/dev/ttyACM0")))

    def _step(self) -> None:
        board = self.outsider
        board.advance((self.t_ns - machine_bench.START_NS) // 1000)
        self.from_board += [bytes(board.said)] if board.said else []
        board.said.clear()
        super()._step()
        if self.t_ns // MS % 100 == 0 and (fingers := self.machine.pipeline.fingers):
            self.set_targets({one.finger_id: float(one is fingers[0]) for one in fingers}, ttl_s=1.0)

    def driven(self) -> Stand:
        self.run(600)
        assert self.state is State.ACTIVE
        assert self.peak_um(100) > 0.3
        return self

    def peak_um(self, milliseconds: int) -> float:
        """The plate's largest amplitude in the last ones."""
        return max(um for t_us, um in self.outsider.peaks_um if t_us > self.outsider.t_us - 1000 * milliseconds)

    def references(self, milliseconds: int) -> int:
        """How many the board has received in the last ones."""
        from_us = self.outsider.t_us - 1000 * milliseconds
        return sum(kind == outsider.REFERENCE and t_us > from_us for t_us, kind in self.outsider.received)

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


def test_fingers_are_driven_and_nothing_sent_is_late_invalid_or_beyond_a_limit(
    caplog: pytest.LogCaptureFixture,
) -> None:
    stand = Stand(STROKE, STICKY).driven()
    board = stand.outsider
    stand.run(1500)  # past the wrap of the board's clock
    assert (board.state, board.trips, board.bad_frames) == (outsider.LIVE, 0, 0)
    assert board.worst_late_us <= outsider.TICK_US  # the latency is measured: half of the frames are just late
    assert 0.3 < stand.peak_um(1500) <= 4.0
    assert stand.machine.session.ledger.late_frames == 0
    assert said(caplog) == []


def test_a_reset_board_is_greeted_calibrated_and_driven_again() -> None:
    calibration = BoardCalibration((ModeCalibration(0, 29195.0, 500.0, 5.17, 0.1),))
    stand = Stand(STROKE, STICKY, calibration=calibration).driven()
    stand.outsider.reset(boot_id=9)
    stand.run(900)
    kinds = [kind for _, kind in stand.outsider.received]
    assert kinds.count(outsider.SET_CONTROLLER) == kinds.count(outsider.SET_MODEL) == 2
    assert stand.status["reboots"] == 1
    assert stand.outsider.state == outsider.LIVE
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
    stand = Stand(STROKE, STICKY).driven()
    stand.outsider.censor = censor
    before = len(stand.outsider.received)
    stand.run(170)
    sent = [kind for _, kind in stand.outsider.received[before:]].count(outsider.REFERENCE)
    assert 10 < sent <= MOST_WITHOUT_STATUS
    before = len(stand.outsider.received)
    stand.run(3830)
    later = [kind for _, kind in stand.outsider.received[before:]]
    assert later.count(outsider.REFERENCE) <= 2
    assert later.count(outsider.KEEPALIVE) == 0
    assert later.count(outsider.TIME_REQUEST) <= 60
    assert stand.peak_um(3700) < 0.01
    (sentence,) = said(caplog)
    assert "sends no status" in sentence
    assert stand.status["lacking"] == sentence.removeprefix("board: ")
    assert stand.state is State.IDLE
    caplog.clear()
    stand.outsider.censor = lambda _, payload: payload
    stand.run(200)
    assert stand.peak_um(20) > 0.3
    assert "lacking" not in stand.status


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


def refusing(result: int) -> Any:
    """A censor of verdicts."""
    return lambda kind, payload: bytes((payload[0], result)) if kind == outsider.VERDICT else payload


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
        (refusing(outsider.OUT_OF_RANGE), "refuses the control law or its gains: a value is out of range"),
    ],
)
def test_a_handshake_that_cannot_end_is_one_sentence_within_2_s_and_in_the_status(
    censor: Any, named: str, caplog: pytest.LogCaptureFixture
) -> None:
    stand = Stand(SLIPPERY, STICKY, censor=censor)
    stand.run(2000)
    (sentence,) = said(caplog)
    assert named in sentence
    reported = stand.status.get("refused") or stand.status["lacking"]
    assert sentence.endswith(reported)
    stand.run(500)
    assert said(caplog) == [sentence]
    assert stand.references(2500) == 0
    assert stand.outsider.state == outsider.QUIET


def test_a_refused_setting_is_repeated_until_the_board_takes_it(caplog: pytest.LogCaptureFixture) -> None:
    stand = Stand(STROKE, STICKY, censor=refusing(outsider.BUSY))
    stand.run(1000)
    assert stand.references(1000) == 0
    assert "refuses the control law or its gains: it is busy" in "".join(said(caplog))
    stand.outsider.censor = lambda _, payload: payload
    stand.run(400)
    assert stand.peak_um(100) > 0.3
    assert "refused" not in stand.status


def test_a_clock_that_runs_backwards_is_said_and_the_board_is_not_driven(caplog: pytest.LogCaptureFixture) -> None:
    stand = Stand(STROKE, STICKY).driven()
    stand.outsider.runs_backwards = True
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
    "refusing": refusing(outsider.OUT_OF_RANGE),
}


@pytest.mark.long
@settings(max_examples=40)
@given(st.lists(st.tuples(st.sampled_from([*WHIMS, "reset", "backwards"]), st.integers(1, 15)), max_size=5))
def test_a_board_of_any_behaviour_is_driven_only_while_it_reports(
    whims: list[tuple[str, int]],
) -> None:
    stand, reported_us = Stand(SLIPPERY, STICKY), [0]
    board = stand.outsider

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
