"""A line that loses, cuts, damages, doubles, swaps or holds up what it carries, for two seconds and both ways."""

from __future__ import annotations

from collections import Counter

import pytest
from faulty_line import Line, LineFaults
from faulty_simulation import FaultySimulation
from stand import Aftermath, agrees, lines, nanoseconds, rms_um, simulate

FROM_S, UNTIL_S = 1.0, 3.0
STICKY = 1
CLEAN_UM = 0.042


def through(**shares: float) -> Aftermath:
    """Two seconds of such a line, with all that passes in both directions."""

    def set_up(stand: FaultySimulation, t_fault_s: float, t_over_s: float) -> None:
        faults = LineFaults(**shares, from_ns=nanoseconds(t_fault_s), until_ns=nanoseconds(t_over_s))  # type: ignore[arg-type]
        stand.line_faults["board"], stand.line_faults["host"] = Line(faults, 3), Line(faults, 5)

    return simulate(set_up, FROM_S, UNTIL_S, 1.0)


def counters(after: Aftermath, direction: str) -> Counter[str]:
    line = after.simulation.line_faults[direction]
    assert isinstance(line, Line)
    return line.counters


def leaks_um(after: Aftermath) -> tuple[float, float]:
    """Under the sticky finger while the line was bad, and from 0.2 s later on."""
    run = after.run()
    return rms_um(run, STICKY, FROM_S, UNTIL_S), rms_um(run, STICKY, UNTIL_S + 0.2, UNTIL_S + 1.0)


# A frame that comes to nothing leaves the plate on the polyline before, whose last knot lies half a period beyond.
@pytest.mark.parametrize(
    ("shares", "most_um"),
    [
        ({"lost": 0.2}, 0.12),
        ({"corrupted": 0.2}, 0.12),
        ({"truncated": 0.2}, 0.12),
        ({"duplicated": 0.33}, CLEAN_UM),
        ({"reordered": 0.2}, 0.06),
        ({"delayed": 0.5, "delay_ns": 20_000_000}, 0.08),
    ],
    ids=str,
)
def test_the_plate_goes_on_within_its_limits_and_recovers_at_once(
    shares: dict[str, float], most_um: float, caplog: pytest.LogCaptureFixture
) -> None:
    after = through(**shares)
    during_um, later_um = leaks_um(after)
    board = after.board
    assert sum(counters(after, "board").values()) > 20
    assert during_um <= most_um
    assert later_um <= 1.2 * CLEAN_UM
    assert board["deadman_trips"] <= 1  # such a line may lose 50 ms of frames in a row, by chance
    assert board["held_back"] <= 8
    assert board["state"] == "LIVE"
    assert not board["limited"]
    assert lines(caplog) == []


def test_a_line_of_noise_alone_is_silence_and_is_survived(caplog: pytest.LogCaptureFixture) -> None:
    after = through(corrupted=1.0, truncated=1.0)
    board = after.board
    assert board["state"] == "LIVE"
    assert board["deadman_trips"] == 1
    assert after.back_ms <= 250.0 + 150.0
    assert lines(caplog) == ["WARNING board: silent; requesting its hello until it answers"]
    agrees("line that leaves no frame whole", after)


def test_damaged_frames_are_counted_at_both_ends() -> None:
    after = through(corrupted=0.2)
    assert after.board["bad_frames"] >= 0.9 * counters(after, "board")["corrupted"]
    dropped = sum(after.simulation.machine.board.dropped.values())
    assert dropped >= 0.9 * counters(after, "host")["corrupted"]


def test_late_duplicates_and_old_numbers_are_counted_and_change_nothing() -> None:
    clean, doubled = through(), through(duplicated=1.0)
    assert doubled.board["late_frames"] > 100
    assert (doubled.run().reference_um == clean.run().reference_um).all()  # to the last bit
