"""The measure on runs whose figures are known by hand."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

from hapticd.sim.score import SETTLE_S, Score, score, settled
from hapticd.sim.world_errors import WorldErrors

T_S = (np.arange(2000) + 1) / 2000.0
SETTLE_TICKS = 200


def judge(target_um: np.ndarray, truth_um: np.ndarray, plate_um: np.ndarray | None = None, **person: Any) -> Score:
    """The score of fingers that slide at 100 mm/s on a plate whose one mode is 1 everywhere."""
    slide_mm = np.stack((100.0 * T_S, np.zeros(len(T_S))), axis=1)
    finger_mm = np.stack([slide_mm] * target_um.shape[1], axis=1)
    plate_um = np.zeros(len(T_S)) if plate_um is None else plate_um
    return score(
        *(T_S, finger_mm, target_um, truth_um + 0j, plate_um[:, None] + 0j),
        lambda places_mm: np.ones((*places_mm.shape[:-1], 1)),
        reference_um=np.zeros((len(T_S), 2), dtype=np.complex128),
        limited=np.zeros(len(T_S), dtype=bool),
        **person,
    )


def constant(*values: float) -> np.ndarray:
    return np.tile(values, (len(T_S), 1))


def test_leak_is_a_root_mean_square_and_over_all_still_fingers() -> None:
    truth_um = constant(0.3, 0.1)
    truth_um[::2, 0] = 0.0

    leak_um = judge(constant(0.0, 0.0), truth_um).leak_um

    assert leak_um == pytest.approx(math.sqrt((0.3**2 / 2 + 0.1**2) / 2))


def test_slip_counts_the_others_and_neither_sign_nor_phase() -> None:
    judged = judge(constant(1.0, 2.0, 0.0), constant(-0.8, 2.4j, 0.5))

    assert judged.slip_error_um == pytest.approx(math.sqrt((0.2**2 + 0.4**2) / 2))
    assert judged.slip_frac == pytest.approx((0.8 + 1.2) / 2)
    assert judged.leak_um == pytest.approx(0.5)


def test_a_finger_counts_from_a_tenth_of_a_second_after_it_landed() -> None:
    target_um = constant(0.0)
    target_um[:500] = np.nan

    counts = settled(T_S, target_um)[:, 0]

    assert round(SETTLE_S * 2000) == SETTLE_TICKS
    assert np.flatnonzero(counts)[0] == 500 + SETTLE_TICKS
    assert counts[500 + SETTLE_TICKS :].all()


def test_without_fingers_figures_are_nan() -> None:
    judged = judge(constant(np.nan, np.nan), constant(np.nan, np.nan))

    figures = {name: value for name, value in asdict(judged).items() if name != "fingers"}
    assert [name for name, value in figures.items() if math.isnan(value)] == [
        "leak_um",
        "slip_error_um",
        "slip_frac",
        *("contact_leak_um", "contact_slip_um", "contrast"),
        *("felt_frac", "within_two_frac", "limit_frac"),
    ]
    assert judged.limited_frac == 0.0


def perceived(target_um: np.ndarray, plate_um: np.ndarray, **person: Any) -> Score:
    return judge(target_um, np.zeros(target_um.shape), plate_um, **person)


def test_friction_is_judged_relative_to_what_was_asked_of_each_finger() -> None:
    judged = perceived(constant(0.0, 1.0, np.nan), constant(0.7)[:, 0])

    sticky, slippery, absent = judged.fingers
    assert sticky.bias_jnd == pytest.approx((math.exp(-1.0) - 1.0) / 0.11)
    assert slippery.bias_jnd == pytest.approx((math.exp(1 / 0.7 - 1.0) - 1.0) / 0.11)
    assert all(map(math.isnan, asdict(absent).values()))


def test_an_amplitude_asks_for_what_it_gives_this_person_and_a_friction_for_itself() -> None:
    target_um, plate_um = constant(0.0, 0.8), constant(0.8)[:, 0]
    person: dict[str, Any] = {"gains": WorldErrors(friction_factor=1.25).amplitude_gains}

    _, amplitude = perceived(target_um, plate_um, **person).fingers
    sticky, friction = perceived(target_um, plate_um, **person, friction_targets=True).fingers

    assert amplitude.bias_jnd == pytest.approx(0.0, abs=1e-9)
    assert friction.bias_jnd == pytest.approx((math.exp(-0.2 / 0.7) - 1.0) / 0.11)
    assert sticky.bias_jnd == pytest.approx((math.exp(-1.0 / 0.7) - 1.0) / 0.11)
    fits = perceived(target_um, 0.8 * plate_um, **person, friction_targets=True)
    assert fits.fingers[1].error_95_jnd == pytest.approx(0.0, abs=1e-9)


def test_time_counts_as_felt_where_every_finger_is_within_the_weber_fraction() -> None:
    # 0.05 um is 7 % less friction, 0.1 um is 13 %: felt; 1 um asked and 0.95 um given is 7 % more
    moving_um = np.where(T_S < 0.4, 0.05, np.where(T_S < 0.7, 0.1, 0.95))

    alone = perceived(constant(0.0, np.nan), moving_um)
    assert alone.felt_frac == pytest.approx((0.4 - SETTLE_S) / (1.0 - SETTLE_S), abs=0.005)
    both = perceived(constant(0.0, 1.0), moving_um)
    assert both.felt_frac == 0.0  # never both at once
    assert perceived(constant(0.05, 0.1), constant(0.05)[:, 0]).felt_frac == 1.0
    assert math.isnan(perceived(constant(np.nan), moving_um).felt_frac)


def test_a_finger_s_error_is_in_jnd_and_has_a_median_and_a_tail() -> None:
    moving_um = np.where(T_S < 0.8, 0.05, 0.1)

    (finger,) = perceived(constant(0.0), moving_um).fingers

    assert finger.median_jnd == pytest.approx((1.0 - math.exp(-0.05 / 0.7)) / 0.11)
    assert finger.error_95_jnd == pytest.approx((1.0 - math.exp(-0.1 / 0.7)) / 0.11)
    assert finger.felt_frac == pytest.approx((0.8 - SETTLE_S) / (1.0 - SETTLE_S), abs=0.005)
    assert finger.within_two_frac == 1.0
