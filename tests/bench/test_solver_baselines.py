"""Rules for points that lost: each against what defines it, and within the limits everywhere."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

import hapticd.core.solver as core_solver
from hapticd.bench.baselines import POLICIES, solve
from hapticd.sim.paper_scheme import invert

LIMIT_UM = 4.0
NEARLY_PARALLEL = np.array([[0.8, 0.75], [0.8, 0.7]])


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("reach_um", [1.0, 1e12])
def test_every_policy_breaks_no_limit_and_makes_no_exception_of_singular_positions(
    policy: str, reach_um: float
) -> None:
    random = np.random.default_rng(7)
    for phi in (np.full((2, 2), 0.5), np.zeros((2, 3)), random.uniform(-1, 1, (3, 2)), random.uniform(-1, 1, (4, 4))):
        target_um = reach_um * np.arange(float(len(phi)))
        solution = solve(phi, target_um, LIMIT_UM, policy=policy, previous_um=np.ones(phi.shape[1]))
        assert np.all(np.abs(solution.modal_um) <= LIMIT_UM)
        assert solution.achieved_um == pytest.approx(np.abs(phi @ solution.modal_um))


def test_least_squares_leaks_where_that_serves_the_others_better() -> None:
    traded = solve(NEARLY_PARALLEL, [1.0, 0.0], LIMIT_UM, policy="least_squares")
    assert traded.achieved_um[1] > 0.1
    found = lsq_linear(NEARLY_PARALLEL, [1.0, 0.0], (-LIMIT_UM, LIMIT_UM), method="bvls").x
    assert np.abs(traded.modal_um) == pytest.approx(np.abs(found))


def test_the_papers_is_the_inverse_scaled_into_the_limits() -> None:
    inverse = np.linalg.solve(NEARLY_PARALLEL, [1.0, 0.0])
    solution = solve(NEARLY_PARALLEL, [1.0, 0.0], LIMIT_UM, policy="paper")
    assert solution.modal_um == pytest.approx(inverse * LIMIT_UM / np.max(np.abs(inverse)))
    assert solution.limited


def test_an_unknown_policy_is_one_sentence() -> None:
    with pytest.raises(ValueError, match=r"^policy: 'best' is unknown; choose one of keep_zero, [^\n]*\.$"):
        solve([[0.5]], [1.0], LIMIT_UM, policy="best")


@pytest.mark.parametrize("modes", [3, 4, 6])
def test_the_paper_s_scheme_on_more_modes_takes_the_best_of_all_signs(modes: int) -> None:
    random = np.random.default_rng(modes)
    limits = (2.0,) * modes
    for targets in ((1.0, 0.0), (1.0, 0.5), (1.5, 1.5)):
        rows = tuple(map(tuple, random.uniform(-1.0, 1.0, (2, modes)).tolist()))
        modal, limited = invert(rows, targets, limits)
        best = core_solver.solve(rows, targets, limits)
        assert tuple(best.modal_um) == modal
        assert best.limited == limited
