"""The paper's solver: its formula, within the limits everywhere."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.bench.baselines.paper_scheme import invert

LIMITS_UM = (4.0, 4.0)


def test_it_is_the_inverse_scaled_into_the_limits() -> None:
    rows = ((0.8, 0.75), (0.8, 0.7))
    inverse = np.linalg.solve(rows, [1.0, 0.0])
    modal_um, limited = invert(rows, (1.0, 0.0), LIMITS_UM)
    assert modal_um == pytest.approx(inverse * LIMITS_UM[0] / np.max(np.abs(inverse)))
    assert limited


@pytest.mark.parametrize("target_um", [1.0, 1e12])
def test_it_breaks_no_limit_and_makes_no_exception_of_singular_positions(target_um: float) -> None:
    for rows in (((0.5, 0.5), (0.5, 0.5)), ((0.0, 0.0), (0.0, 0.0)), ((0.3, -0.2), (0.1, 0.9)), ((0.4, -0.7),)):
        modal_um, _ = invert(rows, (0.0, target_um)[: len(rows)], LIMITS_UM)
        assert np.all(np.abs(modal_um) <= LIMITS_UM[0])
