"""Pads from 60 Hz to 1 kHz, of which nothing is configured: what the daemon takes from their stamps."""

from __future__ import annotations

import math

import pytest

from hapticd.sim.fingers.scenarios import SCENARIOS, SMOOTH, SPEED_MM_S
from hapticd.sim.lockstep import Simulation
from hapticd.sim.plate.ground_truth import PlateSettings
from hapticd.sim.settings import Settings
from hapticd.sim.world_errors import WorldErrors

SECONDS, LATENCY_MS, LINK_MS = 2.5, 10.0, 5.0
FASTEST_HZ, SLOWEST_HZ = 1000.0, 60.0


def played(report_hz: float, lost_frac: float = 0.0, stamp_jitter_ms: float = 1.0) -> Simulation:
    plate = PlateSettings(world=WorldErrors(lost_frac=lost_frac))
    settings = Settings(motion=SMOOTH, report_period_ms=1e3 / report_hz, stamp_jitter_ms=stamp_jitter_ms, plate=plate)
    simulation = Simulation(SCENARIOS["strokes"].build(1, SPEED_MM_S), settings, 1)
    simulation.run(SECONDS)
    return simulation


@pytest.mark.parametrize(
    ("report_hz", "stamp_jitter_ms"), [(SLOWEST_HZ, 1.0), (120.0, 1.0), (FASTEST_HZ, 0.0), (FASTEST_HZ, 1.0)]
)
def test_the_period_is_found_and_the_horizon_is_the_way_of_a_touch(report_hz: float, stamp_jitter_ms: float) -> None:
    simulation = played(report_hz, stamp_jitter_ms=stamp_jitter_ms)
    period_s = simulation.machine.pipeline._fingers.period_s
    assert period_s == pytest.approx(1.0 / report_hz, rel=0.03)  # also where a third of the stamps is no later
    result = simulation.result("strokes")
    horizon_ms = result.status["latency_ms"]["horizon"]["p50"]
    assert horizon_ms == pytest.approx(LATENCY_MS + LINK_MS, abs=1.5)
    assert 0.0 < result.score.leak_um < 0.1
    assert math.isfinite(result.score.slip_error_um)


@pytest.mark.parametrize(("report_hz", "silence_ms"), [(SLOWEST_HZ, 58.3), (FASTEST_HZ, 40.0)])
def test_a_slow_pad_may_lose_reports_before_its_fingers_count_as_lifted(report_hz: float, silence_ms: float) -> None:
    simulation = played(report_hz, lost_frac=0.05)
    pipeline = simulation.machine.pipeline
    assert pipeline.newest_finger_id == 2  # nobody was lifted and landed again
    t_read_ns = simulation.machine.last_tick.t_now_ns if simulation.machine.last_tick else 0
    assert not pipeline._fingers.are_silent(t_read_ns + round((silence_ms - 5.0) * 1e6))
    assert pipeline._fingers.are_silent(t_read_ns + round((silence_ms + 5.0) * 1e6))
