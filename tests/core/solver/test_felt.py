"""Friction as asked: the largest error is least, limits hold whatever comes, and amplitudes follow without a jump."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.friction import DEFAULT_FRICTION_CURVE, FrictionCurve
from hapticd.core.plate.contact import SOLVED_DISC
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.core.solver.felt_descent import descend
from hapticd.core.solver.instant import ITERATIONS, SLEW_UM_NS, InstantSolver, finger_table
from hapticd.core.touch.contact_ellipse import ContactTracker, EllipseScale
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.sim.score import felt
from hapticd.values import WEBER_FRAC

Array = npt.NDArray[np.float64]
Phasors = npt.NDArray[np.complex128]
FINGERTIP = GroundTruth(PlateSettings.of("fingertip"))
LIMITS_UM = FINGERTIP.w_limit_um
PAIR_MM = np.array([(-40.0, 10.0), (35.0, -20.0)])
MS = 1_000_000


@pytest.fixture(scope="module")
def plate() -> ModeShapes:
    return FINGERTIP.true_mode_map()


def solver(plate: ModeShapes, limits_um: tuple[float, ...] = LIMITS_UM, unsure: float = 0.01) -> InstantSolver:
    return InstantSolver(plate, limits_um, contact_radius_mm=5.0, uncertain_frac=unsure)


def places(points_mm: Array, targets_um: tuple[float, ...]) -> list[tuple[float, float, float]]:
    return [(*point_mm, target_um) for point_mm, target_um in zip(points_mm.tolist(), targets_um, strict=True)]


def settled(
    plate: ModeShapes, points_mm: Array, targets_um: tuple[float, ...], *of_solver: Any, priorities: Any = None
) -> Phasors:
    one, modal_um = solver(plate, *of_solver), (0j,) * 4
    for _ in range(40):
        modal_um = one.solve(places(points_mm, targets_um), modal_um, 100 * MS, priorities=priorities).modal_um
    return np.array(modal_um)


def errors_jnd(points_mm: Array, targets_um: tuple[float, ...], modal_um: Phasors) -> Array:
    """The truth, by the simulation's own quadrature."""
    plate_um = np.concatenate((modal_um, np.zeros(len(FINGERTIP.decay_1_s) - len(modal_um))))
    _, frictions = felt(points_mm[None], plate_um[None], FINGERTIP.shapes)
    asked = [DEFAULT_FRICTION_CURVE.friction(target_um) for target_um in targets_um]
    return np.asarray((frictions[0] / asked - 1.0) / WEBER_FRAC)


def apart(seed: int, count: int, fingers: int) -> list[Array]:
    random, found = np.random.default_rng(seed), list[Array]()
    while len(found) < count:
        points_mm = random.uniform(-85.0, 85.0, (fingers, 2))
        gaps_mm = np.linalg.norm(points_mm[:, None] - points_mm, axis=2)
        if gaps_mm[np.triu_indices(fingers, 1)].min() > 20.0:
            found.append(points_mm)
    return found


def pairs(seed: int, count: int) -> list[Array]:
    return apart(seed, count, 2)


@pytest.mark.parametrize(("targets_um", "least"), [((1.0, 0.0), 0.25), ((0.5, 0.0), 0.75)])
def test_both_fingers_feel_what_was_asked_in_this_share_of_places(
    plate: ModeShapes, targets_um: tuple[float, float], least: float
) -> None:
    errors = [np.abs(errors_jnd(pair, targets_um, settled(plate, pair, targets_um))).max() for pair in pairs(3, 40)]
    assert np.mean(np.array(errors) <= 1.0) >= least


def test_where_not_both_can_be_had_the_sticky_finger_is_as_asked(plate: ModeShapes) -> None:
    weak_um = tuple(limit_um / 10.0 for limit_um in LIMITS_UM)
    errors = np.array(
        [errors_jnd(pair, (1.0, 0.0), settled(plate, pair, (1.0, 0.0), weak_um)) for pair in pairs(4, 30)]
    )
    assert np.mean(errors[:, 0] > 1.0) == 1.0
    assert np.mean(np.abs(errors[:, 1]) <= 1.0) > 0.9


# Two fingers that should stick, and a slippery one that takes more than four modes have.
MIXED_UM = (1.0, 0.0, 0.0)


def mixed_errors_jnd(plate: ModeShapes, priorities: list[int]) -> Array:
    """For twelve places of three fingers, (12, 3)."""
    found = [settled(plate, points_mm, MIXED_UM, priorities=priorities) for points_mm in apart(8, 12, 3)]
    return np.abs([errors_jnd(one, MIXED_UM, um) for one, um in zip(apart(8, 12, 3), found, strict=True)])


def test_modes_move_the_sticky_finger_less_if_map_and_sensors_are_less_certain(plate: ModeShapes) -> None:
    um = [plate.evaluate(PAIR_MM[1:]) * settled(plate, PAIR_MM, (1.0, 0.0), LIMITS_UM, off) for off in (0.01, 0.05)]
    assert np.linalg.norm(um[1]) < 0.9 * np.linalg.norm(um[0])


