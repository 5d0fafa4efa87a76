"""A board that restarts, or is another."""

from __future__ import annotations

import math

import pytest
from faulty_simulation import BOOT_S, FaultySimulation, LineFault
from stand import HANDSHAKE_MS, RING_DOWN_MS, agrees, doing, lines, seconds, worst

from hapticd import board_protocol as protocol
from hapticd.wire.framing import FrameSplitter, encode_frame

STATUS_EVERY_MS = 100.0
TIME_EVERY_MS = 500.0


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
        stand.line_faults["host"] = as_another_firmware(t_fault_s)

    after = worst(set_up, 0.6, t_fault_s=4.5)
    assert after.quiet_ms <= RING_DOWN_MS
    assert after.back_ms == math.inf
    refusals = [record for record in caplog.records if record.levelname == "ERROR"]
    assert len(refusals) == 4  # one in each run, though it is greeted each 250 ms
    assert "protocol version" in refusals[0].getMessage()
    agrees("board of another firmware", after)


def as_another_firmware(t_from_s: float) -> LineFault:
    """From then on hellos say another version of the protocol."""
    splitter = FrameSplitter(1000)

    def fault(t_ns: int, data: bytes) -> list[tuple[int, bytes]]:
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

    return fault
