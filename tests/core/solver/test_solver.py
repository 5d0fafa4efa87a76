"""The order of keep_zero, on one and two modes, and the public edge."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from hapticd.core.solver.plane import common_direction, slide_on_line
from hapticd.core.solver.policies import POLICIES
from hapticd.core.solver.public import condition_number, solve, solve_batch, solve_fast

Array = npt.NDArray[np.float64]
LIMIT_UM = 4.0
shape = st.floats(-1.0, 1.0, allow_subnormal=False)
amplitude = st.floats(0.05, 6.0)
row = st.tuples(shape, shape)


def error(phi: Array, target_um: Array, modal_um: Array, effort: float = 0.0) -> float:
    slipping = target_um > 0.0
    missed = np.abs(phi[slipping] @ modal_um) - target_um[slipping]
    return float(missed @ missed + effort * modal_um @ modal_um)


def best_error_in_box(phi: Array, target_um: Array, limit_um: Array, effort: float) -> float:
    """An oracle: bounded-variable least squares for every sign pattern."""
    modes = phi.shape[1]
    rows = np.vstack([phi, math.sqrt(effort) * np.eye(modes)])
    errors = []
    for signs in itertools.product((1.0, -1.0), repeat=len(phi) - 1):
        wanted = np.concatenate([np.array([1.0, *signs]) * target_um, np.zeros(modes)])
        found = lsq_linear(rows, wanted, (-limit_um, limit_um), method="bvls", tol=1e-14).x
        errors.append(error(phi, target_um, found, effort))
    return min(errors)


# --- one finger still, one slipping: the paper's case -------------------------------------------------------------


def test_within_the_limits_it_is_the_papers_inverse() -> None:
    phi = np.array([[0.8, -0.3], [0.2, 0.7]])
    solution = solve(phi, [1.0, 0.0], LIMIT_UM)
    assert solution.modal_um == pytest.approx(np.linalg.solve(phi, [1.0, 0.0]), abs=1e-14)
    assert solution.achieved_um == pytest.approx([1.0, 0.0], abs=1e-15)
    assert not solution.limited
    assert solution.condition == pytest.approx(np.linalg.cond(phi))


def test_at_the_limit_the_still_finger_stays_still_and_the_other_gets_less() -> None:
    phi = np.array([[0.8, 0.75], [0.8, 0.7]])
    solution = solve(phi, [1.0, 0.0], LIMIT_UM)
    assert np.max(np.abs(solution.modal_um)) == LIMIT_UM
    assert solution.achieved_um[1] < 1e-15
    assert 0.0 < solution.achieved_um[0] < 1.0
    assert solution.limited


@settings(deadline=None, max_examples=300)
@given(slipping=row, still=row, target=amplitude, limits=st.tuples(amplitude, amplitude))
def test_the_still_finger_gets_zero_and_the_other_all_that_the_limits_allow(
    slipping: tuple[float, float], still: tuple[float, float], target: float, limits: tuple[float, float]
) -> None:
    modal, limited = solve_fast((slipping, still), (target, 0.0), limits)
    exact = [Fraction(w) for w in modal]
    leak = abs(sum(Fraction(phi) * w for phi, w in zip(still, exact, strict=True)))
    underflow = Fraction(2) ** -1074  # half of it is what rounding leaves of each amplitude, where that is subnormal
    assert leak <= 4 * 2.0**-52 * max(abs(still[0] * modal[0]), abs(still[1] * modal[1])) + underflow
    given_um = abs(sum(phi * w for phi, w in zip(slipping, modal, strict=True)))
    determinant = Fraction(slipping[0]) * Fraction(still[1]) - Fraction(slipping[1]) * Fraction(still[0])
    if any(still) and determinant == 0:
        assert modal == (0.0, 0.0)
    elif limited:
        assert given_um <= target * (1 + 1e-12)
        assert any(abs(w) >= limit * (1 - 1e-15) for w, limit in zip(modal, limits, strict=True))
    elif abs(determinant) > 1e-6:
        assert given_um == pytest.approx(target, rel=1e-9)


@pytest.mark.parametrize("scale", [1e-300, 1e-200, 5e-324, 1.0, 1e200])
def test_the_zero_survives_any_scale_of_the_still_fingers_row(scale: float) -> None:
    """Near a node of both modes the row is tiny, but its ratio still says which way to go."""
    modal, _ = solve_fast(((0.5, 0.9), (3 * scale, 2 * scale)), (1.0, 0.0), (4.0, 4.0))
    assert modal[0] * 3 == pytest.approx(modal[1] * -2, rel=1e-15)
    assert abs(0.5 * modal[0] + 0.9 * modal[1]) == pytest.approx(1.0)


def test_a_still_finger_on_a_node_of_both_modes_asks_for_nothing() -> None:
    with_it = solve([[0.5, 0.9], [0.0, 0.0]], [1.0, 0.0], LIMIT_UM)
    without = solve([[0.5, 0.9]], [1.0], LIMIT_UM)
    assert with_it.modal_um == pytest.approx(without.modal_um, abs=0)


def test_the_hot_path_is_the_general_arithmetic_bit_for_bit() -> None:
    random = np.random.default_rng(5)
    for _ in range(500):
        (slipping, still), target = random.uniform(-1, 1, (2, 2)).tolist(), float(random.uniform(0.1, 5))
        effort = float(random.choice([0.0, 0.1]))
        previous = tuple(random.uniform(-4, 4, 2).tolist()) if random.random() < 0.5 else None
        direction = common_direction([tuple(still)])
        assert direction is not None
        expected = slide_on_line(direction, [tuple(slipping)], [target], (4.0, 3.0), previous, effort)
        rows = tuple(slipping), tuple(still)
        assert solve_fast(rows, (target, 0.0), (4.0, 3.0), previous, "keep_zero", effort) == expected
        assert solve_fast(rows[::-1], (0.0, target), (4.0, 3.0), previous, "keep_zero", effort) == expected


def test_a_finger_lying_on_a_still_finger_leaves_the_plate_silent() -> None:
    for previous in (None, [4.0, -4.0]):
        solution = solve([[0.6, 0.4], [0.6, 0.4]], [1.0, 0.0], LIMIT_UM, previous_um=previous)
        assert not np.any(solution.modal_um)
        assert not solution.limited
        assert solution.condition > 1e15


# --- through a singular position ----------------------------------------------------------------------------------


def singular_crossing(steps: int = 400) -> tuple[Array, Array]:
    """A finger slides past a still one: the determinant goes through zero halfway. Returns phi (K, 2, 2), det (K,)."""
    x_mm = np.linspace(-1.0, 1.0, steps)  # an even number: never exactly singular
    phase = 2 * np.pi * x_mm / 27.0 + 0.7
    slipping = np.stack([np.cos(phase), np.sin(phase)], axis=1)
    still = np.broadcast_to([math.cos(0.7), math.sin(0.7)], slipping.shape)
    phi = np.stack([slipping, still], axis=1)
    return phi, np.linalg.det(phi)


def test_through_a_singular_position_the_amplitudes_stay_where_the_papers_flip() -> None:
    phi, determinant = singular_crossing()
    assert determinant[0] * determinant[-1] < 0
    ours = solve_batch(phi, [1.0, 0.0], LIMIT_UM)
    papers = solve_batch(phi, [1.0, 0.0], LIMIT_UM, policy="paper")
    assert np.max(np.abs(np.diff(ours, axis=0))) < 0.05
    assert np.max(np.abs(np.diff(papers, axis=0))) > 7.9  # from limit to limit


def test_effort_fades_towards_a_singular_position_and_stays_continuous() -> None:
    phi, _ = singular_crossing(401)  # the middle one is exactly singular
    rides = np.linalg.norm(solve_batch(phi[:200], [1.0, 0.0], LIMIT_UM), axis=1)
    fades = solve_batch(phi, [1.0, 0.0], LIMIT_UM, effort=0.01)
    middle = len(phi) // 2
    assert not np.any(fades[middle])
    assert np.max(np.abs(np.diff(fades, axis=0))) < 0.3
    assert np.linalg.norm(fades[middle - 1]) < 0.1 * rides[-1]


def test_effort_shrinks_the_amplitude_as_its_formula_says() -> None:
    gain = 0.6
    modal, _ = solve_fast(((gain, 0.0), (0.0, 1.0)), (2.0, 0.0), (9.0, 9.0), None, "keep_zero", 0.3)
    assert modal == pytest.approx((2.0 * gain / (gain * gain + 0.3), 0.0))


# --- two fingers slipping, one finger alone -----------------------------------------------------------------------


@settings(deadline=None, max_examples=150)
@given(
    rows=st.lists(row, min_size=1, max_size=4),
    targets=st.lists(amplitude, min_size=4, max_size=4),
    limits=st.tuples(amplitude, amplitude),
    effort=st.sampled_from([0.0, 0.0, 0.02, 1.0]),
    previous=st.none() | st.tuples(amplitude, amplitude),
)
def test_no_point_of_the_box_serves_slipping_fingers_better(
    rows: list[tuple[float, float]],
    targets: list[float],
    limits: tuple[float, float],
    effort: float,
    previous: tuple[float, float] | None,
) -> None:
    phi, target_um, limit_um = np.array(rows), np.array(targets[: len(rows)]), np.array(limits)
    solution = solve(phi, target_um, limit_um, effort=effort, previous_um=previous)
    assert np.all(np.abs(solution.modal_um) <= limit_um)
    best = best_error_in_box(phi, target_um, limit_um, effort)
    assert error(phi, target_um, solution.modal_um, effort) <= best + 1e-9


@pytest.mark.parametrize("modes", [1, 2, 3])
@pytest.mark.parametrize("scale", [1e-300, 1e-123, 1.0, 1e123])
@pytest.mark.parametrize("effort", [0.02, 1e40, 1e200])
def test_effort_weighs_the_same_however_small_the_shapes_and_however_great_it_is(
    modes: int, scale: float, effort: float
) -> None:
    phi = np.zeros((1, modes))
    phi[0, -1] = scale
    exact = Fraction(scale) / (Fraction(scale) ** 2 + Fraction(effort))  # what one finger that wants 1 um is worth
    modal_um = solve(phi, [1.0], LIMIT_UM, effort=effort).modal_um
    assert not modal_um[:-1].any()
    assert modal_um[-1] == pytest.approx(float(exact), rel=1e-6, abs=1e-290)


def test_one_finger_gets_its_amplitude_with_the_least_modal_amplitude() -> None:
    solution = solve([[0.6, 0.8]], [2.0], LIMIT_UM)
    assert solution.modal_um == pytest.approx([1.2, 1.6])
    bent = solve([[0.6, 0.8]], [4.0], [4.0, 3.0])
    assert bent.modal_um == pytest.approx([(4.0 - 2.4) / 0.6, 3.0])
    assert not bent.limited  # a limit is met, but nothing is missed
    assert solve([[0.6, 0.8]], [5.0], [4.0, 3.0]).limited


def test_of_two_sign_patterns_that_serve_both_fingers_the_smaller_wins() -> None:
    phi = np.array([[1.0, 0.9], [0.9, 1.0]])
    solution = solve(phi, [1.0, 1.0], LIMIT_UM)
    assert solution.achieved_um == pytest.approx([1.0, 1.0])
    assert solution.modal_um == pytest.approx([1 / 1.9, 1 / 1.9])  # the other pattern needs 10 um


def test_free_signs_serve_both_fingers_where_the_papers_signs_hit_the_limit() -> None:
    phi = np.array([[1.0, 0.9], [-0.9, -1.0]])
    assert solve(phi, [1.0, 1.0], LIMIT_UM).achieved_um == pytest.approx([1.0, 1.0])
    assert solve(phi, [1.0, 1.0], LIMIT_UM, policy="paper").limited


def test_of_equals_the_one_nearest_the_present_amplitudes_is_taken() -> None:
    phi = np.eye(2)
    for previous in ([2.0, 1.0], [-2.0, 1.0], [2.0, -1.0], [-2.0, -1.0]):
        solution = solve(phi, [1.0, 1.0], LIMIT_UM, previous_um=previous)
        assert solution.modal_um.tolist() == np.sign(previous).tolist()


@pytest.mark.parametrize("target_um", [1.0, 6.0], ids=["tie in |W|", "tie in the error, at the limits"])
def test_hysteresis_holds_a_sign_pattern_through_a_near_tie(target_um: float) -> None:
    """Row one wobbles about the point where both patterns serve equally well."""
    wobble = [0.003, -0.003] * 20
    phi = np.array([[[1.0, 0.2 + step], [0.2, -1.0]] for step in wobble])
    nervous = solve_batch(phi, [target_um, target_um], LIMIT_UM)
    calm = solve_batch(phi, [target_um, target_um], LIMIT_UM, hysteresis=0.05)
    assert np.max(np.abs(np.diff(nervous, axis=0))) > 1.0
    assert np.max(np.abs(np.diff(calm, axis=0))) < 0.02
    errors = [error(shapes, np.full(2, target_um), modal) for shapes, modal in zip(phi, calm, strict=True)]
    best = [error(shapes, np.full(2, target_um), modal) for shapes, modal in zip(phi, nervous, strict=True)]
    assert errors == pytest.approx(best, rel=0.02, abs=1e-12)


def test_all_fingers_still_or_no_finger_is_silence() -> None:
    assert not np.any(solve(np.random.default_rng(0).uniform(-1, 1, (2, 2)), [0.0, 0.0], LIMIT_UM).modal_um)
    nobody = solve(np.zeros((0, 3)), [], LIMIT_UM, previous_um=[1.0, 1.0, 1.0])
    assert nobody.modal_um.tolist() == [0.0, 0.0, 0.0]
    assert nobody.condition == 1.0
    assert not nobody.limited


def test_two_still_fingers_silence_two_modes_unless_they_see_the_same_mixture() -> None:
    slipping = [0.3, -0.8]
    assert not np.any(solve([slipping, [1.0, 0.0], [1.0, 1e-9]], [1.0, 0.0, 0.0], LIMIT_UM).modal_um)
    same = solve([slipping, [0.4, 0.3], [-0.8, -0.6]], [1.0, 0.0, 0.0], LIMIT_UM)
    assert same.achieved_um == pytest.approx([1.0, 0.0, 0.0], abs=1e-15)


def test_parallel_slipping_fingers_share_what_they_want() -> None:
    solution = solve([[0.5, 0.5], [0.5, 0.5]], [1.0, 2.0], LIMIT_UM)
    assert solution.achieved_um == pytest.approx([1.5, 1.5])
    assert solution.modal_um == pytest.approx([1.5, 1.5])


def test_one_mode_serves_one_finger_and_obeys_a_still_one() -> None:
    assert solve([[0.5]], [1.0], LIMIT_UM).modal_um.tolist() == [2.0]
    assert solve([[0.5]], [3.0], LIMIT_UM).modal_um.tolist() == [4.0]
    assert solve([[0.5], [0.7]], [3.0, 0.0], LIMIT_UM).modal_um.tolist() == [0.0]


def test_the_solution_is_linear_in_its_targets_while_no_limit_is_met() -> None:
    phi = np.array([[0.8, -0.3], [0.2, 0.7]])
    once, thrice = (solve(phi, [s * 0.5, s * 0.2], LIMIT_UM, effort=0.1).modal_um for s in (1, 3))
    assert thrice == pytest.approx(3 * once)


# --- other policies -----------------------------------------------------------------------------------------------


def test_keep_ratio_scales_all_fingers_alike() -> None:
    phi = np.array([[1.0, 0.3], [0.2, 0.9]])
    solution = solve(phi, [9.0, 3.0], LIMIT_UM, policy="keep_ratio")
    assert solution.limited
    assert solution.achieved_um[0] == pytest.approx(3 * solution.achieved_um[1])
    assert np.max(np.abs(solution.modal_um)) == pytest.approx(LIMIT_UM)


def test_least_squares_leaks_where_that_serves_the_others_better() -> None:
    phi = np.array([[0.8, 0.75], [0.8, 0.7]])
    strict = solve(phi, [1.0, 0.0], LIMIT_UM)
    traded = solve(phi, [1.0, 0.0], LIMIT_UM, policy="least_squares")
    assert traded.achieved_um[1] > 0.1
    errors = [float(np.sum((one.achieved_um - [1.0, 0.0]) ** 2)) for one in (strict, traded)]
    assert errors[1] < errors[0]
    found = lsq_linear(phi, [1.0, 0.0], (-LIMIT_UM, LIMIT_UM), method="bvls").x
    assert errors[1] == pytest.approx(float(np.sum((phi @ found - [1.0, 0.0]) ** 2)))


def test_the_papers_policy_is_its_formula() -> None:
    phi = np.array([[0.8, 0.75], [0.8, 0.7]])
    inverse = np.linalg.solve(phi, [1.0, 0.0])
    solution = solve(phi, [1.0, 0.0], LIMIT_UM, policy="paper")
    assert solution.modal_um == pytest.approx(inverse * LIMIT_UM / np.max(np.abs(inverse)))
    assert solution.limited
    assert not np.any(solve([[0.5, 0.5], [0.5, 0.5]], [1.0, 0.0], LIMIT_UM, policy="paper").modal_um)
    three = np.array([[0.8, 0.7, 0.2], [0.1, 0.7, -0.4]])
    assert (
        solve(three, [1.0, 0.0], 4.0, policy="paper").modal_um.tolist()
        == solve(three, [1.0, 0.0], 4.0).modal_um.tolist()
    )


# --- the public edge ----------------------------------------------------------------------------------------------


def test_a_batch_is_solve_after_solve_each_from_the_last() -> None:
    phi = np.random.default_rng(1).uniform(-1, 1, (20, 2, 2))
    targets = np.random.default_rng(2).uniform(0.1, 2, (20, 2))
    batch = solve_batch(phi, targets, [4.0, 3.0], previous_um=[1.0, -1.0], effort=0.01)
    previous: object = [1.0, -1.0]
    for shapes, target, modal in zip(phi, targets, batch, strict=True):
        previous = solve(shapes, target, [4.0, 3.0], previous_um=previous, effort=0.01).modal_um  # type: ignore[arg-type]
        assert modal.tolist() == previous.tolist()
    assert solve_batch(np.zeros((0, 2, 3)), [1.0, 0.0], 4.0).shape == (0, 3)


@settings(deadline=None, max_examples=100)
@given(
    rows=st.tuples(row, row),
    targets=st.tuples(st.just(0.0) | amplitude, st.just(0.0) | amplitude),
    limits=st.tuples(amplitude, amplitude),
    previous=st.none() | st.tuples(amplitude, amplitude),
    policy=st.sampled_from(sorted(POLICIES)),
)
def test_however_the_numbers_are_told_the_solution_is_the_same_to_the_last_bit(
    rows: tuple[tuple[float, float], tuple[float, float]],
    targets: tuple[float, float],
    limits: tuple[float, float],
    previous: tuple[float, float] | None,
    policy: str,
) -> None:
    """Plain floats take a way of their own; scalars of numpy go through all checks."""
    told = []
    for tell in (np.array, list, tuple, lambda values: list(map(np.float64, values))):
        phi = tell([tell(one) for one in rows])
        now = None if previous is None else tell(previous)
        one = solve(phi, tell(targets), tell(limits), previous_um=now, policy=policy)
        told.append((one.modal_um.tolist(), one.achieved_um.tolist(), one.limited, one.condition))
    assert told[1:] == told[:1] * 3
    modal, limited = solve_fast(rows, targets, limits, previous, policy)
    assert told[0][0] == list(modal)
    assert told[0][2] == limited


@pytest.mark.parametrize(
    "change",
    [
        {"phi": {(0.5, 0.4): 1, (0.3, -0.2): 2}},
        {"phi": [{0.5, 0.4}, {0.3, -0.2}]},
        {"phi": np.full((2, 2, 2), 0.5)},
        {"target_um": {1.0, 0.0}},
        {"target_um": "10"},
        {"limit_um": {4.0: 1, 3.0: 2}},
        {"previous_um": iter((1.0, 2.0))},
    ],
)
def test_what_only_looks_like_numbers_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=rf"^{next(iter(change))}[^\n]*\.$"):
        solve(**{**GOOD, **change})  # type: ignore[arg-type]


GOOD: dict[str, object] = {"phi": [[0.5, 0.4], [0.3, -0.2]], "target_um": [1.0, 0.0], "limit_um": 4.0}


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"phi": [[math.nan, 0.4], [0.3, -0.2]]}, "phi"),
        ({"phi": [[math.inf, 0.4], [0.3, -0.2]]}, "phi"),
        ({"phi": [[0.5, 0.4], [0.3]]}, "phi"),
        ({"phi": [0.5, 0.4]}, "phi"),
        ({"phi": np.zeros((2, 0))}, "phi"),
        ({"phi": "plate"}, "phi"),
        ({"target_um": [1.0]}, "target_um"),
        ({"target_um": [-1.0, 0.0]}, "target_um"),
        ({"target_um": [math.nan, 0.0]}, "target_um"),
        ({"target_um": [math.inf, 0.0]}, "target_um"),
        ({"limit_um": 0.0}, "limit_um"),
        ({"limit_um": [4.0, -1.0]}, "limit_um"),
        ({"limit_um": [4.0, math.nan]}, "limit_um"),
        ({"limit_um": [4.0, 4.0, 4.0]}, "limit_um"),
        ({"previous_um": [1.0]}, "previous_um"),
        ({"previous_um": [1.0, math.nan]}, "previous_um"),
        ({"effort": -1.0}, "effort"),
        ({"effort": math.nan}, "effort"),
        ({"hysteresis": -0.1}, "hysteresis"),
        ({"policy": "best"}, "keep_zero, keep_ratio, least_squares, priority, paper"),
    ],
)
def test_bad_input_gets_one_sentence_that_names_it(change: dict[str, object], named: str) -> None:
    with pytest.raises(ValueError, match=r"^[^\n]*\.$") as caught:
        solve(**{**GOOD, **change})  # type: ignore[arg-type]
    assert named in str(caught.value)
    if "phi" not in change and "target_um" not in change:
        with pytest.raises(ValueError, match=named):
            solve_batch(**{**GOOD, "phi": np.zeros((0, 2, 2)), **change})  # type: ignore[arg-type]


def test_the_condition_number_is_infinite_where_phi_is_singular_and_has_no_scale() -> None:
    assert condition_number(np.zeros((2, 2))) == math.inf
    assert condition_number(np.array([[1.0, 0.0], [0.0, 0.0]])) == math.inf
    tiny = np.array([[3.0, 1.0], [1.0, 2.0]])
    assert condition_number(tiny * 1e-300) == pytest.approx(condition_number(tiny))