def test_a_higher_priority_lowers_a_slippery_finger_s_error_and_raises_another_s(plate: ModeShapes) -> None:
    equal, higher = mixed_errors_jnd(plate, [0, 0, 0]), mixed_errors_jnd(plate, [1, 0, 0])
    cannot = equal[:, 0] > 1.5
    assert cannot.sum() >= 9
    assert np.all(higher[cannot, 0] < 0.7 * equal[cannot, 0])
    assert np.all(higher[cannot, 1:].max(axis=1) > equal[cannot, 1:].max(axis=1))
    assert np.median(higher[:, 0]) < 1.0


def test_the_second_priority_precedes_the_third_and_of_equal_ones_the_sticky(
    plate: ModeShapes,
) -> None:
    falling = np.median(mixed_errors_jnd(plate, [2, 1, 0]), axis=0)
    assert falling[0] < 1.0
    assert falling[1] < 0.5 * falling[2]
    both_high, equal = (np.quantile(mixed_errors_jnd(plate, of), 0.9, axis=0) for of in ([3, 3, 1], [0, 0, 0]))
    assert both_high[1] < 1.0
    assert both_high[1] < both_high[0] < equal[0]


@pytest.mark.parametrize("friction", [0.3, 0.5, 0.7, 0.8, 0.9, 0.93, 0.95, 0.98])
def test_one_finger_gets_any_friction(plate: ModeShapes, friction: float) -> None:
    target_um = -0.7 * math.log(friction)
    for points_mm in np.random.default_rng(5).uniform(-80.0, 80.0, (10, 1, 2)):
        modal_um = settled(plate, points_mm, (target_um,), (6.0,) * 4)
        assert abs(errors_jnd(points_mm, (target_um,), modal_um)[0]) < 0.8


def test_a_finger_that_slides_where_friction_depends_on_speed_gets_more_amplitude(plate: ModeShapes) -> None:
    got_um = []
    for target_um, speed_gain in ((0.4, 1.0), (0.8, 2.0)):
        one, modal_um = solver(plate, (10.0,) * 4), (0j,) * 4
        for _ in range(40):
            solution = one.solve(places(PAIR_MM, (target_um, 0.0)), modal_um, 100 * MS, [speed_gain, speed_gain])
            modal_um = solution.modal_um
        got_um.append(solution.achieved_um[0])
    assert got_um[1] == pytest.approx(2.0 * got_um[0], rel=0.01)


def test_amplitudes_follow_the_fingers_without_a_jump(plate: ModeShapes) -> None:
    """Along straight ways through the plate at 10 cm/s, a knot each millisecond."""
    steps_um = []
    for begin_mm, end_mm in zip(pairs(6, 6), pairs(7, 6), strict=True):
        modal_um, one = settled(plate, begin_mm, (1.0, 0.0)), solver(plate)
        for share in np.linspace(0.0, 1.0, int(np.hypot(*(end_mm - begin_mm).T).max() / 0.1)):
            points_mm = begin_mm + share * (end_mm - begin_mm)
            before_um, modal_um = (
                modal_um,
                np.array(one.solve(places(points_mm, (1.0, 0.0)), tuple(modal_um.tolist()), MS).modal_um),
            )
            steps_um.append(float(np.abs(modal_um - before_um).max()))
    assert np.quantile(steps_um, 0.99) < 0.75
    assert max(steps_um) < 1.0 + SLEW_UM_NS * MS + 1e-9  # a flip would be 8 um


@given(st.data())
def test_whatever_the_contacts_amplitudes_are_finite_and_within_the_limits(data: st.DataObject) -> None:
    """Two to eight modes, up to six contacts, some on top of each other, some that move nothing, at any scale."""
    modes, fingers = data.draw(st.integers(2, 8)), data.draw(st.integers(1, 6))
    random = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    phi = random.normal(size=(fingers, 5, modes)) * 10.0 ** data.draw(st.integers(-160, 160))
    if data.draw(st.booleans()):
        phi[-1] = phi[0]
    if data.draw(st.booleans()):
        phi[0] = 0.0
    asked_um = st.sampled_from((0.0, 1e-9, 0.1, 0.5, 1.0, 1e6))
    targets_um = data.draw(st.lists(asked_um, min_size=fingers, max_size=fingers))
    curve = data.draw(st.sampled_from((DEFAULT_FRICTION_CURVE, FrictionCurve.from_amplitudes((0.0, 0.2, 1.1), 0.3))))
    limits_um, weights = 10.0 ** random.uniform(-3, 2, modes), np.full(5, 0.2)
    modal_um, logs, priorities = (0j,) * modes, [0.0] * fingers, random.integers(0, 4, fingers).tolist()
    for _ in range(4):
        table = finger_table(curve, targets_um, logs, [1.0] * fingers, priorities)
        given = phi.tobytes(), weights, table, curve.table, limits_um, modal_um
        ((modal_um, _),) = descend(*given, ITERATIONS, (math.inf,))
        logs, rms_um = table[5 * fingers : 6 * fingers].tolist(), table[7 * fingers :].tolist()
        assert np.isfinite(modal_um).all()
        assert np.isfinite(logs).all()
        assert np.all(np.abs(modal_um) <= limits_um)
        expected_um = np.sqrt(np.mean(np.abs(phi @ np.array(modal_um)) ** 2, axis=1))
        assert rms_um == pytest.approx(expected_um, rel=1e-9, abs=1e-150) or not max(targets_um)


