"""A trackpad whose clock wraps, stands still or runs backwards; any number of fingers; fingers that jump."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from faulty_simulation import FaultySimulation
from stand import (
    LED_DOWN_MS,
    LINK_MS,
    PERIOD_MS,
    QUIET_UM,
    SILENCE_MS,
    TIMER_MS,
    W_LIM_UM,
    agrees,
    lines,
    play,
    rms_um,
    seconds,
    worst,
)

from hapticd.daemon.machine import PAD_IS_SILENT
from hapticd.sim.fingers.paths import Rest, Touch
from hapticd.sim.fingers.scenarios import LAND_S, SLIPPERY_UM, STICKY_UM, Actor
from hapticd.wire.trackpad import STAMP_WRAP_MS

STAMP_AT = 9  # of a Magic Trackpad 2 over USB: 8 bytes, the report's type, then 21 bits of milliseconds above 3 others


def with_stamps(stand: FaultySimulation, stamp_ms: Callable[[int, float], int]) -> None:
    """The pad says another time: a function of the one it meant and of the instant of the run."""

    def fault(t_ns: int, data: bytes) -> list[tuple[int, bytes]]:
        word = int.from_bytes(data[STAMP_AT : STAMP_AT + 3], "little")
        said = stamp_ms(word >> 3, seconds(t_ns)) % STAMP_WRAP_MS
        return [(t_ns, data[:STAMP_AT] + (said << 3 | word & 7).to_bytes(3, "little") + data[STAMP_AT + 3 :])]

    stand.line_faults["report"] = fault


def test_a_pad_whose_stamp_stands_still_is_as_good_as_silent(caplog: pytest.LogCaptureFixture) -> None:
    def set_up(stand: FaultySimulation, t_fault_s: float, t_over_s: float) -> None:
        held: list[int] = []

        def stands_still(meant_ms: int, t_s: float) -> int:
            if t_fault_s <= t_s < t_over_s:
                held.append(meant_ms)
                return held[0]
            return meant_ms

        with_stamps(stand, stands_still)

    after = worst(set_up, 0.5)
    assert after.quiet_ms <= PERIOD_MS + SILENCE_MS + TIMER_MS + LINK_MS + LED_DOWN_MS
    assert after.back_ms <= 3 * PERIOD_MS + LINK_MS
    assert lines(caplog) == [f"WARNING {PAD_IS_SILENT}"]
    agrees("trackpad's clock stands still", after)


@pytest.mark.parametrize("fingers", [0, 1, 2, 5, 11, 15])
def test_any_number_of_fingers_stays_within_the_limits(fingers: int, caplog: pytest.LogCaptureFixture) -> None:
    """The first slips, all others stick."""
    places = [(-52.0 + 26.0 * (i % 5), -30.0 + 25.0 * (i // 5)) for i in range(fingers)]
    actors = tuple(
        Actor(((LAND_S, SLIPPERY_UM if i == 0 else STICKY_UM),), path=Touch(Rest(place), LAND_S))
        for i, place in enumerate(places)
    )
    after = play(actors, lambda *_: None, 1.0, 1.6, 0.0)
    recording = after.simulation.world.recording()
    level_um = np.abs(recording.plate_um[recording.t_s > 1.0]).max(axis=1)
    assert np.abs(recording.reference_um).max() <= W_LIM_UM
    assert after.simulation.machine.report_status(after.simulation.t_ns)["fingers"] == fingers
    assert lines(caplog) == []
    if fingers == 0:
        assert level_um.max() <= QUIET_UM
        return
    run = after.run()
    sticks_um = max((rms_um(run, i, 1.0, 1.6) for i in range(1, fingers)), default=0.0)
    assert sticks_um <= 0.05 or fingers > 2  # two modes cannot quiet more than one place
