"""The friction curve: through its knots, monotone, and the same for one amplitude and for many."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.friction import DEFAULT_FRICTION_CURVE, FrictionCurve

CURVE = DEFAULT_FRICTION_CURVE


@pytest.mark.parametrize("friction", [1.0, 1.5, math.inf, math.nan])
def test_friction_one_is_still_glass_and_so_is_any_beyond_it(friction: float) -> None:
    assert CURVE.amplitude_um(friction) == 0.0


def test_a_calibration_sweep_becomes_a_curve() -> None:
    curve = FrictionCurve.from_amplitudes([0.0, 0.3, 0.9, 2.4])
    assert [curve.amplitude_um(f) for f in (1.0, 0.0)] == [0.0, 2.4]
    assert curve.amplitude_um(1 / 3) == pytest.approx(0.9)
    assert curve.friction(0.6) == pytest.approx(math.sqrt(curve.friction(0.3) * curve.friction(0.9)))


@given(st.lists(st.floats(0.001, 5), min_size=1, max_size=12), st.integers(0, 50))
def test_a_curve_goes_through_its_knots_and_stays_between_them(steps_um: list[float], n: int) -> None:
    amplitudes_um = [0.0]
    for step_um in steps_um:
        amplitudes_um.append(amplitudes_um[-1] + step_um)
    curve = FrictionCurve.from_amplitudes(amplitudes_um)
    for friction, amplitude_um in curve.knots:
        assert curve.amplitude_um(friction) == amplitude_um
    left, right = list(pairwise(curve.knots))[n % len(steps_um)]
    ends, middle_um = (curve.friction(left[1]), curve.friction(right[1])), (left[1] + right[1]) / 2
    assert curve.friction(middle_um) == pytest.approx(math.sqrt(math.prod(ends)))  # equally many just noticeable steps
    assert curve.decay_um(middle_um) == pytest.approx((left[1] - right[1]) / math.log(ends[1] / ends[0]))


@pytest.mark.parametrize(
    "knots",
    [
        (),
        ((1.0, 0.0),),
        ((0.0, 2.0), (1.0, 0.1)),
        ((0.1, 2.0), (1.0, 0.0)),
        ((0.0, 2.0), (0.9, 0.0)),
        ((0.0, 1.0), (0.5, 1.0), (1.0, 0.0)),
        ((0.0, 1.0), (0.5, 1.5), (1.0, 0.0)),
        ((0.0, 2.0), (0.5, 1.0), (0.5, 0.5), (1.0, 0.0)),
        ((0.0, math.inf), (1.0, 0.0)),
        ((0.0, 2.0), (math.nan, 1.0), (1.0, 0.0)),
    ],
)
def test_a_curve_that_is_not_monotone_from_the_most_to_still_glass_is_refused(
    knots: tuple[tuple[float, float], ...],
) -> None:
    with pytest.raises(ValueError, match="friction curve"):
        FrictionCurve(knots)


def test_friction_stays_at_its_floor_and_speed_matters_only_where_it_was_fitted() -> None:
    assert [CURVE.friction(um) for um in (0.0, 2.0, 5.0)] == pytest.approx(
        [1.0, math.exp(-2 / 0.7), math.exp(-2 / 0.7)]
    )
    assert CURVE.friction(1.0) == pytest.approx(math.exp(-1 / 0.7))
    assert CURVE.friction(1.0, 300.0) == CURVE.friction(1.0)


def test_the_curve_of_arrays_is_the_curve() -> None:
    curve = FrictionCurve.from_amplitudes((0.0, 0.4, 0.9, 2.0), floor_frac=0.2, speed_mm_s=100.0)
    amplitudes_um, sliding_mm_s = np.linspace(0.0, 3.0, 31), np.linspace(0.0, 200.0, 31)
    exact = [curve.friction(*one) for one in zip(amplitudes_um.tolist(), sliding_mm_s.tolist(), strict=True)]
    np.testing.assert_allclose(curve.frictions(amplitudes_um, sliding_mm_s), exact, rtol=1e-12)
