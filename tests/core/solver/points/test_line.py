"""Still fingers that leave one direction: the closed form against the general path, digit by digit."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.core.solver.points.general import solve_fast, solve_general
from hapticd.core.solver.points.line import solve_line
from hapticd.core.solver.points.phase import solve_phased_fast

Rows = tuple[tuple[float, ...], ...]


def problem(seed: int, modes: int, slipping: int, reach: float) -> tuple[Rows, tuple[float, ...], tuple[float, ...]]:
    """One still finger less than modes, in any order among the slipping ones."""
    random = np.random.default_rng(seed)
    rows = random.uniform(-1, 1, (modes - 1 + slipping, modes))
    targets = random.permutation([0.0] * (modes - 1) + random.uniform(0.1, reach, slipping).tolist())
    return tuple(map(tuple, rows.tolist())), tuple(targets.tolist()), tuple(random.uniform(0.5, 4.0, modes).tolist())


problems = st.builds(
    problem, st.integers(0, 10**6), st.integers(1, 6), st.integers(1, 5), st.sampled_from([0.3, 2.0, 50.0])
)


@settings(max_examples=150)
@given(posed=problems, seed=st.integers(0, 10**6))
def test_it_is_the_general_paths_solution_on_the_side_of_the_previous_one(
    posed: tuple[Rows, tuple[float, ...], tuple[float, ...]], seed: int
) -> None:
    rows, targets, limits = posed
    previous = tuple(np.random.default_rng([seed, 1]).uniform(-1, 1, len(limits)).tolist())
    assert solve_line(rows, targets, limits) is not None
    modal, limited = solve_fast(rows, targets, limits, previous)
    expected, is_limited = solve_general(rows, targets, limits, previous)
    assert limited == is_limited
    assert modal == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert np.dot(modal, previous) >= 0.0
    assert all(abs(w) <= limit for w, limit in zip(modal, limits, strict=True))


@given(seed=st.integers(0, 10**6), exponent=st.floats(0.0, 9.0))
def test_however_near_to_each_other_still_fingers_are_they_feel_rounding_alone(seed: int, exponent: float) -> None:
    random = np.random.default_rng(seed)
    rows = random.uniform(-1, 1, (4, 3))
    rows[1] = rows[0] + 10.0**-exponent * random.uniform(-1, 1, 3)
    modal, _ = solve_fast(tuple(map(tuple, rows.tolist())), (0.0, 0.0, 1.0, 0.7), (4.0,) * 3)
    assert any(modal)
    with mpmath.workdps(40):
        for row in rows[:2].tolist():
            leak = abs(sum(mpmath.mpf(shape) * w for shape, w in zip(row, modal, strict=True)))
            assert leak <= 2e-15 * max(map(abs, modal))


def test_along_a_way_phasors_keep_their_common_phase_and_do_not_jump() -> None:
    """Two still fingers and three slipping ones on three modes, past places where limits bind."""
    random = np.random.default_rng(7)
    centre, swing = random.uniform(-1, 1, (2, 5, 3))
    targets, limits = (0.0, 1.0, 0.0, 1.0, 1.0), (1.0,) * 3
    previous: tuple[complex, ...] = (1j, 1j, 1j)
    bends = []
    for step in np.linspace(0.0, 6.0, 3000):
        rows = tuple(map(tuple, np.sin(3 * centre + swing * step).tolist()))
        modal, limited = solve_phased_fast(rows, targets, limits, previous)
        bends.append(limited)
        if any(previous) and step > 0.0:
            assert abs(np.vdot(previous, modal)) == pytest.approx(np.vdot(previous, modal).real)
            assert np.abs(np.array(modal) - np.array(previous)).max() < 0.2
        previous = modal
    assert any(bends)
    assert not all(bends)
