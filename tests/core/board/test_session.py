"""The conversation with the board, in values and virtual time: who is greeted, what is sent when, what is booked."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import pytest

from hapticd.board_protocol import BoardState, BoardTime, HelloRequest, Keepalive, TimeRequest
from hapticd.board_values import (
    BoardCalibration,
    BoardCommand,
    BoardHello,
    BoardStatus,
    ModeCalibration,
    ReferenceFrame,
    SetController,
)
from hapticd.core.board.session import SILENT_AFTER_NS, BoardSession
from hapticd.core.trajectory.gate import silence
from hapticd.values import Tick, TouchPoint

MS = 1_000_000
START_NS = 50_000_000_000
BOARD_OFFSET_US = 7_000_000  # the board's clock shows this at START_NS
LINK_NS = 4 * MS

HELLO = BoardHello(
    protocol_version=1,
    protocol_hash=1,
    firmware_version="1.2",
    boot_id=5,
    modes=2,
    control_hz=2000.0,
    drive_hz=29205.0,
    deadman_ms=50,
    w_limit_um=(4.0, 4.0),
    v_limit_v=150.0,
)
STATUS = BoardStatus(
    t_board_us=0,
    state=BoardState.LIVE,
    seq=0,
    t_received_us=0,
    t_applied_us=0,
    applied=False,
    saturated=False,
    limited=False,
    fault_code=0,
    deadman_trips=0,
    bad_frames=0,
    late_frames=0,
    measured_um=(0j, 0j),
    voltage_v=(0j, 0j),
)


POINT = TouchPoint(1, 0.0, 0.0, target_um=1.0, achieved_um=1.0, end_x_mm=0.0, end_y_mm=0.0)


def board_us(t_ns: int) -> int:
    return BOARD_OFFSET_US + (t_ns - START_NS) // 1000


class Bench:
    """A session and the instant it is at."""

    def __init__(self) -> None:
        self.session = BoardSession(link_start_ns=5 * MS, controller="pi")
        self.t_ns = START_NS

    def time_answer(self, request: TimeRequest) -> None:
        """The board answers a time request over a link of LINK_NS each way."""
        self.t_ns += 2 * LINK_NS
        t_us = board_us(self.t_ns - LINK_NS)
        self.session.receive_time(BoardTime(request.t_host_ns, t_us, t_us), self.t_ns)

    def say(self, state: BoardState = BoardState.LIVE, **fields: object) -> None:
        self.session.receive_status(STATUS._replace(state=state, **fields), self.t_ns)

    def met(self, hello: BoardHello = HELLO) -> Bench:
        """Link, greeting, clock, first status."""
        assert self.session.link_up(self.t_ns) == [HelloRequest()]
        self.know(self.session.receive_hello(hello, self.t_ns))
        self.say()
        return self

    def know(self, commands: list[BoardCommand]) -> None:
        """The board answers what it received and sends its status, and its clock is asked until it is known."""
        assert self.session.receive_answer(self.t_ns) == []
        self.say()
        while not self.session.ready:
            for command in commands:
                if isinstance(command, TimeRequest):
                    self.time_answer(command)
            self.t_ns += 10 * MS
            commands = self.session.timer(self.t_ns)

    def send(self) -> list[BoardCommand]:
        drive = silence(self.t_ns + 5 * MS, 2)
        return self.session.reference(drive, Tick(self.t_ns, 11 * MS, 16 * MS, drive, (POINT,), False), self.t_ns)

    def run(self, span_ns: int, every_ns: int = 10 * MS) -> list[tuple[int, BoardCommand]]:
        said = []
        for _ in range(span_ns // every_ns):
            self.t_ns += every_ns
            said += [(self.t_ns, command) for command in self.session.timer(self.t_ns)]
        return said


@pytest.fixture
def bench() -> Bench:
    """A session that knows its board and its clock."""
    return Bench().met()


def test_a_board_that_does_not_answer_is_greeted_four_times_a_second() -> None:
    bench = Bench()
    assert bench.session.link_up(bench.t_ns) == [HelloRequest()]
    said = bench.run(1000 * MS)
    assert [command for _, command in said] == [HelloRequest()] * 4
    bench.say(BoardState.FAULT, fault_code=3)
    assert bench.session.status is None  # before its hello
    assert not bench.session.ready


def test_an_accepted_board_gets_its_controller_and_time_requests_until_it_syncs() -> None:
    bench = Bench()
    bench.session.link_up(bench.t_ns)
    said = bench.session.receive_hello(HELLO, bench.t_ns)
    assert said == [SetController("pi"), TimeRequest(bench.t_ns)]
    assert not bench.session.ready
    assert bench.send() == []
    bench.know(said)
    assert bench.session.ready
    (frame,) = bench.send()
    assert frame.t_apply_us == pytest.approx(board_us(bench.t_ns + 5 * MS), abs=2)


def calibrated() -> BoardSession:
    modes = tuple(ModeCalibration(k, 29195.0 + 20 * k, 500.0, 5.0, math.pi / 2) for k in range(2))
    session = BoardSession(link_start_ns=5 * MS, controller="pi", calibration=BoardCalibration(modes))
    session.link_up(START_NS)
    return session


def test_an_accepted_board_gets_the_measured_modes_one_after_the_other() -> None:
    session = calibrated()
    assert session.receive_hello(HELLO, START_NS) == [SetController("pi"), TimeRequest(START_NS)]
    for k in range(2):
        (command,) = session.receive_answer(START_NS)
        assert command.mode == k
        assert command.model.detuning_rad_s == pytest.approx(2 * math.pi * (20 * k - 10))
        assert command.model.decay_1_s == pytest.approx(math.pi * (29195 + 20 * k) / 500)
        assert command.model.loop == pytest.approx(1j)
    assert session.receive_answer(START_NS) == []
    assert session.receive_answer(START_NS) == []  # to something that another host had said


def test_an_instruction_that_the_line_lost_is_repeated_until_the_board_answers() -> None:
    session = calibrated()
    session.receive_hello(HELLO, START_NS)
    session.receive_answer(START_NS)

    def said(ms: range) -> list[BoardCommand]:
        commands = [command for t_ms in ms for command in session.timer(START_NS + t_ms * MS)]
        return [command for command in commands if not isinstance(command, TimeRequest)]

    first, second = said(range(0, 220, 10))
    assert first.mode == 0
    assert second == first
    (third,) = session.receive_answer(START_NS + 220 * MS)
    assert third.mode == 1
    assert session.receive_answer(START_NS + 230 * MS) == []
    assert said(range(230, 500, 10)) == []


def test_a_board_that_is_a_persons_tool_is_neither_armed_nor_kept_alive(bench: Bench) -> None:
    said = []
    for _ in range(10):
        bench.say(BoardState.TOOL)
        said += [command for _, command in bench.run(50 * MS)]
    assert {type(command) for command in said} == {TimeRequest}
    assert not bench.session.follows(bench.t_ns)
    bench.say(BoardState.QUIET)
    assert any(isinstance(command, ReferenceFrame) for _, command in bench.run(60 * MS))


def test_bytes_of_the_board_may_wait_for_a_pass_while_no_answer_is_due(bench: Bench) -> None:
    session = bench.session
    assert session.can_wait
    asked: list[TimeRequest] = []
    while not asked:
        bench.say()
        asked = [command for _, command in bench.run(10 * MS) if isinstance(command, TimeRequest)]
        assert session.can_wait is (asked == [])
    bench.time_answer(asked[0])
    assert session.can_wait
    for state in (BoardState.QUIET, BoardState.TOOL, BoardState.FAULT):
        bench.say(state)
        assert not session.can_wait
    bench.say()
    assert session.can_wait
    session.standby(bench.t_ns)
    assert not session.can_wait
    session.receive_hello(HELLO, bench.t_ns)
    assert session.is_on_standby
    assert session.can_wait
    session.link_down()
    assert not session.can_wait


@pytest.mark.parametrize("phase_ms", range(10))
def test_while_a_reference_stands_the_board_gets_a_frame_every_20_ms(phase_ms: int) -> None:
    bench = Bench().met()
    bench.t_ns += phase_ms * MS
    bench.send()
    t_sent_ns = bench.t_ns
    bench.t_ns -= phase_ms * MS
    said = []
    for _ in range(40):
        bench.say()
        said += bench.run(10 * MS)
    lives = [t_sent_ns, *(t_ns for t_ns, command in said if isinstance(command, Keepalive))]
    gaps_ns = [after - before for before, after in pairwise(lives)]
    assert max(gaps_ns[1:]) == 20 * MS
    assert gaps_ns[0] <= 22.5 * MS
    assert min(gaps_ns) >= 12.5 * MS  # no oftener than it must


def test_a_quiet_board_is_sent_zero_frames_until_it_trusts_its_host(bench: Bench) -> None:
    bench.say(BoardState.QUIET)
    frames: list[ReferenceFrame] = []
    for _ in range(6):
        frames += [command for _, command in bench.run(10 * MS) if isinstance(command, ReferenceFrame)]
        bench.say(BoardState.QUIET, seq=len(frames))
    assert len(frames) == 3
    assert [frame.seq for frame in frames] == [1, 2, 3]
    assert not any(any(knot.modal_um) for frame in frames for knot in frame.drive.knots)
    bench.say(BoardState.LIVE)
    assert not any(isinstance(command, ReferenceFrame) for _, command in bench.run(60 * MS))


def test_zero_frames_never_come_between_references(bench: Bench) -> None:
    for _ in range(20):
        bench.say(BoardState.QUIET)
        bench.send()
        assert not any(isinstance(command, ReferenceFrame) for _, command in bench.run(11 * MS, 1 * MS))


def test_a_silent_board_is_forgotten_and_greeted_until_it_answers(bench: Bench) -> None:
    bench.run(SILENT_AFTER_NS)
    assert bench.session.ready
    said = [command for _, command in bench.run(1000 * MS)]
    assert set(said) == {HelloRequest()}
    assert not bench.session.ready
    assert bench.session.status is None
    bench.know(bench.session.receive_hello(HELLO, bench.t_ns))
    assert bench.session.ready  # the same boot: its clock is still the same
    assert bench.session.reboots == 0


@pytest.mark.parametrize("silent", [False, True])
def test_a_board_that_rebooted_has_another_clock_however_that_was_noticed(silent: bool, bench: Bench) -> None:
    if silent:
        bench.run(SILENT_AFTER_NS + 100 * MS)
    said = bench.session.receive_hello(replace(HELLO, boot_id=6), bench.t_ns)
    assert bench.session.reboots == 1
    assert not bench.session.ready
    assert bench.send() == []
    bench.know(said)
    assert bench.session.ready


@pytest.mark.parametrize("before_us", [3_000_000, 2**31, 2**32 - 3_000_000])
def test_a_status_of_another_clock_means_a_reset_behind_an_open_port(before_us: int, bench: Bench) -> None:
    bench.session.status = None  # whose clock this bench does not care for
    said = STATUS._replace(t_board_us=before_us)
    later = said._replace(t_board_us=(before_us + 1_900_000) % 2**32)  # to a host that stalled
    for status in (said, later, said):  # and one that was overtaken
        bench.session.receive_status(status, bench.t_ns)
    assert bench.session.ready
    bench.session.receive_status(said._replace(t_board_us=40_000), bench.t_ns)
    assert (bench.session.hello, bench.session.status, bench.session.ready) == (None, None, False)
    assert bench.session.timer(bench.t_ns + 250 * MS) == [HelloRequest()]


def test_a_time_of_another_clock_means_the_same(bench: Bench) -> None:
    asked = [command for _, command in bench.run(600 * MS) if isinstance(command, TimeRequest)][-1]
    t_board_us = board_us(bench.t_ns) - 400_000  # too small a leap for a status to tell
    bench.session.receive_time(BoardTime(asked.t_host_ns, t_board_us, t_board_us), bench.t_ns)
    assert not bench.session.ready
    assert bench.session.timer(bench.t_ns + 250 * MS) == [HelloRequest()]


def test_a_pulled_plug_resets_the_session_and_the_next_board_is_no_reboot(bench: Bench) -> None:
    bench.session.link_down()
    assert (bench.session.hello, bench.session.status, bench.session.ready) == (None, None, False)
    assert bench.run(500 * MS) == []
    bench.met(replace(HELLO, boot_id=9))
    assert bench.session.ready
    assert bench.session.reboots == 0


def test_a_reference_that_stands_is_sent_again_before_the_board_calls_it_too_old(bench: Bench) -> None:
    (frame,) = bench.send()
    bench.say(BoardState.LIVE, seq=frame.seq)
    assert bench.session.holds(bench.t_ns + 2_900 * MS)
    assert not bench.session.holds(bench.t_ns + 3_100 * MS)
    assert bench.session.follows(bench.t_ns + 3_100 * MS)


def test_only_a_live_board_follows() -> None:
    bench = Bench()
    assert not bench.session.follows(bench.t_ns)
    bench.met()
    for state in BoardState:
        bench.say(state)
        assert bench.session.follows(bench.t_ns) is (state is BoardState.LIVE)
    bench.say(BoardState.LIVE)
    bench.session.receive_hello(HELLO, bench.t_ns)
    assert not bench.session.follows(bench.t_ns)  # a greeting makes it forget


def test_a_board_that_does_not_name_the_last_frame_in_time_does_not_follow(bench: Bench) -> None:
    bench.say(BoardState.LIVE)
    (frame,) = bench.send()
    assert bench.session.follows(bench.t_ns + 19 * MS)
    assert not bench.session.follows(bench.t_ns + 21 * MS)
    bench.say(BoardState.LIVE, seq=frame.seq)
    assert bench.session.follows(bench.t_ns + 1000 * MS)


def test_an_applied_frame_is_booked_once_with_its_delays(bench: Bench) -> None:
    for _ in range(10):
        (frame,) = bench.send()
        t_sent_ns = bench.t_ns
        bench.t_ns += 20 * MS
        applied = {
            "seq": frame.seq,
            "t_received_us": board_us(t_sent_ns + 3 * MS),
            "t_applied_us": board_us(t_sent_ns + 7 * MS),
        }
        bench.say(**applied)  # accepted, its first knot still to come
        bench.say(**applied, applied=True)
        bench.say(**applied, applied=True)
    assert len(bench.session.ledger.lines) == 10
    line = bench.session.ledger.lines[-1]
    assert (line.age_ns, line.horizon_ns) == (11 * MS, 16 * MS)
    assert line.link_ns == pytest.approx(3 * MS, abs=5000)
    assert line.late_ns == pytest.approx(2 * MS, abs=5000)
    assert bench.session.latency.link_ns == pytest.approx(3 * MS, abs=5000)


def test_frames_that_are_never_acknowledged_are_forgotten_after_a_second(bench: Bench) -> None:
    for _ in range(300):
        bench.t_ns += 11 * MS
        bench.say()
        bench.send()
    assert len(bench.session.window._flights) <= SILENT_AFTER_NS // (11 * MS) + 2


def kinds(commands: list[BoardCommand]) -> list[type]:
    return [type(command) for command in commands]


def test_before_a_board_that_stopped_reading_lie_two_references_at_most(bench: Bench) -> None:
    said = []
    for _ in range(80):  # nine tenths of a second: then the board is silent, and gets a new handshake
        bench.t_ns += 11 * MS
        said += bench.send() + bench.session.timer(bench.t_ns)
    assert kinds(said).count(ReferenceFrame) == 2
    assert kinds(said).count(Keepalive) <= 1
    assert kinds(said).count(TimeRequest) <= 24
    assert bench.session.held_back >= 78


def unanswered(references: int) -> tuple[Bench, list[BoardCommand]]:
    bench, said = Bench().met(), list[BoardCommand]()
    for _ in range(references):
        bench.t_ns += 11 * MS
        said = bench.send()
    return bench, said


def test_of_references_held_back_the_newest_goes_out_once_the_board_read_one() -> None:
    bench, said = unanswered(4)
    assert kinds(said) == [TimeRequest]
    assert bench.session.resume(bench.t_ns) == []  # it has not spoken
    bench.say(seq=1)
    newest = bench.session.resume(bench.t_ns)[0]
    assert newest.seq == 3
    assert newest.drive.t_apply_ns == bench.t_ns + 5 * MS
    assert bench.session.resume(bench.t_ns) == []


def test_a_time_reply_separates_lost_references_from_waiting_ones() -> None:
    bench, (question,) = unanswered(3)
    bench.time_answer(question)
    assert kinds(bench.session.resume(bench.t_ns)) == [ReferenceFrame]


def test_references_missing_from_an_acknowledgement_are_lost() -> None:
    bench, _ = unanswered(3)
    bench.session.status = None  # whose clock this bench does not care for
    bench.say(t_board_us=board_us(bench.t_ns))
    assert kinds(bench.session.resume(bench.t_ns)) == [ReferenceFrame, TimeRequest]


def test_a_reference_held_back_until_it_was_past_is_not_sent_and_none_stands() -> None:
    bench, _ = unanswered(3)
    bench.t_ns += 80 * MS
    bench.say(seq=2)
    assert bench.session.resume(bench.t_ns) == []
    assert not bench.session.follows(bench.t_ns)  # so the next pass says what holds now
    assert kinds(bench.send()) == [ReferenceFrame]
    assert bench.session.follows(bench.t_ns)


def test_a_silent_board_gets_no_keep_alives_but_a_time_request(bench: Bench) -> None:
    said = bench.run(900 * MS)
    assert max(t_ns for t_ns, command in said if isinstance(command, Keepalive)) <= START_NS + 300 * MS
    assert any(isinstance(command, TimeRequest) for t_ns, command in said if t_ns > START_NS + 300 * MS)


def test_statuses_that_the_line_loses_are_counted() -> None:
    session = BoardSession(link_start_ns=LINK_NS, controller="pi")
    session.link_up(START_NS)
    for numbers, lost in (((65534, 65535, 0, 3), 2), ((7, 8), 0), ((None, 3, None, 9), 0)):
        before = session.lost_statuses
        session.receive_hello(HELLO, START_NS)  # whatever came before it was another session's
        for number in numbers:
            session.receive_status(STATUS._replace(number=number), START_NS)
        assert session.lost_statuses - before == lost
