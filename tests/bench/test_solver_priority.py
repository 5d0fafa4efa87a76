"""`priority`: one finger after the other, against linear programmes that serve them in the same order."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from hapticd.core.solver.public import solve

Array = npt.NDArray[np.float64]


def reachable(phi: Array, served: Array, row: Array, limit: float) -> tuple[float, float]:
    """The least and greatest amplitude of a finger while those before it keep theirs."""
    equal = {"A_eq": phi[: len(served)], "b_eq": served} if len(served) else {}
    ends = [linprog(sign * row, bounds=[(-limit, limit)] * len(row), **equal).fun for sign in (1.0, -1.0)]
    return ends[0], -ends[1]


def served_in_order(phi: Array, target_um: Array, limit: float, served: tuple[float, ...] = ()) -> tuple[float, ...]:
    """An oracle: the amplitudes' misses, least in the order of the rows, over every choice of signs that ties."""
    index = len(served)
    if index == len(phi):
        return ()
    low, high = reachable(phi, np.array(served), phi[index], limit)
    values = {min(max(sign * target_um[index], low), high) for sign in (1.0, -1.0)}
    missed = {value: abs(abs(value) - target_um[index]) for value in values}
    best = [value for value in values if missed[value] <= min(missed.values()) + 1e-9]
    rests = [served_in_order(phi, target_um, limit, (*served, value)) for value in best]
    return (min(missed.values()), *min(rests))


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 10**6), modes=st.integers(1, 5), data=st.data())
def test_each_finger_gets_the_nearest_that_those_before_it_leave(seed: int, modes: int, data: st.DataObject) -> None:
    fingers = data.draw(st.integers(1, modes))
    random = np.random.default_rng(seed)
    phi = random.uniform(-1, 1, (fingers, modes))
    target_um = random.uniform(0.2, 6.0, fingers) * (random.random(fingers) < 0.7)
    solution = solve(phi, target_um, 1.5, policy="priority")
    assert np.all(np.abs(solution.modal_um) <= 1.5)
    missed = np.abs(solution.achieved_um - target_um)
    assert missed == pytest.approx(served_in_order(phi, target_um, 1.5), abs=1e-7)


def test_the_order_of_the_rows_is_the_order_of_the_fingers() -> None:
    phi, target_um = np.array([[0.8, 0.75], [0.8, 0.7]]), np.array([1.0, 0.0])
    slips_first = solve(phi, target_um, 4.0, policy="priority").achieved_um
    still_first = solve(phi[::-1], target_um[::-1], 4.0, policy="priority")
    assert slips_first[0] == pytest.approx(1.0)
    assert slips_first[1] > 0.1
    assert still_first.achieved_um[0] < 1e-14
    assert still_first.achieved_um[1] == pytest.approx(solve(phi, target_um, 4.0).achieved_um[0])
    assert still_first.limited


@pytest.mark.parametrize("modes", [1, 2, 3])
def test_what_the_order_leaves_free_goes_to_the_least_amplitude_nearest_the_present_one(modes: int) -> None:
    row = np.array([0.6, 0.8, -0.3])[:modes]
    least = solve([row], [0.5], 4.0).modal_um
    assert solve([row], [0.5], 4.0, policy="priority").modal_um == pytest.approx(least)
    again = solve([row], [0.5], 4.0, policy="priority", previous_um=-least).modal_um
    assert again == pytest.approx(-least)


@pytest.mark.parametrize("modes", [2, 4])
def test_a_finger_on_a_finger_or_on_a_node_takes_nothing_from_the_rest(modes: int) -> None:
    rows = np.random.default_rng(modes).uniform(-1, 1, (2, modes))
    plain = solve(rows, [1.0, 0.3], 4.0, policy="priority").modal_um
    crowded = np.vstack([np.zeros(modes), rows[:1], rows[:1], rows[1:], -rows[:1]])
    assert solve(crowded, [1.0, 1.0, 7.0, 0.3, 0.0], 4.0, policy="priority").modal_um == pytest.approx(plain, abs=1e-12)


def test_two_modes_and_a_third_that_moves_no_finger_agree() -> None:
    random = np.random.default_rng(8)
    for _ in range(40):
        fingers = int(random.integers(1, 5))
        phi, target_um = random.uniform(-1, 1, (fingers, 2)), random.uniform(0.0, 5.0, fingers)
        plane = solve(phi, target_um, [4.0, 2.0], policy="priority")
        space = solve(np.column_stack([phi, np.zeros(fingers)]), target_um, [4.0, 2.0, 1.0], policy="priority")
        assert space.achieved_um == pytest.approx(plane.achieved_um, abs=1e-9)
        assert space.limited == plane.limited
