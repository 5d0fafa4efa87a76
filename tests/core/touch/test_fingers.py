"""When the fingers of a pad count as lifted because it is silent."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from hapticd.core.prediction.motion import AdaptivePredictor
from hapticd.core.touch.fingers import LONGEST_SILENCE_NS, Fingers
from hapticd.values import Contact, TouchFrame

MS = 1_000_000
START_NS = 50_000 * MS


def fingers() -> Fingers:
    return Fingers(AdaptivePredictor, sensor_latency_ns=10 * MS, silence_ns=40 * MS)


def frame(t_ns: int) -> TouchFrame:
    return TouchFrame(t_ns, (Contact(1, 1e-7 * (t_ns - START_NS), 0.0, 8.0, 7.0, 0.0, 0.5, True, 4, 0, 0),), False)


def touched(period_ns: int) -> tuple[Fingers, int]:
    """Return the fingers after some reports, and when the last one was read."""
    pad = fingers()
    for report in range(60):
        t_ns = START_NS + report * period_ns
        pad.touch(frame(t_ns), t_ns + 12 * MS)
    return pad, t_ns + 12 * MS


def test_a_pad_of_60_hz_that_loses_a_twentieth_of_its_reports_keeps_its_fingers() -> None:
    random, pad, lifted = np.random.default_rng(3), fingers(), 0
    kept_ns = [START_NS + round(k * 1e9 / 60) for k in range(3600) if k < 20 or random.random() > 0.05]
    assert 49 < max(later - t_ns for t_ns, later in pairwise(kept_ns)) / MS < 51  # two lost in a row
    for t_ns, later_ns in pairwise(kept_ns):
        pad.touch(frame(t_ns), t_ns + 12 * MS)
        lifted += pad.are_silent(later_ns + 12 * MS)
    assert lifted == 0


@pytest.mark.parametrize(("period_ms", "silence_ms"), [(11.25, 40.0), (2.0, 40.0), (1000 / 60, 3.5 * 1000 / 60)])
def test_a_silent_pad_lifts_fingers_after_periods_and_not_before_its_timeout(
    period_ms: float, silence_ms: float
) -> None:
    pad, t_ns = touched(round(period_ms * MS))
    assert not pad.are_silent(t_ns + round((silence_ms - 0.5) * MS))
    pad.touch(frame(START_NS + 59 * round(period_ms * MS)), t_ns + 20 * MS)  # its clock stands still
    assert pad.are_silent(t_ns + round((silence_ms + 0.5) * MS))


def test_no_period_lets_a_silent_pad_keep_its_fingers_for_longer_than_the_bound() -> None:
    pad, t_ns = touched(49 * MS)
    assert pad.are_silent(t_ns + LONGEST_SILENCE_NS + MS)


def test_a_fast_pads_stamps_may_run_back_and_no_report_is_lost() -> None:
    """Off by up to 4 ms at 240 Hz, one in six does not come after the last."""
    random, pad, taken, errors_ms = np.random.default_rng(4), fingers(), set(), []
    for report in range(3000):
        t_ns = START_NS + round(report * 1e9 / 240)
        pad.touch(frame(round(t_ns / MS + random.uniform(-4.0, 4.0)) * MS), t_ns + 12 * MS)
        taken.add(pad.t_device_ns)
        errors_ms.append((pad.t_sample_ns - t_ns) / MS)
    assert len(taken) > 2950  # 2552 where such reports are left out
    assert np.std(errors_ms[600:]) < 1.1  # 1.8 where the clock restarts with each
