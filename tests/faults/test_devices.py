"""A device goes, comes back, falls silent, restarts or is another."""

from __future__ import annotations

import math

import pytest
from faulty_simulation import BOOT_S, FaultySimulation, Way
from stand import (
    HANDSHAKE_MS,
    LED_DOWN_MS,
    LINK_MS,
    PERIOD_MS,
    RING_DOWN_MS,
    SILENCE_MS,
    SILENT_MS,
    TIMER_MS,
    agrees,
    cut,
    doing,
    lines,
    passing,
    seconds,
    worst,
)

from hapticd import board_protocol as protocol
from hapticd.daemon.machine import PAD_IS_SILENT
from hapticd.wire.framing import FrameSplitter, encode_frame

THREE_FRAMES_MS = 4 * PERIOD_MS + LINK_MS  # that the board takes as a sign of life, and one that moves
STATUS_EVERY_MS = 100.0
TIME_EVERY_MS = 500.0
GREET_EVERY_MS = 250.0
BOARD_SILENT_MS = 1000.0


def test_a_pulled_trackpad_is_a_quiet_plate_within_one_zero_frame(caplog: pytest.LogCaptureFixture) -> None:
    after = worst(doing(FaultySimulation.pull_trackpad, FaultySimulation.plug_trackpad), 0.5)
    assert after.quiet_ms <= LINK_MS + LED_DOWN_MS
    assert after.back_ms <= 3 * PERIOD_MS + LINK_MS
    assert after.board["deadman_trips"] == 0
    assert lines(caplog) == ["WARNING trackpad: lost", "INFO trackpad: open"]
    agrees("trackpad unplugged", after)


def test_a_trackpad_that_falls_silent_under_fingers_lifts_them(caplog: pytest.LogCaptureFixture) -> None:
    after = worst(passing(cut, "report"), 0.5)
    assert after.quiet_ms <= SILENCE_MS + TIMER_MS + LINK_MS + LED_DOWN_MS
    assert after.back_ms <= 3 * PERIOD_MS + LINK_MS
    assert lines(caplog) == [f"WARNING {PAD_IS_SILENT}"]
    agrees("trackpad silent under fingers", after)


def test_a_pulled_board_quiets_itself_and_is_driven_again_after_a_handshake(caplog: pytest.LogCaptureFixture) -> None:
    after = worst(doing(FaultySimulation.pull_board, FaultySimulation.plug_board), 0.5)
    assert after.quiet_ms <= SILENT_MS
    assert after.back_ms <= HANDSHAKE_MS
    assert after.board["reboots"] == 0  # it ran on
    assert lines(caplog) == ["WARNING board: the port is lost", "INFO board: open"]
    agrees("serial device unplugged", after)


# The board's clock wraps at 2 s. A reset half a second before looks like half a second that passed: then only the next
# exchange of times tells; any other shows in the first status.
@pytest.mark.parametrize(("t_fault_s", "noticed_ms"), [(1.5, TIME_EVERY_MS), (4.5, STATUS_EVERY_MS)])
def test_a_board_that_was_reset_behind_an_open_port_is_greeted_anew(
    t_fault_s: float, noticed_ms: float, caplog: pytest.LogCaptureFixture
) -> None:
    after = worst(doing(FaultySimulation.reset_board), BOOT_S + RING_DOWN_MS * 1e-3, t_fault_s=t_fault_s, after_s=1.2)
    assert after.quiet_ms <= RING_DOWN_MS
    assert after.back_ms <= noticed_ms + HANDSHAKE_MS
    assert after.board["reboots"] == 1
    assert after.board["deadman_trips"] == 0  # the new boot's own
    warned, greeted = lines(caplog)
    assert warned == "WARNING board: Clock discontinuity (board reset?): reconnecting"
    assert greeted.startswith("INFO board: firmware ")
    if t_fault_s > 2.0:
        agrees("board reset behind an open port", after)


