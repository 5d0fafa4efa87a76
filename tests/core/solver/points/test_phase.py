"""Free phases: a change of sign without a dip, and the best that two fingers on two modes can get."""

from __future__ import annotations

import cmath
import itertools
import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from hapticd.core.solver import solve
from hapticd.core.solver.points.phase import TURN_RAD, solve_phased_fast

Array = npt.NDArray[np.float64]
Phasors = npt.NDArray[np.complex128]
LIMIT_UM = 4.0
FAR_UM = 1e6


def is_within(modal_um: Phasors, limit_um: float) -> bool:
    return all(abs(w) <= limit_um for w in modal_um.tolist())


def error(phi: Array, target_um: Array, modal_um: npt.ArrayLike) -> float:
    return float(np.sum((np.abs(phi @ np.asarray(modal_um)) - target_um) ** 2))


def solve_phased(
    phi: Array,
    target_um: npt.ArrayLike,
    limit_um: float,
    *,
    previous_um: Phasors | None = None,
    turn_rad: float = TURN_RAD,
) -> Phasors:
    """The touch path's solver, which takes plain numbers, on arrays."""
    previous = None if previous_um is None else tuple(previous_um.tolist())
    rows, targets = tuple(map(tuple, phi.tolist())), tuple(map(float, np.asarray(target_um)))
    return np.array(solve_phased_fast(rows, targets, (limit_um,) * phi.shape[1], previous, turn_rad)[0])


def turning_pair(steps: int = 200) -> tuple[Array, Array]:
    """Two fingers whose best sign pattern changes halfway, where both patterns are as great. Returns phi, target_um."""
    angle = np.linspace(-0.4, 0.4, steps)
    phi = np.stack([np.stack([np.cos(angle), np.sin(angle)], -1), np.stack([np.sin(angle), np.cos(angle)], -1)], 1)
    return phi, np.array([1.0, 1.0])


# --- two fingers, two modes ---------------------------------------------------------------------------------------


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), reach=st.sampled_from([1.0, 4.0, 9.0]))
def test_no_phasors_within_the_limits_serve_two_fingers_better(seed: int, reach: float) -> None:
    """An oracle: a general minimiser over both magnitudes and the phase between, from several starts."""
    random = np.random.default_rng(seed)
    phi, target_um = random.uniform(-1, 1, (2, 2)), random.uniform(0.2, reach, 2)
    modal_um = solve_phased(phi, target_um, LIMIT_UM)
    assert is_within(modal_um, LIMIT_UM)
    bounds = [(0.0, LIMIT_UM), (0.0, LIMIT_UM), (0.0, math.pi)]
    found = [
        minimize(lambda v: error(phi, target_um, [v[0], cmath.rect(v[1], v[2])]), start, bounds=bounds).fun
        for start in itertools.product((1.0, 3.0), (1.0, 3.0), (0.3, 2.8))
    ]
    assert error(phi, target_um, modal_um) <= min(found) + 1e-7
    assert error(phi, target_um, modal_um) <= error(phi, target_um, solve(phi, target_um, LIMIT_UM).modal_um) + 1e-12


def test_both_axes_give_two_unlike_fingers_up_to_the_root_of_two_more() -> None:
    phi, target_um = np.array([[1.0, 1.0], [1.0, -1.0]]), np.array([5.0, 5.0])
    assert solve(phi, target_um, LIMIT_UM).achieved_um == pytest.approx([4.0, 4.0])  # one mode at its limit, one idle
    modal_um = solve_phased(phi, target_um, LIMIT_UM)
    assert np.abs(phi @ modal_um) == pytest.approx(target_um)
    assert is_within(modal_um, LIMIT_UM)
    most_um = solve_phased(phi, [9.0, 9.0], LIMIT_UM)
    assert np.abs(phi @ most_um) == pytest.approx([math.sqrt(2) * LIMIT_UM] * 2)


def test_where_signs_alone_jump_the_phase_turns_and_no_finger_feels_it() -> None:
    phi, target_um = turning_pair()
    real: list[Array] = []
    turned: list[Phasors] = []
    for shapes in phi:
        real.append(solve(shapes, target_um, LIMIT_UM, previous_um=real[-1] if real else None).modal_um)
        turned.append(solve_phased(shapes, target_um, LIMIT_UM, previous_um=turned[-1] if turned else None))
    assert np.max(np.abs(np.diff(real, axis=0))) > 0.9
    assert np.max(np.abs(np.diff(turned, axis=0))) < 0.45
    assert np.abs(np.einsum("knm,km->kn", phi, turned)) == pytest.approx(np.ones((len(phi), 2)), rel=1e-9)
    chords = (np.array(turned)[1:] + np.array(turned)[:-1]) / 2
    jumps = (np.array(real)[1:] + np.array(real)[:-1]) / 2
    assert np.min(np.abs(np.einsum("knm,km->kn", phi[1:], chords))) > math.cos(TURN_RAD / 2) - 1e-3
    assert np.min(np.abs(np.einsum("knm,km->kn", phi[1:], jumps))) < 0.02
    assert np.abs(turned[-1]) == pytest.approx(np.abs(real[-1]))


