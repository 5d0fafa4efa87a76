"""A few fingers on up to three modes: as good as the general path, which enumerates patterns with decompositions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hapticd.core.solver.points.few_modes import MOST_SLIPPING, pose_few
from hapticd.core.solver.points.general import solve_fast, solve_general
from hapticd.core.solver.points.phase import solve_phased_fast

Rows = tuple[tuple[float, ...], ...]
SMALL_UM2 = 1e-10


def cost_um2(rows: Rows, targets: tuple[float, ...], modal: tuple[float, ...]) -> float:
    """Rule (3), and a millionth of a millionth of rule (4)."""
    missed = [abs(np.dot(row, modal)) - target for row, target in zip(rows, targets, strict=True) if target > 0.0]
    return float(np.dot(missed, missed) + 1e-12 * np.dot(modal, modal))


@settings(max_examples=200)
@given(
    seed=st.integers(0, 10**6),
    modes=st.integers(2, 3),
    still=st.integers(0, 1),
    slipping=st.integers(1, 5),
    reach=st.sampled_from([0.3, 3.0, 30.0]),
    squeeze=st.sampled_from([1.0, 1e-3, 1e-9, 0.0]),
)
@example(seed=150, modes=3, still=1, slipping=3, reach=3.0, squeeze=1.0)  # a pattern as good but for rounding
def test_no_pattern_of_the_general_path_is_better(
    seed: int, modes: int, still: int, slipping: int, reach: float, squeeze: float
) -> None:
    """Also where fingers all but coincide (`squeeze`), so that some directions move none of them."""
    random = np.random.default_rng(seed)
    shapes = random.uniform(-1, 1, (still + slipping, modes))
    shapes[still:] = shapes[-1] + squeeze * (shapes[still:] - shapes[-1])
    rows = tuple(map(tuple, shapes.tolist()))
    targets = (*[0.0] * still, *random.uniform(0.1, reach, slipping).tolist())
    limits = tuple(random.uniform(0.5, 4.0, modes).tolist())
    if still == modes - 1:
        return  # a line
    assert pose_few(rows, targets, limits) is not None
    modal, _ = solve_fast(rows, targets, limits)
    expected, _ = solve_general(rows, targets, limits)
    assert cost_um2(rows, targets, modal) <= cost_um2(rows, targets, expected) * (1.0 + 1e-9) + SMALL_UM2
    assert all(abs(w) <= limit for w, limit in zip(modal, limits, strict=True))
    for row in rows[:still]:
        assert abs(np.dot(row, modal)) <= 2e-15 * max(map(abs, modal))


@settings(max_examples=60)
@given(seed=st.integers(0, 10**6), still=st.integers(0, 1), slipping=st.integers(1, 2))
def test_what_limits_leave_alone_is_met_to_the_last_digits_with_the_least_amplitudes(
    seed: int, still: int, slipping: int
) -> None:
    random = np.random.default_rng(seed)
    shapes = random.uniform(-1, 1, (still + slipping, 3))
    target_um = np.array([0.0] * still + [1.0] * slipping)
    modal, limited = solve_fast(tuple(map(tuple, shapes.tolist())), tuple(target_um.tolist()), (1e2,) * 3)
    if np.linalg.cond(shapes) > 20.0:
        return
    assert not limited
    assert np.abs(shapes @ modal) == pytest.approx(target_um, rel=1e-12, abs=1e-12)
    squares = []
    for signs in ((1.0, 1.0), (1.0, -1.0)):
        wanted = target_um * np.array([1.0] * still + list(signs[:slipping]))
        squares.append(float(np.sum(np.linalg.lstsq(shapes, wanted)[0] ** 2)))
    assert float(np.dot(modal, modal)) == pytest.approx(min(squares), rel=1e-8)


def test_more_fingers_more_modes_and_numbers_out_of_the_ordinary_are_left_to_the_general_path() -> None:
    row = (0.3, 0.8, -0.2)
    assert pose_few((row,), (1.0,), (4.0,) * 3) is not None
    assert pose_few((row,) * (MOST_SLIPPING + 1), (1.0,) * (MOST_SLIPPING + 1), (4.0,) * 3) is None
    assert pose_few(((*row, 0.1),), (1.0,), (4.0,) * 4) is None
    assert pose_few((row,), (0.0,), (4.0,) * 3) is None
    for extreme in ((1e-300,) * 3, (1e300,) * 3, (math.nan,) * 3):
        assert pose_few((extreme,), (1.0,), (4.0,) * 3) is None
    assert pose_few((row,), (1e9,), (4.0,) * 3) is None
    assert pose_few((row,), (1.0,), (4.0, 4.0, 1e-6)) is None


def test_fingers_at_all_but_one_place_are_not_damped_less_than_the_limits_allow() -> None:
    """Without damping the difference of their shapes, a millionth, would take more than a limit."""
    rows = (
        (-0.3654898331191032, 0.1720563418981811, -0.08072647975597591),
        (-0.3654914372577771, 0.17205634190059169, -0.08072648166832604),
    )
    modal, limited = solve_fast(rows, (1.0, 1.0), (4.0,) * 3)
    assert [abs(np.dot(row, modal)) for row in rows] == pytest.approx([1.0, 1.0], abs=1e-5)
    assert not limited


@pytest.mark.parametrize("target_um", [(1.0, 1.0, 1.0), (0.0, 1.0, 1.0)])
def test_along_a_way_a_change_of_pattern_is_a_turn_that_no_finger_feels(target_um: tuple[float, ...]) -> None:
    """Smooth ways past limits: where these bind nothing, no finger gets less midway between two steps."""
    random = np.random.default_rng(5)
    centre, swing = random.uniform(-1, 1, (2, 3, 3))
    previous: tuple[complex, ...] = (0j,) * 3
    least_um, turned = 1.0, False
    for step in np.linspace(0.0, 8.0, 4000):
        shapes = 0.8 * np.eye(3) + 0.7 * np.sin(3 * centre + swing * step)
        modal, limited = solve_phased_fast(tuple(map(tuple, shapes.tolist())), target_um, (2.0,) * 3, previous)
        if any(previous) and not limited:
            midway_um = np.abs(shapes @ (np.array(modal) + np.array(previous)) / 2)
            least_um = min(least_um, float(midway_um[np.array(target_um) > 0.0].min()))
        turned = turned or abs((modal[0] * modal[1].conjugate()).imag) > 1e-3
        previous = modal
    assert least_um > 0.9
    assert turned
