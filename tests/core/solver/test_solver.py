"""The solver's rules, each against what defines it, and the input checks."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pipeline_bench import contact_grams
from scipy.optimize import linprog, lsq_linear

from hapticd.core.solver import solve, solve_batch
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings

Array = npt.NDArray[np.float64]
LIMIT_UM = 4.0
shape = st.floats(-1.0, 1.0, allow_subnormal=False)
amplitude = st.floats(0.05, 6.0)
row = st.tuples(shape, shape)


def error(phi: Array, target_um: Array, modal_um: Array) -> float:
    missed = np.abs(phi @ modal_um) - target_um
    return float(missed @ missed)


def best_error_in_box(phi: Array, target_um: Array, limit_um: Array) -> float:
    """A slow independent solver: bounded-variable least squares for every sign pattern."""
    errors = []
    for signs in itertools.product((1.0, -1.0), repeat=len(phi) - 1):
        wanted = np.array([1.0, *signs]) * target_um
        found = lsq_linear(phi, wanted, (-limit_um, limit_um), method="bvls", tol=1e-14).x
        errors.append(error(phi, target_um, found))
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


@example(slipping=(0.5625, 0.8125), still=(0.0, 0.0), target=3.125, limits=(3.25, 1.5))
@given(slipping=row, still=row, target=amplitude, limits=st.tuples(amplitude, amplitude))
def test_the_still_finger_gets_zero_and_the_other_all_that_the_limits_allow(
    slipping: tuple[float, float], still: tuple[float, float], target: float, limits: tuple[float, float]
) -> None:
    solution = solve((slipping, still), (target, 0.0), limits)
    modal, limited = tuple(solution.modal_um.tolist()), solution.limited
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
        assert any(abs(w) >= limit * (1 - 1e-9) for w, limit in zip(modal, limits, strict=True))
    elif abs(determinant) > 1e-6:
        assert given_um == pytest.approx(target, rel=1e-9)


# --- through a singular position ----------------------------------------------------------------------------------


def singular_crossing() -> tuple[Array, Array]:
    """A finger slides past a still one: the determinant goes through zero halfway. Returns phi (K, 2, 2), det (K,)."""
    x_mm = np.linspace(-1.0, 1.0, 400)  # an even number: never exactly singular
    phase = 2 * np.pi * x_mm / 27.0 + 0.7
    slipping = np.stack([np.cos(phase), np.sin(phase)], axis=1)
    still = np.broadcast_to([math.cos(0.7), math.sin(0.7)], slipping.shape)
    phi = np.stack([slipping, still], axis=1)
    return phi, np.linalg.det(phi)


def test_through_a_singular_position_the_amplitudes_stay_where_the_papers_flip() -> None:
    phi, determinant = singular_crossing()
    assert determinant[0] * determinant[-1] < 0
    inverse = np.array([np.linalg.solve(shapes, [1.0, 0.0]) for shapes in phi])
    ours = solve_batch(phi, [1.0, 0.0], LIMIT_UM)
    assert np.max(np.abs(np.diff(ours, axis=0))) < 0.05
    assert np.max(np.abs(np.diff(np.clip(inverse, -LIMIT_UM, LIMIT_UM), axis=0))) > 7.9  # from limit to limit


# --- two fingers slipping, one finger alone -----------------------------------------------------------------------


@pytest.mark.parametrize(("still", "modes"), [(1, 3), (2, 3), (1, 4), (3, 5)])
def test_still_fingers_on_more_modes_get_0_and_the_other_nearly_the_most(still: int, modes: int) -> None:
    shares = []
    for seed in range(30):
        random = np.random.default_rng(seed)
        phi, limit_um = random.uniform(-1.0, 1.0, (still + 1, modes)), random.uniform(0.5, 4.0, modes)
        solution = solve(phi, [100.0, *[0.0] * still], limit_um)
        assert solution.achieved_um[1:].max() < 1e-14
        assert np.all(np.abs(solution.modal_um) <= limit_um)
        assert solution.limited
        zeros, bounds = np.zeros(still), np.stack((-limit_um, limit_um), axis=1)
        best = linprog(-phi[0], A_eq=phi[1:], b_eq=zeros, bounds=bounds)
        shares.append(solution.achieved_um[0] / -best.fun)
    assert min(shares) > 0.8
    assert np.median(shares) > 0.999


@pytest.mark.parametrize(("fingers", "modes"), [(1, 2), (1, 5), (2, 3), (2, 5)])
def test_of_amplitudes_that_serve_alike_the_least_are_taken(fingers: int, modes: int) -> None:
    phi = np.random.default_rng(4).uniform(-1.0, 1.0, (fingers, modes))
    signs = itertools.product((0.5, -0.5), repeat=fingers)
    least = min(np.linalg.norm(np.linalg.pinv(phi) @ signed) for signed in signs)
    solution = solve(phi, [0.5] * fingers, LIMIT_UM)
    assert solution.achieved_um == pytest.approx([0.5] * fingers, rel=1e-9)
    assert np.linalg.norm(solution.modal_um) == pytest.approx(least, rel=1e-9)


@example(rows=[(0.5, 5e-5)], targets=[1.0] * 5, limits=[1.0] * 5, previous=None)  # a mode that hardly serves
@settings(max_examples=60, deadline=None)
@given(
    rows=st.integers(1, 5).flatmap(lambda modes: st.lists(st.tuples(*[shape] * modes), min_size=1, max_size=5)),
    targets=st.lists(amplitude, min_size=5, max_size=5),
    limits=st.lists(amplitude, min_size=5, max_size=5),
    previous=st.none() | st.lists(amplitude, min_size=5, max_size=5),
)
def test_no_point_of_the_box_serves_slipping_fingers_better(
    rows: list[tuple[float, ...]], targets: list[float], limits: list[float], previous: list[float] | None
) -> None:
    modes = len(rows[0])
    phi, target_um, limit_um = np.array(rows), np.array(targets[: len(rows)]), np.array(limits[:modes])
    solution = solve(phi, target_um, limit_um, previous_um=previous and previous[:modes])
    assert np.all(np.abs(solution.modal_um) <= limit_um)
    best = np.sqrt(best_error_in_box(phi, target_um, limit_um))
    assert np.sqrt(error(phi, target_um, solution.modal_um)) <= best + 1e-3 * np.linalg.norm(target_um)


def test_of_equals_the_one_nearest_the_present_amplitudes_is_taken() -> None:
    phi = np.eye(2)
    for previous in ([2.0, 1.0], [-2.0, 1.0], [2.0, -1.0], [-2.0, -1.0]):
        solution = solve(phi, [1.0, 1.0], LIMIT_UM, previous_um=previous)
        assert solution.modal_um == pytest.approx(np.sign(previous), abs=1e-9)


def test_all_fingers_still_or_no_finger_is_silence() -> None:
    assert not np.any(solve(np.random.default_rng(0).uniform(-1, 1, (2, 2)), [0.0, 0.0], LIMIT_UM).modal_um)
    empty = solve(np.zeros((0, 3)), [], LIMIT_UM, previous_um=[1.0, 1.0, 1.0])
    assert empty.modal_um.tolist() == [0.0, 0.0, 0.0]
    assert empty.condition == 1.0
    assert not empty.limited


# --- contacts, by their Gram matrices ------------------------------------------------------------------------------


def test_solve_with_grams_gives_real_amplitudes_and_the_rms_of_each_contact() -> None:
    plate = GroundTruth(PlateSettings.of("fingertip"))
    modes, points_mm = plate.measured_mode_map(1), [(-40.0, 10.0), (35.0, -20.0)]
    phi, grams = modes.evaluate(points_mm), contact_grams(modes, points_mm, 5.0)
    solution = solve(phi, [1.0, 0.0], plate.w_limit_um, gram=grams)
    rms_um = [math.sqrt(solution.modal_um @ gram @ solution.modal_um) for gram in grams]
    assert solution.achieved_um == pytest.approx(rms_um)
    assert np.all(np.abs(solution.modal_um) <= plate.w_limit_um)
    assert rms_um[0] > 5.0 * rms_um[1]
    assert solve(phi, [1.0, 0.0], plate.w_limit_um).achieved_um[1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("gram", [np.zeros((2, 2)), np.full((2, 2, 2), np.nan), "three"])
def test_a_gram_of_another_shape_or_not_finite_is_one_sentence(gram: object) -> None:
    with pytest.raises(ValueError, match=r"^gram: .*\."):
        solve(np.eye(2), [1.0, 0.0], 4.0, gram=gram)


# --- input checks ----------------------------------------------------------------------------------------------


def test_a_batch_is_solve_after_solve_each_from_the_last() -> None:
    phi = np.random.default_rng(1).uniform(-1, 1, (20, 2, 2))
    for targets in ([1.0, 0.5], [1.0, 0.0]):
        batch = solve_batch(phi, targets, [4.0, 3.0], previous_um=[1.0, -1.0])
        previous = [1.0, -1.0]
        for shapes, modal in zip(phi, batch, strict=True):
            previous = solve(shapes, targets, [4.0, 3.0], previous_um=previous).modal_um
            assert modal.tolist() == previous.tolist()
    assert solve_batch(np.zeros((0, 2, 3)), [1.0, 0.0], 4.0).shape == (0, 3)


GOOD: dict[str, object] = {"phi": [[0.5, 0.4], [0.3, -0.2]], "target_um": [1.0, 0.0], "limit_um": 4.0}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("phi", [[math.nan, 0.4], [0.3, -0.2]]),
        ("phi", [[math.inf, 0.4], [0.3, -0.2]]),
        ("phi", [[0.5, 0.4], [0.3]]),
        ("phi", [0.5, 0.4]),
        ("phi", np.zeros((2, 0))),
        ("phi", np.full((2, 2, 2), 0.5)),
        ("phi", "plate"),
        ("phi", {(0.5, 0.4): 1, (0.3, -0.2): 2}),
        ("phi", [{0.5, 0.4}, {0.3, -0.2}]),
        ("target_um", [1.0]),
        ("target_um", [-1.0, 0.0]),
        ("target_um", [math.nan, 0.0]),
        ("target_um", [math.inf, 0.0]),
        ("target_um", {1.0, 0.0}),
        ("target_um", "10"),
        ("limit_um", 0.0),
        ("limit_um", [4.0, -1.0]),
        ("limit_um", [4.0, math.nan]),
        ("limit_um", [4.0, 4.0, 4.0]),
        ("limit_um", {4.0: 1, 3.0: 2}),
        ("previous_um", [1.0]),
        ("previous_um", [1.0, math.nan]),
        ("previous_um", iter((1.0, 2.0))),
    ],
)
def test_bad_input_gets_one_sentence_that_names_it(name: str, value: object) -> None:
    with pytest.raises(ValueError, match=rf"^{name}[^\n]*\.$"):
        solve(**{**GOOD, name: value})
    if name not in ("phi", "target_um"):
        with pytest.raises(ValueError, match=name):
            solve_batch(**{**GOOD, "phi": np.zeros((0, 2, 2)), name: value})
