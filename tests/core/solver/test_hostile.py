"""Hostile input: the result is finite and within the limits to the last bit, silent where phi is not finite."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hapticd.core.phasors import Row
from hapticd.core.solver import solve
from hapticd.core.solver.points.general import solve_fast, solve_general
from hapticd.core.solver.points.phase import solve_phased_fast

awkward = st.sampled_from(
    [0.0, -0.0, 1.0, 0.3, 5e-324, -1e-320, 1e-308, 1e-300, 1e-160, 1e17, 1e160, 1e300, -1.7e308, 1 + 2**-52]
) | st.floats(-1.0, 1.0)
never = st.sampled_from([math.nan, math.inf, -math.inf])
limit = st.sampled_from([4.0, 4.0, 3.3, 1e-300, 5e-324, 1e300])


@st.composite
def problems(draw: st.DrawFn, amplitudes: st.SearchStrategy[complex] = awkward) -> dict[str, object]:
    """Fingers and modes of any number, some fingers coincident, values from every corner of the floats."""
    modes, fingers = draw(st.integers(1, 5)), draw(st.integers(0, 4))
    rows = [tuple(draw(awkward) for _ in range(modes)) for _ in range(fingers)]
    if fingers > 1 and draw(st.booleans()):
        rows[1] = rows[0]
    return {
        "rows": tuple(rows),
        "targets": tuple(draw(st.just(0.0) | awkward.map(abs)) for _ in range(fingers)),
        "limits": tuple(draw(limit) for _ in range(modes)),
        "previous": draw(st.none() | st.tuples(*[amplitudes] * modes)),
    }


@settings(max_examples=300)
@given(problem=problems())
def test_the_result_is_finite_and_within_the_limits(problem: dict[str, object]) -> None:
    limits = problem["limits"]
    for solve_any in (solve_fast, solve_general):
        modal, limited = solve_any(**problem)
        assert isinstance(limited, bool)
        assert len(modal) == len(limits)
        assert all(-bound <= w <= bound for w, bound in zip(modal, limits, strict=True))


@settings(max_examples=300)
@given(
    problem=problems(st.builds(complex, awkward, awkward | st.just(math.nan))),
    turn_rad=st.sampled_from([0.0, 0.4, 1e300]),
)
def test_phasors_are_finite_and_within_the_limits(problem: dict[str, object], turn_rad: float) -> None:
    modal, limited = solve_phased_fast(**problem, turn_rad=turn_rad)
    assert isinstance(limited, bool)
    assert all(abs(w) <= bound for w, bound in zip(modal, problem["limits"], strict=True))


@pytest.mark.parametrize(
    ("rows", "targets", "limits", "previous", "turn_rad"),
    [
        (((0.3, 1e300), (1e-300, 0.3)), (0.4, 0.3), (1e300, 1e300), (1e-300 + 5e-324j, -0.4 - 1e-320j), 0.4),
        (((1.0, 1e-160), (1e160, 1e-300)), (0.7, 1e-160), (4.0, 1e300), (0.3 + 1j, 1e-160 - 0.4j), 0.0),
        (((-0.4, 1e160), (1.0, 1e160)), (1e17, 1e17), (4.0, 4.0), None, 0.0),
        (((-1e-320, 1e-300), (1.0, 1e17)), (1e-300, 1e17), (4.0, 1e300), None, 0.4),
    ],
    ids=[
        "squares overflow",
        "limits of unlike size",
        "phasors cancel to the last digit",
        "they cancel, one limit huge",
    ],
)
def test_two_phasors_at_the_ends_of_the_range_break_no_limit(
    rows: tuple[Row, ...], targets: Row, limits: Row, previous: Row | None, turn_rad: float
) -> None:
    modal, _ = solve_phased_fast(rows, targets, limits, previous, turn_rad)
    assert all(abs(w) <= limit for w, limit in zip(modal, limits, strict=True))


@given(problem=problems(), value=never, where=st.integers(0, 100))
@example(
    problem={"rows": ((1.0, 0.0),), "targets": (1.0,), "limits": (4.0, 4.0), "previous": None}, value=math.nan, where=1
)
def test_a_phi_that_is_not_finite_gives_silence(problem: dict[str, object], value: float, where: int) -> None:
    rows = [list(row) for row in problem["rows"]]
    if not rows:
        return
    rows[where % len(rows)][where % len(rows[0])] = value
    problem = problem | {"rows": tuple(tuple(row) for row in rows)}
    modal, limited = solve_fast(**problem)
    assert not any(modal)
    assert not limited


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
    targets = tuple((random.uniform(0.1, 3.0, fingers) * (random.random(fingers) < 0.7)).tolist())
    previous = tuple((random.normal(size=modes) + 1j * random.normal(size=modes)).tolist())
    rows = tuple(map(tuple, phi.tolist()))
    for modal in (
        solve_fast(rows, targets, (4.0,) * modes)[0],
        solve_phased_fast(rows, targets, (4.0,) * modes, previous)[0],
    ):
        assert all(abs(w) <= 4.0 for w in modal)
