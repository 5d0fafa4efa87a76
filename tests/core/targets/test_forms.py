"""Forms as polylines: what they are worth, how far a drawn sine is off, and how many knots they need."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.targets.forms import Course
from hapticd.core.trajectory.gate import GRAIN_NS
from hapticd_contract.effects import Envelope, Form, Modulation, Pulse

WAVES = st.sampled_from(["sine", "square"])
MS = 1_000_000


def test_an_envelope_steps_where_two_points_have_one_instant_and_ends_with_a_step() -> None:
    course = Course(Envelope(((0.0, 1.0), (0.01, 1.0), (0.01, 3.0), (0.02, 3.0))), loops=False)
    around_ns = (-GRAIN_NS, 0, 10 * MS, 10 * MS + GRAIN_NS, 20 * MS, 20 * MS + GRAIN_NS)
    assert [course.value(t_ns) for t_ns in around_ns] == [0.0, 1.0, 1.0, 3.0, 3.0, 0.0]
    assert course.corners_ns(-MS, 30 * MS) == list(around_ns)


def test_a_modulation_is_cut_at_its_length() -> None:
    course = Course(Modulation(40.0, 1.0, length_s=0.0125), loops=False)
    end_ns = 12_500_000
    assert course.value(end_ns - GRAIN_NS) < 0.05
    assert course.value(end_ns) == 1.0
    assert course.corners_ns(11 * MS, 20 * MS) == [end_ns - GRAIN_NS, end_ns]


forms = st.one_of(
    st.builds(Pulse, st.floats(-4, 4), st.just(0.01), st.floats(0, 0.005)),
    st.builds(Pulse, st.floats(-4, 4), st.just(0.001), st.floats(0, 0.0005)),
    st.builds(Modulation, st.floats(1, 300), st.floats(0, 1), WAVES, st.none() | st.floats(0.001, 0.1)),
    st.lists(st.tuples(st.floats(0.0, 0.03), st.floats(0.0, 4.0)), min_size=1, max_size=12).map(
        lambda points: Envelope(((0.0, 1.0), *sorted(points), (0.04, 2.0)))
    ),
)


@given(forms, st.booleans(), st.integers(-5 * MS, 200 * MS), st.integers(1, 30 * MS))
def test_between_two_corners_every_form_is_straight(form: Form, loops: bool, from_ns: int, span_ns: int) -> None:
    course = Course(form, loops)
    if isinstance(form, Modulation):
        from_ns = max(from_ns, 0)  # a sine begins outside of the cosine, without a step
    corners_ns = course.corners_ns(from_ns, from_ns + span_ns)
    assert all(before < after for before, after in pairwise(corners_ns))
    assert all(corner_ns % GRAIN_NS == 0 and from_ns < corner_ns <= from_ns + span_ns for corner_ns in corners_ns)
    for left_ns, right_ns in pairwise([from_ns, *corners_ns, from_ns + span_ns]):
        ends = course.value(left_ns), course.value(right_ns)
        if right_ns - left_ns <= GRAIN_NS:
            continue  # within a grain a modulation that is cut steps
        middle_ns = (left_ns + right_ns) // 2
        share = (middle_ns - left_ns) / (right_ns - left_ns)
        straight = ends[0] + (ends[1] - ends[0]) * share
        assert math.isfinite(course.value(middle_ns))
        assert course.value(middle_ns) == pytest.approx(straight, abs=1e-6)
