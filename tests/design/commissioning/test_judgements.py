"""Judgements of a bare rig, beyond what `tests/tools/calibrate/test_bare_rig.py` shows of each mistake."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from hapticd.design.commissioning.drive import HeldMode, judge_deadman, judge_loop, judge_stop, judge_touch
from hapticd.design.commissioning.findings import Flaw, Judgement
from hapticd.design.commissioning.plate import judge_limits, judge_matrices, judge_resonance
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
from hapticd.design.commissioning.wires import is_elsewhere, judge_answers, judge_polarity, judge_search
from hapticd.design.wiring import fit_wiring

from .responses import DESIGN, SENSES, sweeps

FOUND = fit_wiring(sweeps())
HELD = HeldMode(1.0, 1.001, 0.001, 25.0, 24.5)
GOOD = MeterReadings(3.3, 24.1, -23.9, (1.65, 1.66))
TICKS = 1000
UNREAD, RIGHT = (None, None), (1.0, 1.02)
OWN, SWAP, HALF = np.eye(2), np.eye(2)[[1, 0]], np.full((2, 2), 0.5)
Matrix = npt.NDArray[np.float64]


def named(judgement: Judgement) -> list[tuple[tuple[Flaw, ...], tuple[int, ...]]]:
    return [(finding.causes, finding.wires) for finding in judgement.findings]


def supply(readings: MeterReadings = GOOD, interlock: int | None = None, **changes: bool) -> Judgement:
    return judge_supply(readings, interlock, **{"is_configured": True, "supply_fell": False, **changes})


def test_good_supply_passes_with_its_readings_and_what_is_unread_is_not_judged() -> None:
    assert supply().is_passed
    assert ("supply, plus", "24.10 V") in supply().figures
    unread = supply(MeterReadings(None, None, None, UNREAD))
    assert (unread.is_passed, {value for _, value in unread.figures}) == (True, {"not measured"})
    assert supply(replace(GOOD, board_v=3.22, idle_v=(1.61, 1.61))).is_passed  # the middle is the measured supply's


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({"board_v": 2.9, "idle_v": (1.45, 1.45)}, ((Flaw.SUPPLY_LOW,), ())),
        ({"plus_v": 12.0}, ((Flaw.SUPPLY_LOW,), ())),
        ({"minus_v": -30.0}, ((Flaw.SUPPLY_LOW,), ())),
        ({"minus_v": 24.0}, ((Flaw.SUPPLY_LOW,), ())),
        ({"idle_v": (1.65, 1.3)}, ((Flaw.SENSOR_OFFSET,), (1,))),
    ],
)
def test_each_wrong_supply_or_idle_level_is_named(
    changes: dict[str, Any], found: tuple[tuple[Flaw, ...], tuple[int, ...]]
) -> None:
    assert named(supply(replace(GOOD, **changes))) == [found]


def test_the_board_s_log_names_open_circuit_fallen_supply_and_refused_settings() -> None:
    assert named(supply(interlock=AMPLIFIER_FAULT)) == [((Flaw.FAULT_LINE,), ())]
    assert named(supply(interlock=EMERGENCY_STOP)) == [((Flaw.STOP_LINE,), ())]
    assert interlock_of((64, EMERGENCY_STOP, SUPPLY, AMPLIFIER_FAULT, 65)) == AMPLIFIER_FAULT
    assert interlock_of((64, SUPPLY)) is None
    assert named(supply(supply_fell=True)) == [((Flaw.SUPPLY_LOW,), ())]
    assert "configuration" in supply(is_configured=False).sentence


def measured(noise_um: float, hum_um: float, hum_hz: float = 50.0) -> SensorsAtRest:
    """Return what is found of hum in sensor 0, as the demodulation leaves it, in noise."""
    random = np.random.default_rng(1)
    t_us = 2000.0 * np.arange(TICKS)
    noise = noise_um * (random.standard_normal((TICKS, 2)) + 1j * random.standard_normal((TICKS, 2)))
    carrier = np.exp(-2j * np.pi * DESIGN.drive_hz * t_us * 1e-6)
    noise[:, 0] += hum_um * np.cos(2.0 * np.pi * hum_hz * t_us * 1e-6) * carrier
    return at_rest(t_us, noise, DESIGN)


@pytest.mark.parametrize("hum_hz", [50.0, 60.0])
def test_hum_and_noise_are_distinguished(hum_hz: float) -> None:
    rest = measured(0.00025, 0.002, hum_hz)
    assert rest.hum_hz == hum_hz
    assert rest.hum_um == pytest.approx([0.002, 0.0], abs=1e-4)
    assert rest.noise_um == pytest.approx([0.00025, 0.00025], rel=0.1)
    assert named(judge_rest(rest, DESIGN, TICKS)) == [((Flaw.SENSOR_FLOATING,), (0,))]
    both = replace(rest, hum_um=np.array([0.002, 0.002]))
    assert named(judge_rest(both, DESIGN, TICKS)) == [((Flaw.MAINS_HUM,), ())]
    noisy = replace(measured(0.00025, 0.0), noise_um=np.array([0.00025, 0.004]))
    assert named(judge_rest(noisy, DESIGN, TICKS)) == [((Flaw.SENSOR_NOISY, Flaw.SENSOR_FLOATING), (1,))]
    assert judge_rest(measured(0.00025, 0.0), DESIGN, TICKS).is_passed


@pytest.mark.parametrize(
    ("senses", "drives", "outputs_v", "found"),
    [
        (SENSES, OWN, UNREAD, []),
        (SWAP @ SENSES, OWN, UNREAD, [((Flaw.SENSORS_SWAPPED,), (0, 1))]),
        (SENSES, SWAP, UNREAD, [((Flaw.AMPLIFIERS_SWAPPED,), (0, 1))]),
        (HALF @ SENSES, OWN, UNREAD, [((Flaw.SENSORS_SHORTED,), (0, 1))]),
        (SENSES, HALF, UNREAD, [((Flaw.DRIVES_SHORTED,), (0, 1))]),
        (np.diag((1.0, 0.0)) @ SENSES, OWN, UNREAD, [((Flaw.SENSOR_OPEN,), (1,))]),
        (SENSES, np.diag((0.0, 1.0)), UNREAD, [((Flaw.DRIVE_OPEN,), (0,))]),
        (np.diag((0.1, 1.0)) @ SENSES, OWN, RIGHT, [((Flaw.SENSOR_GAIN,), (0,))]),
        (np.diag((10.0, 1.0)) @ SENSES, OWN, UNREAD, [((Flaw.SENSOR_GAIN, Flaw.AMPLIFIER_GAIN), (0,))]),
        (SENSES, OWN, (1.0, 0.1), [((Flaw.AMPLIFIER_GAIN,), (1,))]),
        (SENSES, OWN, (1.0, 10.0), [((Flaw.AMPLIFIER_GAIN,), (1,))]),
        (SENSES, OWN, (1.0, -1.0), [((Flaw.AMPLIFIER_INVERTED,), (1,))]),
        (SENSES, OWN, (1.0, 0.0), [((), (1,))]),
    ],
)
def test_wrong_wire_is_named_by_sweeps_and_outputs(
    senses: Matrix,
    drives: Matrix,
    outputs_v: tuple[float | None, ...],
    found: list[tuple[tuple[Flaw, ...], tuple[int, ...]]],
) -> None:
    assert named(judge_answers(sweeps(senses, drives), DESIGN, outputs_v, 1.0)) == found


def test_sign_of_a_loop_names_the_sensor_where_the_output_is_right() -> None:
    inverted = sweeps(np.diag((1.0, -1.0)) @ SENSES)
    assert judge_polarity(sweeps(), DESIGN, UNREAD).is_passed
    assert named(judge_polarity(inverted, DESIGN, RIGHT)) == [((Flaw.SENSOR_INVERTED,), (1,))]
    pair = (Flaw.SENSOR_INVERTED, Flaw.AMPLIFIER_INVERTED)
    assert named(judge_polarity(inverted, DESIGN, UNREAD)) == [(pair, (1,))]
    assert named(judge_polarity(sweeps(np.zeros((2, 2))), DESIGN, UNREAD)) == [((), (0,)), ((), (1,))]


def test_resonances_elsewhere_are_another_plates_and_sought_where_all_is_silent() -> None:
    design = replace(DESIGN, frequency_hz=tuple(hz - 100.0 for hz in DESIGN.frequency_hz))
    assert not is_elsewhere(sweeps(), DESIGN)
    assert is_elsewhere(sweeps(0.01 * SENSES), DESIGN)
    finding = judge_search(sweeps(), design)
    assert finding is not None
    assert finding.causes == (Flaw.DIMENSIONS,)
    assert judge_search(sweeps(), DESIGN) is judge_search(sweeps(0.001 * SENSES), DESIGN) is None


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({}, []),
        ({"decay_1_s": (80.0, 80.0), "gain_um_per_v_s": (7.5, 17.0)}, [((Flaw.GLUE,), (1,))]),
        ({"gain_um_per_v_s": (15.0, 7.5)}, [((Flaw.PATCH_CRACKED,), (0,))]),
        ({"frequency_hz": (28895.0, 28915.0)}, [((Flaw.DIMENSIONS,), ())]),
    ],
)
def test_difference_from_the_design_is_named(
    changes: dict[str, tuple[float, float]], found: list[tuple[tuple[Flaw, ...], tuple[int, ...]]]
) -> None:
    assert named(judge_resonance(FOUND.fits, replace(DESIGN, **changes))) == found


def test_matrices_of_swapped_wires_do_not_pass() -> None:
    assert judge_matrices(FOUND).is_passed
    assert not judge_matrices(fit_wiring(sweeps(SENSES[::-1]))).is_passed


@pytest.mark.parametrize(
    ("straight", "found"),
    [
        ([[1.0, np.nan], [np.nan, 0.99]], []),
        ([[0.8, np.nan], [1.0, 1.0]], [((Flaw.PREAMPLIFIER_CLIPS,), (0,))]),
        ([[0.8, np.nan], [0.8, 1.0]], [((Flaw.SUPPLY_LOW,), ())]),
    ],
)
def test_a_cut_off_sensor_is_distinguished_from_a_weak_amplifier(
    straight: list[list[float]], found: list[tuple[tuple[Flaw, ...], tuple[int, ...]]]
) -> None:
    assert named(judge_limits(np.array(straight), np.array([1.2, 1.2]))) == found


@pytest.mark.parametrize(
    ("judgement", "sentence"),
    [
        (judge_deadman(is_silent=False, was_pulled=False, is_quiet=False), "without keep-alives"),
        (judge_deadman(is_silent=True, was_pulled=False, is_quiet=False), "was not pulled"),
        (judge_deadman(is_silent=True, was_pulled=True, is_quiet=False), "did not stop"),
        (judge_deadman(is_silent=True, was_pulled=True, is_quiet=True), ""),
        (judge_stop(stopped=False, is_logged=False, drives_again=True), "PB15"),
        (judge_stop(stopped=True, is_logged=False, drives_again=True), "PB15"),
        (judge_stop(stopped=True, is_logged=True, drives_again=False), "after the stop's release"),
        (judge_stop(stopped=True, is_logged=True, drives_again=True), ""),
        (judge_loop([HELD], "it swings"), "it swings"),
        (judge_loop([replace(HELD, mean_um=0.9)], ""), "Mode 0 is at 0.900 um"),
        (judge_loop([HELD, replace(HELD, volts_v=40.0)], ""), "Mode 1 takes 40.0 V"),
        (judge_loop([HELD, HELD], ""), ""),
        (judge_touch(10.0, 10.1, ""), "does not show in the volts"),
        (judge_touch(10.0, 12.0, "it swings"), "it swings"),
        (judge_touch(10.0, 12.0, ""), ""),
        (judge_touch(1.2 + 12.4j, 3.0 + 12.4j, ""), ""),  # far from the resonance
    ],
)
def test_interlocks_loop_and_touch_pass_only_where_all_is_right(judgement: Judgement, sentence: str) -> None:
    assert judgement.is_passed is not bool(sentence)
    assert sentence in judgement.sentence
