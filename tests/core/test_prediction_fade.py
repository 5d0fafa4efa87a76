"""The cross-fade: continuous where predictions change, gone when it ends, and never farther than the correction."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.prediction import make_predictor
from hapticd.core.prediction_fade import CrossFade

FADE_NS = 2_000_000
instants_ns = st.integers(-(2**62), 2**62)
places_mm = st.floats(-1e3, 1e3)


def test_without_a_prediction_before_it_a_prediction_is_taken_as_it_is() -> None:
    fade = CrossFade(FADE_NS)
    assert fade.blend(5, 1.0, 2.0) == (1.0, 2.0)
    assert fade.ends_ns is None


@given(instants_ns, places_mm, places_mm, places_mm, places_mm)
def test_a_blend_begins_where_the_old_one_was_and_ends_at_the_new_one(
    t_ns: int, was_x_mm: float, was_y_mm: float, x_mm: float, y_mm: float
) -> None:
    fade = CrossFade(FADE_NS)
    fade.turn(t_ns, (was_x_mm, was_y_mm), (x_mm, y_mm))
    assert fade.blend(t_ns, x_mm, y_mm) == pytest.approx((was_x_mm, was_y_mm), abs=1e-9)
    assert fade.blend(t_ns + FADE_NS // 2, x_mm, y_mm) == pytest.approx(
        ((was_x_mm + x_mm) / 2, (was_y_mm + y_mm) / 2), abs=1e-9
    )
    assert fade.ends_ns == t_ns + FADE_NS
    for later_ns in (FADE_NS, FADE_NS + 1, 2**62):
        assert fade.blend(t_ns + later_ns, x_mm, y_mm) == (x_mm, y_mm)


@given(st.integers(-(10**9), 10**9), places_mm)
def test_a_blend_is_never_farther_from_the_new_prediction_than_the_old_one_was(after_ns: int, was_mm: float) -> None:
    fade = CrossFade(FADE_NS)
    fade.turn(0, (was_mm, 0.0), (1.0, 0.0))
    x_mm, _ = fade.blend(after_ns, 1.0, 0.0)
    assert abs(x_mm - 1.0) <= abs(was_mm - 1.0) + 1e-9


def test_no_fade_is_the_new_prediction_at_once() -> None:
    fade = CrossFade(0)
    fade.turn(10, (5.0, 5.0), (1.0, 2.0))
    assert fade.blend(10, 1.0, 2.0) == (1.0, 2.0)


def test_reset_forgets_the_correction() -> None:
    fade = CrossFade(FADE_NS)
    fade.turn(0, (5.0, 5.0), (1.0, 2.0))
    fade.reset()
    assert fade.blend(0, 1.0, 2.0) == (1.0, 2.0)


@pytest.mark.parametrize("fade_ns", [-1, 50_000_001])
def test_a_fade_out_of_bounds_is_refused_in_a_sentence(fade_ns: int) -> None:
    with pytest.raises(ValueError, match=r"cross-fade .* give 0 to"):
        CrossFade(fade_ns)


def test_a_reference_led_over_at_each_new_sample_has_no_step() -> None:
    """As the pipeline would call it: each report is followed by a polyline from 6 ms after it on."""
    period_ns, apply_ns, step_ns = 11_250_000, 6_000_000, 10_000

    def largest_step_mm(fade_ns: int) -> float:
        predictor, fade = make_predictor(), CrossFade(fade_ns)
        path_mm: list[tuple[float, float]] = []
        for k in range(40):
            t_apply_ns = k * period_ns + apply_ns
            was_mm = fade.blend(t_apply_ns, *predictor.predict(t_apply_ns))
            predictor.update(k * period_ns, 0.9 * k + 0.1 * math.sin(7.0 * k * k), 0.1 * math.cos(5.0 * k * k))
            if k > 0:
                fade.turn(t_apply_ns, was_mm, predictor.predict(t_apply_ns))
            knots_ns = range(t_apply_ns, t_apply_ns + period_ns, step_ns)
            path_mm += [fade.blend(t_ns, *predictor.predict(t_ns)) for t_ns in knots_ns]
        return max(math.dist(a, b) for a, b in pairwise(path_mm))

    assert largest_step_mm(FADE_NS) < 0.01 < 0.1 < largest_step_mm(0)