@pytest.mark.parametrize("turn_rad", [0.05, 0.5, math.pi])
def test_the_phase_between_fingers_turns_by_no_more_than_it_may(turn_rad: float) -> None:
    phi, target_um = turning_pair(40)
    previous = solve_phased(phi[0], target_um, LIMIT_UM)
    turned_rad = []
    for shapes in phi:
        modal_um = solve_phased(shapes, target_um, LIMIT_UM, previous_um=previous, turn_rad=turn_rad)
        was, now = (abs(cmath.phase(w[1] / w[0])) for w in (shapes @ previous, shapes @ modal_um))
        turned_rad.append(abs(now - was))
        previous = modal_um
    assert max(turned_rad) == pytest.approx(turn_rad)


def test_riding_the_limits_together_is_continuous_without_any_bound_on_the_turn() -> None:
    """Targets out of reach: the optimum of a convex programme moves with the fingers, where signs alone jump."""
    angle = np.linspace(-0.5, 0.5, 2000)
    phi = np.stack([np.stack([np.cos(angle), 0.9 + angle], -1), np.stack([0.8 - angle, -np.cos(angle)], -1)], 1)
    previous: Phasors | None = None
    real: Array | None = None
    steps, jumps = [], []
    for shapes in phi:
        modal_um = solve_phased(shapes, [9.0, 7.0], LIMIT_UM, previous_um=previous, turn_rad=0.0)
        sign_um = solve(shapes, [9.0, 7.0], LIMIT_UM, previous_um=real).modal_um
        if previous is not None and real is not None:
            steps.append(float(np.max(np.abs(modal_um - previous))))
            jumps.append(float(np.max(np.abs(sign_um - real))))
        previous, real = modal_um, sign_um
    assert max(steps) < 0.05
    assert max(jumps) > 1.0


# --- what it shares with the real solver --------------------------------------------------------------------------


def test_one_slipping_finger_needs_no_phase_of_its_own() -> None:
    phi = np.array([[0.8, -0.3], [0.2, 0.7]])
    previous = np.array([1.0 + 1.0j, -0.5 - 0.5j])
    modal_um = solve_phased(phi, [1.0, 0.0], LIMIT_UM, previous_um=previous)
    assert np.abs(modal_um) == pytest.approx(np.abs(solve(phi, [1.0, 0.0], LIMIT_UM).modal_um))
    assert np.angle(modal_um) == pytest.approx(np.angle(previous))
    assert abs(phi[1] @ modal_um) < 1e-15


# --- more fingers, more modes -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("fingers", "modes", "still"), [(2, 3, 1), (3, 3, 0), (4, 5, 1), (2, 4, 0)])
def test_more_fingers_turn_as_unfelt(fingers: int, modes: int, still: int) -> None:
    """Smooth ways that stay clear of singular positions: where the best pattern changes, the real one's chord dips."""
    random = np.random.default_rng(fingers * 10 + modes)
    target_um = np.concatenate([random.uniform(0.5, 1.5, fingers), np.zeros(still)])
    centre, swing = random.uniform(-1, 1, (2, fingers + still, modes))
    turned: list[Phasors] = []
    real: list[Array] = []
    apart = 1.5 * np.eye(fingers + still, modes)
    ways = [apart + 0.6 * np.sin(3 * centre + swing * step) for step in np.linspace(0.0, 20.0, 1500)]
    for phi in ways:
        turned.append(solve_phased(phi, target_um, FAR_UM, previous_um=turned[-1] if turned else None))
        real.append(solve(phi, target_um, FAR_UM, previous_um=real[-1] if real else None).modal_um)
    least, least_real = 1.0, 1.0
    for index, phi in enumerate(ways[1:], 1):
        assert np.abs(phi @ turned[index]) == pytest.approx(target_um, rel=1e-2, abs=1e-9)
        share, share_real = (
            float(np.min(np.abs(phi @ (way[index] + way[index - 1]))[:fingers] / target_um[:fingers] / 2))
            for way in (turned, real)
        )
        least, least_real = min(least, share), min(least_real, share_real)
    assert least_real < 0.3
    assert least > 0.9
