"""Hostile input: the result is finite and within the limits to the last bit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.solver import solve

awkward = st.sampled_from(
    [0.0, -0.0, 1.0, 0.3, 5e-324, -1e-320, 1e-308, 1e-300, 1e-160, 1e17, 1e160, 1e300, -1.7e308, 1 + 2**-52]
) | st.floats(-1.0, 1.0)
limit = st.sampled_from([4.0, 4.0, 3.3, 1e-300, 5e-324, 1e300])


@given(st.data())
def test_the_result_is_finite_and_within_the_limits(data: st.DataObject) -> None:
    """Fingers and modes of any number, some fingers coincident, values from every corner of the floats."""
    modes, fingers = data.draw(st.integers(1, 5)), data.draw(st.integers(0, 4))
    rows = [[data.draw(awkward) for _ in range(modes)] for _ in range(fingers)]
    if fingers > 1 and data.draw(st.booleans()):
        rows[1] = rows[0]
    targets = [data.draw(st.just(0.0) | awkward.map(abs)) for _ in range(fingers)]
    limits = [data.draw(limit) for _ in range(modes)]
    previous = data.draw(st.none() | st.lists(awkward, min_size=modes, max_size=modes))
    solution = solve(np.reshape(rows, (fingers, modes)), targets, limits, previous_um=previous)
    assert np.isfinite(solution.modal_um).all()
    assert np.isfinite(solution.achieved_um).all()
    assert all(-bound <= w <= bound for w, bound in zip(solution.modal_um.tolist(), limits, strict=True))
    assert isinstance(solution.limited, bool)


@pytest.mark.parametrize("scale", [1e-300, 1e-150, 1e150, 1e300])
@pytest.mark.parametrize("modes", [2, 3])
def test_the_scale_of_phi_and_of_the_targets_does_not_matter(scale: float, modes: int) -> None:
    """phi and targets both scaled leave W as it was, where both slip and where one is still."""
    phi = np.random.default_rng(3).uniform(-1, 1, (2, modes))
    for target in (np.array([1.0, 0.5]), np.array([1.0, 0.0]), np.array([60.0, 50.0])):
        plain = solve(phi, target, 4.0)
        scaled = solve(phi * scale, target * scale, 4.0)
        assert scaled.modal_um == pytest.approx(plain.modal_um, rel=1e-9, abs=1e-12)
        assert scaled.limited == plain.limited


@pytest.mark.parametrize(("fingers", "modes"), [(15, 8), (15, 2), (3, 8), (1, 8), (8, 1), (0, 3)])
@pytest.mark.parametrize("kind", ["random", "equal rows", "zero rows", "tiny", "huge"])
def test_up_to_fifteen_fingers_on_eight_modes_are_solved_within_the_limits(kind: str, fingers: int, modes: int) -> None:
    random = np.random.default_rng(fingers + modes)
    phi = random.uniform(-1, 1, (fingers, modes))
    if kind == "equal rows":
        phi = phi[:1].repeat(fingers, 0)
    elif kind == "zero rows":
        phi *= random.random((fingers, 1)) < 0.5
    phi *= {"tiny": 1e-300, "huge": 1e300}.get(kind, 1.0)
    targets = random.uniform(0.1, 3.0, fingers) * (random.random(fingers) < 0.7)
    solution = solve(phi, targets, 4.0, previous_um=random.normal(size=modes))
    assert np.all(np.abs(solution.modal_um) <= 4.0)
    assert np.isfinite(solution.achieved_um).all()
