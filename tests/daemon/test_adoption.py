"""Adoption of what touches show: where it ends, and that no step on the way moves a finger noticeably."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.config.sections import UncertaintyConfig
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.daemon.adoption import (
    FARTHEST_MM,
    FIRST_SHARE,
    NOTHING,
    STEP_MM,
    STEP_NS,
    AdoptedPad,
    Adoption,
    Correction,
    Evidence,
    PlateChange,
    Trust,
    Unknown,
    shapes_of,
)
from hapticd.values import AffineMap

CONFIGURED = AdoptedPad(AffineMap.from_placement((2.0, -1.0), 90.0, (1.01, 0.99)), 10_000_000)
MISPLACED = Correction((1.001, -0.004, 0.004, 0.999), (0.4, -0.3), 0.003)


def adopted(adoption: Adoption) -> list[AdoptedPad]:
    """All steps until none is due."""
    pads = []
    while (pad := adoption.step()) is not None:
        pads.append(pad)
    return pads


def test_a_correction_applies_after_the_pad_it_was_found_with() -> None:
    corrected = MISPLACED.of(CONFIGURED)
    x_mm, y_mm = CONFIGURED.plate_from_pad.apply(30.0, -20.0)
    expected_mm = (1.001 * x_mm - 0.004 * y_mm + 0.4, 0.004 * x_mm + 0.999 * y_mm - 0.3)
    assert corrected.plate_from_pad.apply(30.0, -20.0) == pytest.approx(expected_mm)
    assert corrected.latency_ns == 13_000_000


small = st.floats(-0.01, 0.01)
shift = st.floats(-1.0, 1.0)


@given(small, small, small, small, shift, shift, st.floats(-0.005, 0.005))
def test_no_step_moves_a_finger_by_more_than_the_bound_and_the_last_is_the_corrected_pad(
    xx: float, xy: float, yx: float, yy: float, x_mm: float, y_mm: float, latency_s: float
) -> None:
    correction = Correction((1.0 + xx, xy, yx, 1.0 + yy), (x_mm, y_mm), latency_s)
    adoption = Adoption.of(CONFIGURED)
    if not adoption.request(correction):
        assert correction.of(CONFIGURED).distance_mm(CONFIGURED) > FARTHEST_MM
        return
    pads = adopted(adoption)
    for before, after in zip([CONFIGURED, *pads], pads, strict=False):
        assert before.distance_mm(after) <= STEP_MM * (1.0 + 1e-6)
        assert abs(after.latency_ns - before.latency_ns) <= STEP_NS + 1
    assert not adoption.is_moving
    assert adoption.now == (pads[-1] if pads else CONFIGURED)
    assert adoption.now.distance_mm(correction.of(CONFIGURED)) < 1e-9


@pytest.mark.parametrize(
    "correction",
    [
        Correction((1.0, 0.0, 0.0, 1.0), (5.0, 0.0), 0.0),
        Correction((1.0, 0.0, 0.0, 1.0), (0.0, 0.0), 0.02),
        Correction((math.nan, 0.0, 0.0, 1.0), (0.0, 0.0), 0.0),
        Correction((1.0, 0.0, 0.0, 1.0), (math.inf, 0.0), 0.0),
    ],
)
def test_a_correction_far_from_the_configured_pad_is_refused(correction: Correction) -> None:
    adoption = Adoption.of(CONFIGURED)
    assert not adoption.request(correction)
    assert not adoption.is_moving
    assert adoption.now == CONFIGURED


GRID_MM = np.linspace(-50.0, 50.0, 12)
SCANNED = ModeShapes(GRID_MM, GRID_MM, [np.sin(GRID_MM / 9.0)[None, :] * np.cos(GRID_MM / 8.0)[:, None]] * 2)


RIGHT = (1.0, 0.0, 0.0, 1.0)
CONFIGURED_UNKNOWN = UncertaintyConfig(map_frac=0.04, touched_map_frac=0.03, sensors_frac=0.02)
KNOWN = Unknown(0.01, (-40.0, -40.0, 40.0, 40.0), 0.005)


@pytest.mark.parametrize(
    ("factor", "steeper", "d", "is_near"),
    [
        (1.0, 1.0, RIGHT, True),
        (1.2, 1.2, RIGHT, True),
        (1.4, 1.0, RIGHT, False),
        (math.nan, 1.0, RIGHT, False),
        (1.0, 2.0, RIGHT, False),
        (1.0, 0.0, RIGHT, False),
        (1.0, math.nan, RIGHT, False),
        (1.0, 1.0, (1.1, 0.05, 0.0, 1.0), True),
        (1.0, 1.0, (1.3, 0.0, 0.0, 1.0), False),
        (1.0, 1.0, (math.nan, 0.0, 0.0, 1.0), False),
    ],
)
def test_only_a_plate_like_the_scanned_one_is_near(
    factor: float, steeper: float, d: tuple[float, ...], is_near: bool
) -> None:
    data = (factor * SCANNED.shapes).astype("<f4").tobytes()
    assert PlateChange(data, steeper * SCANNED.steepest_1_mm(), d, (0.0,) * 4, KNOWN).is_near(SCANNED) is is_near


def test_a_map_on_another_grid_is_none_and_so_are_other_sensors() -> None:
    data = SCANNED.shapes.astype("<f4").tobytes()
    for change in (
        PlateChange(bytes(40), 1.0, RIGHT, (0.0,) * 4, KNOWN),
        PlateChange(data, 1.0, (1.0,), (0.0,), KNOWN),
    ):
        with pytest.raises(ValueError, match="reshape"):
            change.is_near(SCANNED)


def test_half_of_a_plate_is_half_way_from_the_scanned_one() -> None:
    exact = (1.0, 0.0, 0.0, 1.0)
    found = PlateChange(
        (1.2 * SCANNED.shapes).astype("<f4").tobytes(), 1.2 * SCANNED.steepest_1_mm(), exact, (0.2,) * 4, KNOWN
    )
    half = found.part(0.5, SCANNED, CONFIGURED_UNKNOWN)
    assert shapes_of(half.shapes, SCANNED) == pytest.approx(1.1 * SCANNED.shapes, rel=1e-6)
    assert half.steepest_1_mm == pytest.approx(1.1 * SCANNED.steepest_1_mm())
    assert half.readings(2) == pytest.approx(np.eye(2) + 0.1j)
    none = PlateChange.none(SCANNED, CONFIGURED_UNKNOWN)
    assert shapes_of(none.shapes, SCANNED) == pytest.approx(SCANNED.shapes, rel=1e-6)
    assert none.readings(2) == pytest.approx(np.eye(2))
    assert none.is_near(SCANNED)
    assert none.unknown == Unknown(0.03, (), 0.02)


def test_what_is_not_adopted_of_a_change_stays_as_unknown_as_it_was() -> None:
    assert KNOWN.part(1.0, CONFIGURED_UNKNOWN) == KNOWN
    half = KNOWN.part(0.5, CONFIGURED_UNKNOWN)
    assert half == (pytest.approx(math.hypot(0.005, 0.02)), KNOWN.touched_mm, pytest.approx(math.hypot(0.0025, 0.01)))


def test_half_of_a_correction_moves_half_as_far() -> None:
    assert MISPLACED.part(0.5) == Correction((1.0005, -0.002, 0.002, 0.9995), (0.2, -0.15), 0.0015)
    assert MISPLACED.part(0.0) == NOTHING


def test_half_is_adopted_until_later_touches_confirm_it_and_nothing_once_they_speak_against_it() -> None:
    trust, change = Trust(), PlateChange.none(SCANNED, CONFIGURED_UNKNOWN)
    assert not trust.take(Evidence.NONE, None, None)
    assert trust.take(Evidence.NONE, MISPLACED, change)
    assert (trust.share, trust.correction, trust.change) == (FIRST_SHARE, MISPLACED, change)
    assert not trust.take(Evidence.NONE, None, None)
    assert trust.take(Evidence.BETTER, None, None)  # what was found before, in full
    assert (trust.share, trust.correction, trust.change) == (1.0, MISPLACED, change)
    assert not trust.take(Evidence.BETTER, None, None)
    nearer = MISPLACED.part(0.9)
    assert trust.take(Evidence.BETTER, nearer, None)
    assert (trust.correction, trust.change) == (nearer, change)
    assert trust.take(Evidence.WORSE, MISPLACED, change)  # what the same touches found does not count
    assert (trust.share, trust.correction, trust.change) == (FIRST_SHARE, NOTHING, None)
