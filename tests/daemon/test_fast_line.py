"""The line's speed, the drive and the sync output, between the daemon's core and the firmware's C in virtual time."""

from __future__ import annotations

import logging

import msgpack
import numpy as np
import pytest
from machine_bench import MS, PLATE

from hapticd.board_protocol import BoardState
from hapticd.board_values import UNCALIBRATED, BoardCalibration, BoardStatus, ModeCalibration
from hapticd.config import Config
from hapticd.daemon.machine import Machine
from hapticd.sim.board.board import FLAG_SYNC, Board, BoardConfig, BoardTrace, PlateModel

FIRST, FAST = 921600, 3_000_000
STEP_NS, TIMER_STEPS = 2 * MS, 5
X, Y = (ModeCalibration(mode, 29195.0 + 20.0 * mode, 500.0, 5.3, 0.0) for mode in (0, 1))


class Rig:
    """A machine and a board on a line that carries nothing but noise while their speeds differ."""

    def __init__(self, *, calibration: BoardCalibration = UNCALIBRATED, **board: object) -> None:
        config = BoardConfig(**board)  # type: ignore[arg-type]
        gain, decay = np.diag(config.gain_um_per_v_s), np.array(config.decay_1_s)
        plate = PlateModel(decay, np.array(config.detuning_rad_s), gain, np.eye(2), 0.0, 150.0)
        self.board = Board(plate, config=config, boot_id=7)
        self.t_ns, self.steps, self._said = 1000 * MS, 0, b""
        self.port_baud = self.board_baud = FIRST
        self.fails_at = 0  # a speed that the cable does not carry
        self.flags: list[int] = []
        self.statuses: list[BoardStatus] = []
        writers = {"write_board": self._write, "set_baud": self._set_baud}
        self.machine = Machine(Config(), PLATE, calibration=calibration, **writers)
        self.machine.observer = self._observe
        self.machine.board_link(True, "open", self.t_ns)
        self.machine.trackpad_link(True, "open", self.t_ns)

    def _observe(self, kind: str, t_ns: int, *values: object) -> None:
        del t_ns
        self.statuses += [value for value in values if kind == "status" and isinstance(value, BoardStatus)]

    def _carries(self, data: bytes) -> bytes:
        same = self.port_baud == self.board_baud != self.fails_at
        return data if same else b"\xaa" * len(data) + b"\0"

    def _write(self, line: bytes) -> int:
        self.board.receive(self._carries(line))
        self._answer()
        return self.t_ns

    def _answer(self) -> None:
        self._said += self._carries(self.board.transmit())
        self.board_baud = self.board.baud or FIRST  # the answer has left at the speed of before

    def _set_baud(self, baud: int) -> None:
        self.port_baud = baud

    def run(self, ms: float) -> Rig:
        for _ in range(round(ms * MS / STEP_NS)):
            trace = BoardTrace(4, 2, 2)
            self.board.run(4, np.zeros((4, 0, 2)), np.zeros((4, 0)), trace)
            self.flags += trace.flags.tolist()
            self.t_ns += STEP_NS
            self.steps += 1
            self._answer()
            said, self._said = self._said, b""
            if said:
                self.machine.board_bytes(said, self.t_ns)
            if self.steps % TIMER_STEPS == 0:
                self.machine.timer(self.t_ns)
        return self

    @property
    def follows(self) -> bool:
        status = self.machine.session.status
        return self.machine.session.ready and status is not None and status.state is BoardState.LIVE

    def mark(self, **fields: object) -> dict[str, object]:
        request = {"v": 1, "id": 1, "op": "marker", "body": {"client": "eeg", "text": "onset", **fields}}
        answer: dict[str, object] = msgpack.unpackb(self.machine.request(msgpack.packb(request), self.t_ns, "1"))
        return answer

    def board_report(self) -> dict[str, object]:
        report = self.machine.report_status(self.t_ns)["board"]
        assert isinstance(report, dict)
        return report


def test_a_board_that_offers_a_faster_line_is_driven_at_it() -> None:
    rig = Rig(baud_max=FAST).run(600)
    assert (rig.port_baud, rig.board_baud) == (FAST, FAST)
    assert rig.follows
    assert rig.board_report()["baud"] == FAST


def test_a_cable_that_does_not_carry_the_fast_line_ends_at_the_first_speed(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    rig = Rig(baud_max=FAST)
    rig.fails_at = FAST
    rig.run(3000)
    assert (rig.port_baud, rig.board_baud) == (FIRST, FIRST)
    assert rig.follows
    assert not np.any(np.array(rig.flags[: 2 * 1000]) & FLAG_SYNC)
    assert "the fast line fails" in caplog.text
    assert rig.run(5000).port_baud == FIRST, "it is not tried again"


def test_a_fast_line_that_breaks_silences_the_plate_and_restarts_at_first_speed() -> None:
    rig = Rig(baud_max=FAST).run(600)
    rig.fails_at = FAST
    rig.run(200)
    assert rig.board.baud == FAST
    rig.run(3500)
    assert (rig.port_baud, rig.board_baud) == (FIRST, FIRST)
    assert rig.follows


def test_a_calibrated_drive_is_set_with_the_models_in_its_frame() -> None:
    rig = Rig(calibration=BoardCalibration((X, Y), 29215.0)).run(400)
    assert rig.follows
    report = rig.board_report()
    assert (report["drive_hz"], report["drive_moved_hz"]) == (pytest.approx(29215.0), pytest.approx(0.0, abs=0.01))
    assert rig.board.estimate()[:, 1] == pytest.approx(2 * np.pi * np.array([-20.0, 0.0]), abs=0.01)
    assert rig.machine.describe_plate().drive_hz == 29215.0
    again = rig.machine.session
    assert again.hello is not None
    assert again.hello.drive_hz == pytest.approx(29205.0)


def test_a_marker_with_a_pulse_raises_the_sync_output_with_the_next_reference() -> None:
    rig = Rig().run(400)
    before = len(rig.flags)
    assert rig.mark(pulse=True)["ok"]
    rig.run(60)
    high = np.array(rig.flags[before:]) & FLAG_SYNC
    assert np.count_nonzero(high) == 10  # 5 ms
    assert [status.seq for status in rig.statuses if status.pulsed] == [
        status.seq for status in rig.statuses if status.pulsed and status.applied
    ]
    assert sum(status.pulsed for status in rig.statuses) == 1


def test_a_resting_board_is_woken_for_a_pulse() -> None:
    rig = Rig().run(4000)
    assert rig.machine.session.is_on_standby
    before = len(rig.flags)
    assert rig.mark(pulse=True)["ok"]
    assert np.any(np.array(rig.run(60).flags[before:]) & FLAG_SYNC)


@pytest.mark.parametrize(
    ("has_sync", "runs_ms", "sentence"), [(False, 400, "has no sync output"), (True, 0, "does not answer")]
)
def test_a_pulse_that_cannot_be_is_refused(has_sync: bool, runs_ms: float, sentence: str) -> None:
    answer = Rig(has_sync=has_sync).run(runs_ms).mark(pulse=True)
    assert not answer["ok"]
    assert sentence in str(answer)
