"""Which wire is wrong, from short sweeps: rows are sensors, columns amplifiers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from hapticd.design.commissioning.findings import Flaw, Judgement
from hapticd.design.commissioning.wires import is_elsewhere, judge_answers, judge_polarity, judge_search

from .responses import DESIGN, SENSES, sweeps

UNREAD = (None, None)
RIGHT = (1.0, 1.02)
SWAP = np.eye(2)[[1, 0]]
HALF = np.full((2, 2), 0.5)


def named(judgement: Judgement) -> list[tuple[tuple[Flaw, ...], tuple[int, ...]]]:
    return [(finding.causes, finding.wires) for finding in judgement.findings]


def test_sound_wires_pass() -> None:
    judgement = judge_answers(sweeps(), DESIGN, UNREAD, 1.0)
    assert judgement.is_passed
    assert judgement.figures[0] == ("amplifier 0", "sensor 0 100 %, sensor 1 1 %")


@pytest.mark.parametrize(
    ("senses", "drives", "cause", "wires"),
    [
        (SWAP @ SENSES, np.eye(2), Flaw.SENSORS_SWAPPED, (0, 1)),
        (SENSES, SWAP, Flaw.AMPLIFIERS_SWAPPED, (0, 1)),
        (HALF @ SENSES, np.eye(2), Flaw.SENSORS_SHORTED, (0, 1)),
        (SENSES, HALF, Flaw.DRIVES_SHORTED, (0, 1)),
        (np.diag((1.0, 0.0)) @ SENSES, np.eye(2), Flaw.SENSOR_OPEN, (1,)),
        (SENSES, np.diag((0.0, 1.0)), Flaw.DRIVE_OPEN, (0,)),
    ],
)
def test_a_wrong_wire_is_named(
    senses: npt.NDArray[np.float64], drives: npt.NDArray[np.float64], cause: Flaw, wires: tuple[int, ...]
) -> None:
    assert named(judge_answers(sweeps(senses, drives), DESIGN, UNREAD, 1.0)) == [((cause,), wires)]


@pytest.mark.parametrize("share", [0.1, 10.0])
def test_a_gain_is_the_sensors_where_the_output_is_right_and_either_where_it_is_unread(share: float) -> None:
    found = sweeps(np.diag((share, 1.0)) @ SENSES)
    assert named(judge_answers(found, DESIGN, RIGHT, 1.0)) == [((Flaw.SENSOR_GAIN,), (0,))]
    assert named(judge_answers(found, DESIGN, UNREAD, 1.0)) == [((Flaw.SENSOR_GAIN, Flaw.AMPLIFIER_GAIN), (0,))]


@pytest.mark.parametrize(
    ("output_v", "causes"),
    [
        (0.1, (Flaw.AMPLIFIER_GAIN,)),
        (10.0, (Flaw.AMPLIFIER_GAIN,)),
        (-1.0, (Flaw.AMPLIFIER_INVERTED,)),
        (0.0, ()),
    ],
)
def test_a_wrong_output_is_named_by_the_oscilloscope(output_v: float, causes: tuple[Flaw, ...]) -> None:
    assert named(judge_answers(sweeps(), DESIGN, (1.0, output_v), 1.0)) == [(causes, (1,))]


def test_resonances_elsewhere_are_another_plates() -> None:
    design = replace(DESIGN, frequency_hz=tuple(hz - 100.0 for hz in DESIGN.frequency_hz))
    assert not is_elsewhere(sweeps(), DESIGN)
    assert judge_search(sweeps(), DESIGN) is None
    finding = judge_search(sweeps(), design)
    assert finding is not None
    assert finding.causes == (Flaw.DIMENSIONS,)
    assert judge_search(sweeps(0.001 * SENSES), DESIGN) is None


def test_silence_everywhere_is_to_be_sought_elsewhere() -> None:
    assert is_elsewhere(sweeps(0.01 * SENSES), DESIGN)


def test_the_sign_of_a_loop_names_the_sensor_where_the_output_is_right() -> None:
    inverted = sweeps(np.diag((1.0, -1.0)) @ SENSES)
    assert judge_polarity(sweeps(), DESIGN, UNREAD).is_passed
    assert named(judge_polarity(inverted, DESIGN, RIGHT)) == [((Flaw.SENSOR_INVERTED,), (1,))]
    pair = (Flaw.SENSOR_INVERTED, Flaw.AMPLIFIER_INVERTED)
    assert named(judge_polarity(inverted, DESIGN, UNREAD)) == [(pair, (1,))]


def test_a_loop_without_a_resonance_has_no_sign() -> None:
    judgement = judge_polarity(sweeps(np.zeros((2, 2))), DESIGN, UNREAD)
    assert [finding.causes for finding in judgement.findings] == [(), ()]
