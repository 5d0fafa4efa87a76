"""A device or a program goes, falls silent, stops or comes back: when the plate is quiet, and driven again."""

from __future__ import annotations

from typing import NamedTuple

import pytest
from faulty_simulation import FaultySimulation, LineFault
from stand import (
    HANDSHAKE_MS,
    LED_DOWN_MS,
    LINK_MS,
    PERIOD_MS,
    RING_DOWN_MS,
    SILENCE_MS,
    SILENT_MS,
    TIMER_MS,
    SetUp,
    agrees,
    cut,
    doing,
    lines,
    passing,
    seconds,
    worst,
)

from hapticd.daemon.machine import PAD_IS_SILENT

REPORTS_MS = 3 * PERIOD_MS + LINK_MS
FRAMES_MS = 4 * PERIOD_MS + LINK_MS  # three that the board takes as a sign of life, and one that moves
STATUS_EVERY_MS, GREET_EVERY_MS = 100.0, 250.0
BOARD_SILENT_MS, TTL_MS = 1000.0, 500.0
GREETED = ("WARNING board: silent; requesting its hello until it answers",)


class Fault(NamedTuple):
    """A row of the README's table; the plate is quiet and driven again within these times, with so many dead-man trips
    and these lines in the journal, where they are the same in each run."""

    name: str
    set_up: SetUp
    lasts_s: float
    quiet_ms: float
    back_ms: float
    trips: int | None = None
    journal: tuple[str, ...] | None = None


def half_a_frame_and_no_more(t_from_s: float, t_until_s: float) -> LineFault:
    is_cut = False

    def fault(t_ns: int, data: bytes) -> list[tuple[int, bytes]]:
        nonlocal is_cut
        if not t_from_s <= seconds(t_ns) < t_until_s:
            return [(t_ns, data)]
        was_cut, is_cut = is_cut, True
        return [] if was_cut else [(t_ns, data[: len(data) // 2])]

    return fault


FAULTS = (
    Fault(
        "trackpad unplugged",
        doing(FaultySimulation.pull_trackpad, FaultySimulation.plug_trackpad),
        *(0.5, LINK_MS + LED_DOWN_MS, REPORTS_MS),  # within one zero frame
        *(0, ("WARNING trackpad: lost", "INFO trackpad: open")),
    ),
    Fault(
        "trackpad silent under fingers",
        passing(cut, "report"),
        *(0.5, SILENCE_MS + TIMER_MS + LINK_MS + LED_DOWN_MS, REPORTS_MS),
        *(0, (f"WARNING {PAD_IS_SILENT}",)),
    ),
    Fault(
        "serial device unplugged",
        doing(FaultySimulation.pull_board, FaultySimulation.plug_board),
        *(0.5, SILENT_MS, HANDSHAKE_MS),
        *(None, ("WARNING board: the port is lost", "INFO board: open")),
    ),
    Fault(
        "board mute, but listening",  # it follows; then the greeting makes it let go
        passing(cut, "host"),
        *(1.5, BOARD_SILENT_MS + STATUS_EVERY_MS + RING_DOWN_MS + LINK_MS, GREET_EVERY_MS + HANDSHAKE_MS),
        *(None, GREETED),
    ),
    Fault("board deaf, but speaking", passing(cut, "board"), 0.5, SILENT_MS, FRAMES_MS, 1, ()),
    Fault(
        "board silent both ways",
        passing(cut, "host", "board"),
        *(1.5, SILENT_MS, GREET_EVERY_MS + HANDSHAKE_MS),
        *(None, GREETED),
    ),
    Fault(
        "half a frame for ever",  # which is no sign of life
        passing(half_a_frame_and_no_more, "board"),
        *(0.5, SILENT_MS + PERIOD_MS, FRAMES_MS),
        *(None, ()),
    ),
    Fault(
        "daemon stopped for 2 s",
        doing(FaultySimulation.stop_daemon, FaultySimulation.resume_daemon),
        *(2.0, LINK_MS + SILENT_MS, TIMER_MS + HANDSHAKE_MS),
        trips=1,
    ),
    Fault(
        "daemon killed, and another started",
        doing(FaultySimulation.stop_daemon, FaultySimulation.start_daemon),
        *(0.5, LINK_MS + SILENT_MS, HANDSHAKE_MS),
    ),
    Fault(
        "daemon ended in mid-stroke",
        doing(FaultySimulation.end_daemon, FaultySimulation.start_daemon),
        *(0.5, LINK_MS + LED_DOWN_MS, HANDSHAKE_MS),
    ),
    Fault(
        "client killed or stopped",
        doing(FaultySimulation.stop_client, FaultySimulation.resume_client),
        *(1.0, TTL_MS + max(TIMER_MS, PERIOD_MS) + LINK_MS + LED_DOWN_MS, REPORTS_MS),
        *(0, ()),
    ),
)


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_the_plate_is_quiet_and_driven_again_as_the_readme_says(fault: Fault, caplog: pytest.LogCaptureFixture) -> None:
    after = worst(fault.set_up, fault.lasts_s)
    assert after.quiet_ms <= fault.quiet_ms
    assert after.back_ms <= fault.back_ms
    assert after.board["reboots"] == 0
    assert fault.trips is None or after.board["deadman_trips"] == fault.trips
    assert fault.journal is None or tuple(lines(caplog)) == fault.journal
    agrees(fault.name, after)
