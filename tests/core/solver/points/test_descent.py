"""Many fingers: the descent serves them as well as the best signs, within the limits, and follows without a jump."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.core.solver.instant import AskedPlace, InstantSolver
from hapticd.core.solver.points import general, sign_patterns
from hapticd.core.solver.points.descent import serve_many
from hapticd.core.solver.points.general import solve_exactly, solve_fast
from hapticd.core.solver.points.phase import solve_phased_fast

Array = npt.NDArray[np.float64]
Rows = tuple[tuple[float, ...], ...]
LIMIT_UM = 4.0
STEP_NS = 1_500_000

awkward = st.sampled_from(
    [0.0, -0.0, 1.0, 0.3, 5e-324, -1e-320, 1e-308, 1e-300, 1e-160, 1e17, 1e160, 1e300, -1.7e308, 1 + 2**-52]
) | st.floats(-1.0, 1.0)
never = st.sampled_from([math.nan, math.inf, -math.inf])
limit = st.sampled_from([4.0, 4.0, 3.3, 1e-300, 5e-324, 1e-318, 1e300])


def as_rows(phi: Array) -> Rows:
    return tuple(map(tuple, phi.tolist()))


def missed_um2(phi: Array, target_um: Array, modal: npt.ArrayLike) -> float:
    got = np.abs(phi @ np.asarray(modal))
    return float(np.sum((got - target_um)[target_um > 0.0] ** 2))


def many(random: np.random.Generator) -> tuple[Array, Array]:
    """Six to ten fingers on two to eight modes; what the still ones leave has more than one direction."""
    while True:
        fingers, modes = int(random.integers(6, 11)), int(random.choice((2, 3, 4, 8)))
        target_um = random.uniform(0.3, 1.5, fingers) * (random.random(fingers) < random.choice((0.5, 0.75, 1.0)))
        if np.sum(target_um > 0.0) > 5 and np.sum(target_um == 0.0) < modes - 1:
            return random.uniform(-1, 1, (fingers, modes)), target_um


@pytest.mark.parametrize("limit_um", [4.0, 1.0])
def test_free_phases_serve_many_fingers_better_than_the_best_of_all_signs(limit_um: float) -> None:
    random = np.random.default_rng(7)
    errors = []
    for _ in range(40):
        phi, target_um = many(random)
        problem = as_rows(phi), tuple(target_um.tolist()), (limit_um,) * phi.shape[1]
        solved = [way(*problem)[0] for way in (solve_exactly, solve_phased_fast, solve_fast)]
        assert all(np.abs(phi[target_um == 0.0] @ modal).max(initial=0.0) < 1e-13 for modal in solved)
        errors.append([missed_um2(phi, target_um, modal) for modal in solved])
    best_signs, phases, signs = np.mean(errors, axis=0).tolist()
    assert phases < 0.95 * best_signs
    assert signs < 1.25 * best_signs


@pytest.mark.parametrize("still", [0, 1])
def test_a_single_slipping_finger_on_three_modes_gets_what_the_best_amplitudes_give(still: int) -> None:
    random = np.random.default_rng(still)
    shares, lengths = [], []
    for _ in range(60):
        rows = as_rows(random.uniform(-1, 1, (still + 1, 3)))
        targets = (*[0.0] * still, float(random.choice((0.3, 3.0, 30.0))))
        modal, _ = solve_fast(rows, targets, (LIMIT_UM,) * 3, tuple(random.uniform(-4, 4, 3).tolist()))
        best, _ = solve_exactly(rows, targets, (LIMIT_UM,) * 3)
        shares.append(abs(float(np.dot(rows[-1], modal))) / abs(float(np.dot(rows[-1], best))))
        lengths.append(np.linalg.norm(modal) / np.linalg.norm(best))
    assert np.mean(shares) > 0.98
    assert min(shares) > 0.8
    assert max(lengths) < 1.05


def test_as_many_still_fingers_as_modes_silence_the_plate_and_those_on_one_spot_count_once() -> None:
    random = np.random.default_rng(3)
    phi = random.uniform(-1, 1, (11, 3))
    before = (1.0 + 1.0j, -2.0 + 0j, 0.5j)
    for still, is_silent in ((2, False), (3, True), (5, True)):
        targets = tuple([0.0] * still + [1.0] * (11 - still))
        modal, limited = solve_phased_fast(as_rows(phi), targets, (LIMIT_UM,) * 3, before)
        assert (not any(modal)) is is_silent
        assert not (is_silent and limited)
    phi[1:5] = phi[0] * np.array([[1.0], [-1.0], [2.0], [1.0]])
    modal, _ = solve_phased_fast(as_rows(phi), (0.0,) * 5 + (1.0,) * 6, (LIMIT_UM,) * 3, before)
    got_um = np.abs(phi @ np.array(modal))
    assert got_um[:5].max() < 1e-14
    assert got_um[5:].min() > 0.05


@settings(max_examples=200, deadline=None)
@given(data=st.data(), is_real=st.booleans())
def test_whatever_many_fingers_ask_for_amplitudes_are_finite_and_within_the_limits_to_the_last_bit(
    data: st.DataObject, is_real: bool
) -> None:
    modes, fingers = data.draw(st.integers(1, 8)), data.draw(st.integers(0, 27))
    random = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    phi = random.uniform(-1, 1, (fingers, modes)) * 10.0 ** data.draw(st.sampled_from((-318, -300, -160, 0, 150, 300)))
    rows = [list(row) for row in phi.tolist()]
    for _ in range(data.draw(st.integers(0, 3)) if fingers else 0):
        rows[data.draw(st.integers(0, fingers - 1))][data.draw(st.integers(0, modes - 1))] = data.draw(awkward)
    if fingers > 2 and data.draw(st.booleans()):
        rows[1:] = [rows[0]] * (fingers - 1)
    targets = tuple([abs(data.draw(st.just(0.0) | awkward)) if place < 4 else 1.0 for place in range(fingers)])
    limits = tuple([data.draw(limit) for _ in range(modes)])
    d_um = [data.draw(awkward | never) for _ in range(modes)]
    q_um = [0.0 if is_real else data.draw(awkward | never) for _ in range(modes)]
    for _ in range(3):
        limited = serve_many(tuple(map(tuple, rows)), targets, limits, d_um, q_um, is_real=is_real)
        assert isinstance(limited, bool)
        assert all(abs(complex(d, q)) <= bound for d, q, bound in zip(d_um, q_um, limits, strict=True))
        assert not (is_real and any(q_um))


def test_a_shape_that_is_no_number_silences_many_fingers() -> None:
    phi = np.random.default_rng(1).uniform(-1, 1, (9, 3))
    for value in (math.nan, math.inf):
        phi[4, 1] = value
        modal, limited = solve_phased_fast(as_rows(phi), (1.0,) * 9, (LIMIT_UM,) * 3, (1 + 1j, 0j, 2 + 0j))
        assert not any(modal)
        assert not limited


def test_a_finger_that_gets_exactly_nothing_begins_to_slip() -> None:
    """Its phase is none, and a step that only keeps phases would leave it where it is."""
    phi = np.eye(6, 8)
    modal = (1 + 0j,) * 5 + (0j,) * 3
    modal, _ = solve_phased_fast(as_rows(phi), (1.0,) * 6, (LIMIT_UM,) * 8, modal)
    assert np.abs(phi @ np.array(modal)) == pytest.approx(np.ones(6), rel=1e-2)


# --- on the way -----------------------------------------------------------------------------------------------------


def waves(modes: int) -> ModeShapes:
    axis_mm = np.linspace(-70.0, 70.0, 61)
    x_mm, y_mm = np.meshgrid(axis_mm, axis_mm)
    shapes = []
    for mode in range(modes):
        along_mm, across_mm = (x_mm, y_mm) if mode % 2 == 0 else (y_mm, x_mm)
        wave = np.sin(2.0 * np.pi * along_mm / (27.0 + 3.0 * mode) + 0.3 * mode)
        shapes.append(0.5 * wave * (1.0 if mode < 2 else np.cos(2.0 * np.pi * across_mm / 60.0)))
    return ModeShapes.from_grid(axis_mm, axis_mm, np.stack(shapes))


def walked(fingers: int, modes: int, steps: int, seed: int) -> tuple[float, float, float]:
    """The largest |W_k| over its limit, the largest still amplitude, and how much further W moves by a way of 1e-7 mm,
    along random ways of 0.2 mm a step; every tenth step some finger changes its target."""
    random = np.random.default_rng(seed)
    shapes, limits = waves(modes), (LIMIT_UM,) * modes
    points_mm, way_mm = random.uniform(-60, 60, (fingers, 2)), random.normal(scale=0.15, size=(fingers, 2))
    targets = random.uniform(0.2, 1.5, fingers)
    modal: tuple[complex, ...] = (0j,) * modes
    beyond = leak_um = apart_um = 0.0
    for step in range(steps):
        points_mm += way_mm
        way_mm = np.where(np.abs(points_mm) > 65.0, -np.sign(points_mm) * np.abs(way_mm), way_mm)
        if step % 10 == 0:
            targets[random.integers(fingers)] = random.choice((0.0, 0.3, 1.0, 1.5))
        asked = tuple(targets.tolist())
        rows = as_rows(shapes.evaluate(points_mm))
        before = modal
        modal, _ = solve_phased_fast(rows, asked, limits, before, descends=True)
        beyond = max(beyond, *[abs(w) / LIMIT_UM for w in modal])
        still = [
            abs(sum([s * w for s, w in zip(row, modal, strict=True)]))
            for row, a in zip(rows, asked, strict=True)
            if a == 0.0
        ]
        leak_um = max(leak_um, *still, 0.0)
        if step % 10 == 5 and len(still) < modes - 1:
            near, _ = solve_phased_fast(
                as_rows(shapes.evaluate(points_mm + 1e-7)), asked, limits, before, descends=True
            )
            apart_um = max(apart_um, *[abs(w - other) for w, other in zip(modal, near, strict=True)])
    return beyond, leak_um, apart_um


@pytest.mark.parametrize(
    ("fingers", "modes", "steps"),
    [(8, 2, 400), (8, 3, 400), (12, 4, 400), (27, 8, 200)]
    + [pytest.param(*sizes, 25_000, marks=pytest.mark.long) for sizes in ((6, 2), (8, 3), (7, 4), (12, 8))],
)
@pytest.mark.timeout(600)
def test_on_random_ways_limits_and_zeros_hold_and_w_is_continuous(fingers: int, modes: int, steps: int) -> None:
    beyond, leak_um, apart_um = walked(fingers, modes, steps, seed=fingers + modes)
    assert beyond <= 1.0
    assert leak_um < 1e-12
    assert apart_um < 1e-3


def largest_steps_um(counts: tuple[int, int], seeds: range) -> list[float]:
    """By how much the amplitudes change when fingers land or lift, from one count to the other; all at rest."""
    steps_um = []
    shapes = waves(2)
    for seed in seeds:
        random = np.random.default_rng(seed)
        solver = InstantSolver(shapes, (LIMIT_UM,) * 2, derating_mm2_um2=0.0, phase_rotation=True)
        places: list[AskedPlace] = [(*random.uniform(-60, 60, 2).tolist(), 1.0) for _ in range(max(counts))]
        modal_um: tuple[complex, ...] = (0.0,) * 2
        for _ in range(60):
            modal_um = solver.solve(places[: counts[0]], modal_um, STEP_NS).modal_um
        after_um = solver.solve(places[: counts[1]], modal_um, STEP_NS).modal_um
        steps_um.append(max([abs(w - was) for w, was in zip(after_um, modal_um, strict=True)]))
    return steps_um


def test_where_the_way_to_solve_changes_amplitudes_turn_no_further_than_elsewhere() -> None:
    """A third slipping finger on two modes is the first that descends."""
    seeds = range(40)
    elsewhere_um = [*largest_steps_um((1, 2), seeds), *largest_steps_um((2, 1), seeds)]
    for counts in ((2, 3), (3, 2)):
        steps_um = largest_steps_um(counts, seeds)
        assert np.median(steps_um) <= np.median(elsewhere_um)
        assert max(steps_um) <= max(elsewhere_um)


@pytest.mark.parametrize(("fingers", "modes"), [(27, 2), (27, 3), (8, 8), (3, 4), (27, 8)])
@pytest.mark.parametrize("phase_rotation", [False, True])
def test_no_pass_enumerates_signs_on_arrays(
    fingers: int, modes: int, phase_rotation: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 8 fingers these took longer than a period of the pad, and two still fingers on one spot were enough."""

    def refused(*_problem: object) -> None:
        raise AssertionError("a pass would wait for this")

    monkeypatch.setattr(sign_patterns, "pose", refused)
    monkeypatch.setattr(general, "pose", refused)
    monkeypatch.setattr(sign_patterns, "null_basis", refused)
    random = np.random.default_rng(fingers)
    solver = InstantSolver(waves(modes), (LIMIT_UM,) * modes, derating_mm2_um2=1.0, phase_rotation=phase_rotation)
    places: list[AskedPlace] = [
        (*random.uniform(-60, 60, 2).tolist(), float(index % 7 > 0)) for index in range(fingers)
    ]
    doubled: list[AskedPlace] = [
        (3.0, 4.0, 0.0),
        (3.0, 4.0, 0.0),
        (20.0, 9.0, 1.0),
        (-20.0, 9.0, 1.0),
        (0.0, -30.0, 0.5),
    ]
    for asked in (places, [*places[1:7], *doubled[:2]], doubled):
        modal_um: tuple[complex, ...] = (0.0,) * modes
        for _ in range(3):
            modal_um = solver.solve(asked, modal_um, STEP_NS).modal_um
