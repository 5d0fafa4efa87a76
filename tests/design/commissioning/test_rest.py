"""Supplies, interlocks and sensors at rest: what is named, and what a good bench may have."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hapticd.design.commissioning.findings import Flaw, Judgement
from hapticd.design.commissioning.rest import (
    AMPLIFIER_FAULT,
    EMERGENCY_STOP,
    SUPPLY,
    MeterReadings,
    SensorsAtRest,
    at_rest,
    interlock_of,
    judge_rest,
    judge_supply,
)

from .responses import DESIGN

GOOD = MeterReadings(3.3, 24.1, -23.9, (1.65, 1.66))
TICKS = 1000


def causes(judgement: Judgement) -> list[Flaw]:
    return [cause for finding in judgement.findings for cause in finding.causes]


def supply(readings: MeterReadings, interlock: int | None = None, **changes: bool) -> Judgement:
    return judge_supply(readings, interlock, **{"is_configured": True, "supply_fell": False, **changes})


def test_a_good_supply_passes_and_shows_its_readings() -> None:
    judgement = supply(GOOD)
    assert judgement.is_passed
    assert ("supply, plus", "24.10 V") in judgement.figures


def test_what_was_not_measured_is_not_judged() -> None:
    judgement = supply(MeterReadings(None, None, None, (None, None)))
    assert judgement.is_passed
    assert {value for _, value in judgement.figures} == {"not measured"}


@pytest.mark.parametrize(
    "changes", [{"board_v": 2.9, "idle_v": (1.45, 1.45)}, {"plus_v": 12.0}, {"minus_v": -30.0}, {"minus_v": 24.0}]
)
def test_a_wrong_supply_is_named(changes: dict[str, Any]) -> None:
    assert causes(supply(replace(GOOD, **changes))) == [Flaw.SUPPLY_LOW]


def test_an_idle_level_off_the_middle_names_its_sensor() -> None:
    judgement = supply(replace(GOOD, idle_v=(1.65, 1.3)))
    assert causes(judgement) == [Flaw.SENSOR_OFFSET]
    assert judgement.findings[0].wires == (1,)


def test_the_middle_is_that_of_the_measured_supply() -> None:
    assert supply(replace(GOOD, board_v=3.22, idle_v=(1.61, 1.61))).is_passed


def test_an_open_circuit_is_named_by_the_boards_log() -> None:
    assert causes(supply(GOOD, AMPLIFIER_FAULT)) == [Flaw.FAULT_LINE]
    assert causes(supply(GOOD, EMERGENCY_STOP)) == [Flaw.STOP_LINE]
    assert interlock_of((64, EMERGENCY_STOP, SUPPLY, AMPLIFIER_FAULT, 65)) == AMPLIFIER_FAULT
    assert interlock_of((64, SUPPLY)) is None


def test_a_supply_that_fell_and_a_refused_configuration_are_reported() -> None:
    assert causes(supply(GOOD, supply_fell=True)) == [Flaw.SUPPLY_LOW]
    assert "configuration" in supply(GOOD, is_configured=False).sentence


def measured(noise_um: float, hum_um: float, hum_hz: float = 50.0) -> SensorsAtRest:
    """Return what is found of hum in sensor 0, as the demodulation leaves it, in noise."""
    random = np.random.default_rng(1)
    t_us = 2000.0 * np.arange(TICKS)
    noise = noise_um * (random.standard_normal((TICKS, 2)) + 1j * random.standard_normal((TICKS, 2)))
    carrier = np.exp(-2j * np.pi * DESIGN.drive_hz * t_us * 1e-6)
    noise[:, 0] += hum_um * np.cos(2.0 * np.pi * hum_hz * t_us * 1e-6) * carrier
    return at_rest(t_us, noise, DESIGN)


@pytest.mark.parametrize("hum_hz", [50.0, 60.0])
def test_hum_and_noise_are_told_apart(hum_hz: float) -> None:
    rest = measured(0.00025, 0.002, hum_hz)
    assert rest.hum_hz == hum_hz
    assert rest.hum_um[0] == pytest.approx(0.002, rel=0.05)
    assert rest.hum_um[1] < 1e-4
    assert rest.noise_um == pytest.approx([0.00025, 0.00025], rel=0.1)


def test_quiet_sensors_pass() -> None:
    assert judge_rest(measured(0.00025, 0.0), DESIGN, TICKS).is_passed


def test_hum_in_one_sensor_is_its_lead() -> None:
    judgement = judge_rest(measured(0.00025, 0.002), DESIGN, TICKS)
    assert causes(judgement) == [Flaw.SENSOR_FLOATING]
    assert judgement.findings[0].wires == (0,)


def test_hum_in_all_sensors_is_the_benchs_ground() -> None:
    rest = replace(measured(0.00025, 0.002), hum_um=np.array([0.002, 0.002]))
    assert causes(judge_rest(rest, DESIGN, TICKS)) == [Flaw.MAINS_HUM]


def test_noise_without_hum_names_screen_or_lead() -> None:
    rest = replace(measured(0.00025, 0.0), noise_um=np.array([0.00025, 0.004]))
    judgement = judge_rest(rest, DESIGN, TICKS)
    assert causes(judgement) == [Flaw.SENSOR_NOISY, Flaw.SENSOR_FLOATING]
    assert judgement.findings[0].wires == (1,)