@given(st.data())
def test_from_knot_to_knot_amplitudes_are_finite_within_limits_and_within_the_slew(data: st.DataObject) -> None:
    """Contacts anywhere, some on top of each other, with targets from 0 to beyond reach, places hardly known, weights
    at either end, on curves flat and steep."""
    modes = data.draw(st.integers(2, 8))
    random = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    limits_um = tuple((10.0 ** random.uniform(-2, 1, modes)).tolist())
    knots = data.draw(st.sampled_from([(0.0, 0.2, 1.1), (0.0, 0.02, 0.05, 3.0), (0.0, 1.9, 2.0)]))
    floor_frac = data.draw(st.sampled_from([0.001, 0.057, 0.9]))
    grid_mm = np.linspace(-20.0, 20.0, 6)
    one = InstantSolver(
        ModeShapes(grid_mm, grid_mm, random.normal(size=(modes, 6, 6))),
        limits_um,
        contact_radius_mm=5.0,
        friction_curve=FrictionCurve.from_amplitudes(knots, floor_frac),
    )
    modal_um: tuple[complex, ...] = (0j,) * modes
    for _ in range(3):
        count = data.draw(st.integers(1, 6))
        points_mm = random.uniform(-30.0, 30.0, (count, 2))
        if data.draw(st.booleans()):
            points_mm[-1] = points_mm[0]
        wanted_um = data.draw(st.lists(st.sampled_from((0.0, 5e-324, 0.3, 1.0, 1e300)), min_size=count, max_size=count))
        logs, alike = random.choice((0.0, 5e-324, 4.6, -4.6), count).tolist(), [1.0] * count
        one._asked, one._table = (one.curve, [], [], []), finger_table(one.curve, wanted_um, logs, alike, [0] * count)
        since_ns = data.draw(st.sampled_from((1, 500_000, 17_000_000)))
        for _ in range(3):
            before_um = modal_um
            solution = one.solve(places(points_mm, tuple(wanted_um)), before_um, since_ns, alike)
            modal_um = tuple(map(complex, solution.modal_um))
            assert np.isfinite(modal_um).all()
            assert np.isfinite(solution.achieved_um).all()
            assert np.all(np.abs(modal_um) <= limits_um)
            most_um = (1.0 + SLEW_UM_NS * since_ns) * (1.0 + 1e-12)
            assert not max(wanted_um) or np.abs(np.subtract(modal_um, before_um)).max() <= most_um


@given(st.lists(st.tuples(*[st.floats(-1.0, 40.0)] * 2, st.floats(-10.0, 10.0)), min_size=2, max_size=2))
def test_for_any_ellipses_amplitudes_are_finite_and_within_the_exact_limits(
    plate: ModeShapes, ellipses: list[tuple[float, float, float]]
) -> None:
    contacts = [ContactTracker(EllipseScale(1.2, 0.5)) for _ in ellipses]
    for contact, ellipse in zip(contacts, ellipses, strict=True):
        contact.update(*ellipse)
    one, modal_um = solver(plate), (0j,) * 4
    for _ in range(3):
        found = [contact.ellipse for contact in contacts]
        modal_um = one.solve(places(PAIR_MM, (1.0, 0.0)), modal_um, 10 * MS, ellipses=found).modal_um
        assert all(abs(w_um) <= limit_um for w_um, limit_um in zip(modal_um, LIMITS_UM, strict=True))


def test_a_reported_disc_gives_the_bits_of_a_configured_disc(plate: ModeShapes) -> None:
    at = places(PAIR_MM, (1.0, 0.0))
    plain = solver(plate).solve(at, (0j,) * 4, MS)
    reported = solver(plate).solve(at, (0j,) * 4, MS, ellipses=[(5.0, 0.0, 5.0), None])
    assert plain.modal_um == reported.modal_um


def test_a_call_by_contacts_equals_one_by_their_shapes(plate: ModeShapes) -> None:
    at, ours, disc = places(PAIR_MM, (1.0, 0.0)), solver(plate), np.array(SOLVED_DISC)
    table = finger_table(DEFAULT_FRICTION_CURVE, [1.0, 0.0], [0.0] * 2, [1.0] * 2, [0] * 2)
    given = disc[:, 2].copy(), table, DEFAULT_FRICTION_CURVE.table, ours.limits_um, (0j,) * 4, ITERATIONS, (1.5,)
    assert descend(ours.shapes(disc, at), *given)[0][0] == ours.solve(at, (0j,) * 4, MS).modal_um
