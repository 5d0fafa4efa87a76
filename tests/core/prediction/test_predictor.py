"""Properties of every predictor: names and settings, hostile samples, origins of time, bounds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.bench.baselines import PREDICTORS, make_predictor
from hapticd.core.prediction import DEFAULTS, Predictor
from hapticd.core.prediction.motion import MAX_ACCELERATION_MM_S2, MAX_SPEED_MM_S

PERIOD_NS = 11_250_000
AHEAD_NS = 15_000_000

every_predictor = pytest.mark.parametrize("name", PREDICTORS)
Touch = list[tuple[int, float, float]]


def slide(seed: int = 3) -> Touch:
    """A noisy slide with a bend; stamps jittered, from 0 ns."""
    rng = np.random.default_rng(seed)
    touch = []
    for k in range(60):
        t_s = k * PERIOD_NS * 1e-9
        x, y = 120.0 * t_s - 40.0, 8.0 * math.sin(5.0 * t_s)
        x, y = x + 0.05 * rng.standard_normal(), y + 0.05 * rng.standard_normal()
        touch.append((k * PERIOD_NS + int(rng.integers(-1_000_000, 1_000_000)), x, y))
    return touch


TOUCH = slide()
END_NS = TOUCH[-1][0]


def fed(touch: Touch, name: str = "default", to: Predictor | None = None) -> Predictor:
    predictor = make_predictor(name) if to is None else to
    for sample in touch:
        predictor.update(*sample)
    return predictor


def test_an_unknown_name_or_setting_is_refused_with_the_known_ones() -> None:
    for call, known in ((lambda: make_predictor("kalman"), PREDICTORS), (lambda: make_predictor(noise=1.0), DEFAULTS)):
        with pytest.raises(ValueError, match=r"choose from") as refusal:
            call()
        assert all(name in str(refusal.value) for name in known)


@pytest.mark.parametrize("setting", DEFAULTS)
def test_every_setting_refuses_values_out_of_its_range(setting: str) -> None:
    for wrong in (math.nan, math.inf, -1.0, 1e15, "1", None):
        with pytest.raises(ValueError, match=rf"{setting}.*give a number from"):
            make_predictor(**{setting: wrong})  # type: ignore[arg-type]


@every_predictor
def test_a_reset_predictor_is_like_a_new_one(name: str) -> None:
    predictor = fed(slide(seed=1), name)
    predictor.reset()
    assert all(map(math.isnan, predictor.predict(0)))
    assert fed(TOUCH, to=predictor).predict(END_NS + AHEAD_NS) == fed(TOUCH, name).predict(END_NS + AHEAD_NS)


@every_predictor
@pytest.mark.parametrize("origin_ns", [10**9, 2**53, 2**62, -(2**40) - 1])
def test_the_origin_of_time_does_not_matter_to_the_last_bit(name: str, origin_ns: int) -> None:
    here, there = make_predictor(name), make_predictor(name)
    for t_ns, x, y in TOUCH:
        here.update(t_ns, x, y)
        there.update(origin_ns + t_ns, x, y)
        for ahead_ns in (-1, 0, 7_000_001, 50_000_000):
            assert here.predict(t_ns + ahead_ns) == there.predict(origin_ns + t_ns + ahead_ns)


NOWHERE = (math.nan, math.inf, -math.inf, 1e300)


@every_predictor
@pytest.mark.parametrize(
    "ignored",
    [
        *([(END_NS + PERIOD_NS, wrong, 0.0), (END_NS + PERIOD_NS, 0.0, wrong)] for wrong in NOWHERE),
        *([(END_NS - back_ns, 0.0, 0.0)] for back_ns in (0, 1, PERIOD_NS, 10**10)),
    ],
)
def test_an_invalid_position_or_a_stamp_that_does_not_increase_is_ignored(name: str, ignored: Touch) -> None:
    predictor = fed([(TOUCH[0][0] - 1, math.nan, 0.0), *TOUCH, *ignored], name)
    assert predictor.predict(END_NS + AHEAD_NS) == fed(TOUCH, name).predict(END_NS + AHEAD_NS)


@every_predictor
@pytest.mark.parametrize("silence_ns", [70_000_000, 10**10, 2**62])
def test_after_a_long_silence_the_motion_restarts(name: str, silence_ns: int) -> None:
    predictor = fed([*TOUCH, (END_NS + silence_ns, -30.0, 20.0)], name)
    assert predictor.predict(END_NS + silence_ns + AHEAD_NS) == (-30.0, 20.0)


@every_predictor
def test_a_stale_duplicate_is_dropped_from_the_motion_and_from_the_clock(name: str) -> None:
    """Touchpads repeat a report some 6 ms after it; the next one has moved two steps."""
    t_ns, x, y = TOUCH[40]
    with_duplicate = [*TOUCH[:41], (t_ns + 6_000_000, x, y), *TOUCH[42:]]
    without = [*TOUCH[:41], *TOUCH[42:]]
    for k in range(41, len(without)):
        t_ns = without[k][0] + AHEAD_NS
        assert fed(with_duplicate[: k + 2], name).predict(t_ns) == fed(without[: k + 1], name).predict(t_ns)


def test_a_finger_that_stops_abruptly_is_detected_at_the_second_equal_sample() -> None:
    touch = [(k * PERIOD_NS, 2.0 * k, 0.0) for k in range(20)]
    held = [*touch, *((k * PERIOD_NS, touch[-1][1], 0.0) for k in range(20, 24))]
    ahead_mm = [
        fed(held[:count]).predict(held[count - 1][0] + AHEAD_NS)[0] - fed(held[:count]).predict(held[count - 1][0])[0]
        for count in (21, 24)
    ]
    assert ahead_mm[0] > 2.0
    assert abs(ahead_mm[1]) < 0.3


@every_predictor
def test_the_past_is_the_last_position_and_the_far_future_is_50_ms_ahead(name: str) -> None:
    predictor = fed(TOUCH, name)
    assert predictor.predict(END_NS - 10**9) == predictor.predict(END_NS - 2_000_000)
    assert math.dist(predictor.predict(END_NS - 10**9), TOUCH[-1][1:]) < 1.0
    assert predictor.predict(END_NS + 60_000_000) == predictor.predict(END_NS + 10**12)


gaps_ns = st.one_of(st.integers(-(10**6), 10**6), st.integers(8_000_000, 14_000_000), st.integers(0, 10**10))
places_mm = st.one_of(st.floats(-80.0, 80.0), st.floats(-1e6, 1e6), st.floats())


@every_predictor
@settings(max_examples=60)
@given(samples=st.lists(st.tuples(gaps_ns, places_mm, places_mm), min_size=1, max_size=30))
def test_for_any_samples_predictions_are_within_reach_and_a_covariance_is_one(
    name: str, samples: list[tuple[int, float, float]]
) -> None:
    predictor, t_ns = fed([(0, 1.0, 2.0)], name), 0
    for gap_ns, x, y in samples:
        t_ns += gap_ns
        predictor.update(t_ns, x, y)
    start = predictor.predict(-(10**18))
    for ahead_ns in (0, 15_000_000, 50_000_000):
        predicted = predictor.predict(t_ns + ahead_ns)
        assert all(map(math.isfinite, predicted))
        farthest_mm = 0.05 * MAX_SPEED_MM_S + 0.5 * 0.05**2 * MAX_ACCELERATION_MM_S2
        assert math.dist(predicted, start) <= farthest_mm + 1e-9 * math.hypot(*start)
        xx, xy, yy = predictor.covariance(t_ns + ahead_ns)
        assert name != "default" or (xx > 0.0 and yy > 0.0 and xx * yy - xy * xy >= -1e-9 * xx * yy)