def test_a_board_of_another_firmware_is_refused_in_one_sentence(caplog: pytest.LogCaptureFixture) -> None:
    def set_up(stand: FaultySimulation, t_fault_s: float, t_over_s: float) -> None:
        del t_over_s
        stand.at(t_fault_s, stand.reset_board)
        stand.ways["host"] = as_another_firmware(t_fault_s)

    after = worst(set_up, 0.6, t_fault_s=4.5)
    assert after.quiet_ms <= RING_DOWN_MS
    assert after.back_ms == math.inf
    refusals = [record for record in caplog.records if record.levelname == "ERROR"]
    assert len(refusals) == 4  # one in each run, though it is greeted each 250 ms
    assert "protocol version" in refusals[0].getMessage()
    agrees("board of another firmware", after)


def test_a_board_that_is_mute_is_let_go_after_a_second(caplog: pytest.LogCaptureFixture) -> None:
    after = worst(passing(cut, "host"), 1.5)
    # It hears, and follows; then the greeting makes it let go.
    assert after.quiet_ms <= BOARD_SILENT_MS + STATUS_EVERY_MS + RING_DOWN_MS + LINK_MS
    assert after.back_ms <= GREET_EVERY_MS + HANDSHAKE_MS
    assert lines(caplog) == ["WARNING board: silent; requesting its hello until it answers"]
    agrees("board mute, but listening", after)


def test_a_board_that_is_deaf_quiets_itself(caplog: pytest.LogCaptureFixture) -> None:
    after = worst(passing(cut, "board"), 0.5)
    assert after.quiet_ms <= SILENT_MS
    assert after.back_ms <= THREE_FRAMES_MS
    assert after.board["deadman_trips"] == 1
    assert lines(caplog) == []  # `status` tells the trip
    agrees("board deaf, but speaking", after)


def test_a_silent_board_quiets_itself_and_is_greeted_until_it_answers(caplog: pytest.LogCaptureFixture) -> None:
    after = worst(passing(cut, "host", "board"), 1.5)
    assert after.quiet_ms <= SILENT_MS
    assert after.back_ms <= GREET_EVERY_MS + HANDSHAKE_MS
    assert lines(caplog) == ["WARNING board: silent; requesting its hello until it answers"]
    agrees("board silent both ways", after)


def test_half_a_frame_for_ever_is_silence_and_costs_no_frame_behind_it(caplog: pytest.LogCaptureFixture) -> None:
    after = worst(passing(half_a_frame_and_no_more, "board"), 0.5)
    assert after.quiet_ms <= SILENT_MS + PERIOD_MS  # the half frame is no sign of life
    assert after.back_ms <= THREE_FRAMES_MS
    assert after.board["bad_frames"] == 1  # the half alone: each frame begins by ending what was on the line before
    assert lines(caplog) == []
    agrees("half a frame for ever", after)


def as_another_firmware(t_from_s: float) -> Way:
    """From then on hellos say another version of the protocol."""
    splitter = FrameSplitter(1000)

    def way(t_ns: int, data: bytes) -> list[tuple[int, bytes]]:
        if seconds(t_ns) < t_from_s:
            return [(t_ns, data)]
        said = b""
        for message in splitter.feed(data):
            if message[0] == protocol.MSG_HELLO:
                head = list(protocol.HELLO.unpack_from(message, 1))
                head[0] += 1
                message = message[:1] + protocol.HELLO.pack(*head) + message[1 + protocol.HELLO.size :]
            said += encode_frame(message)
        return [(t_ns, said)]

    return way


def half_a_frame_and_no_more(t_from_s: float, t_until_s: float) -> Way:
    is_cut = False

    def way(t_ns: int, data: bytes) -> list[tuple[int, bytes]]:
        nonlocal is_cut
        if not t_from_s <= seconds(t_ns) < t_until_s:
            return [(t_ns, data)]
        was_cut, is_cut = is_cut, True
        return [] if was_cut else [(t_ns, data[: len(data) // 2])]

    return way
