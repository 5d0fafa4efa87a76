"""Contacts: the sum is least, limits hold whatever comes, and amplitudes follow fingers and targets without a jump."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import eigh
from scipy.optimize import minimize_scalar

from hapticd.core.plate.contact import contact_gram, disc_points
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.core.solver import solve
from hapticd.core.solver.contacts import (
    BUILT_IN,
    UNCERTAIN_FRAC,
    solve_contacts,
)
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings

Array = npt.NDArray[np.float64]
FINGERTIP = GroundTruth(PlateSettings.of("fingertip"))
LIMITS_UM = FINGERTIP.w_limit_um
DISC = disc_points(5.0)


@pytest.fixture(scope="module")
def plate() -> ModeShapes:
    return FINGERTIP.measured_mode_map(1)


def grams_at(plate: ModeShapes, points_mm: npt.ArrayLike) -> list[list[list[float]]]:
    return [contact_gram(plate, DISC, x_mm, y_mm) for x_mm, y_mm in np.asarray(points_mm, float).tolist()]


def solved(
    grams: list[list[list[float]]],
    targets_um: tuple[float, ...],
    limits_um: tuple[float, ...] = LIMITS_UM,
    start: npt.NDArray[np.complex128] | None = None,
    calls: int = 1,
) -> tuple[npt.NDArray[np.complex128], list[float]]:
    start = np.zeros(len(limits_um), complex) if start is None else start
    d_um, q_um = start.real.tolist(), start.imag.tolist()
    for _ in range(calls):
        achieved_um, _ = solve_contacts(grams, targets_um, limits_um, d_um, q_um)
    return np.array(d_um) + 1j * np.array(q_um), achieved_um


def cost(grams: list[list[list[float]]], targets_um: tuple[float, ...], modal_um: npt.NDArray[np.complex128]) -> float:
    total = 0.0
    for gram, target_um in zip(np.array(grams), targets_um, strict=True):
        square = float((modal_um.conj() @ expected(gram) @ modal_um).real)
        total += BUILT_IN.error(math.sqrt(square), target_um)
    return total


def expected(gram: Array) -> Array:
    return gram + UNCERTAIN_FRAC**2 * np.diag(np.diag(gram))


def pairs(seed: int, count: int) -> list[Array]:
    random, found = np.random.default_rng(seed), []
    while len(found) < count:
        points_mm = random.uniform(-80.0, 80.0, (2, 2))
        if np.hypot(*(points_mm[0] - points_mm[1])) > 20.0:
            found.append(points_mm)
    return found


def test_within_ample_limits_the_sum_is_that_of_the_generalized_eigenvalue(plate: ModeShapes) -> None:
    """One slipping finger: of all W that give it r the still one gets r over the largest contrast."""
    excess = []
    for points_mm in pairs(1, 40):
        grams = grams_at(plate, points_mm)
        slip, still = (expected(gram) for gram in np.array(grams))
        contrast = math.sqrt(eigh(slip, still)[0][-1])
        least = minimize_scalar(
            lambda r_um, contrast=contrast: BUILT_IN.error(r_um, 1.0) + BUILT_IN.error(r_um / contrast, 0.0),
            bounds=(0.0, 1.0),
        )
        modal_um, _ = solved(grams, (1.0, 0.0), (1e3,) * 4, calls=30)
        excess.append(cost(grams, (1.0, 0.0), modal_um) - least.fun)
    assert min(excess) > -1e-6
    assert np.median(excess) < 1e-4
    assert np.mean(np.array(excess) < 0.04) > 0.8  # some pairs have two optima


def test_a_contact_that_slides_where_the_curve_depends_on_speed_needs_more_amplitude(plate: ModeShapes) -> None:
    grams = grams_at(plate, [(-40.0, 10.0), (35.0, -20.0)])
    d_um, q_um = [0.0] * 4, [0.0] * 4
    for _ in range(20):
        slow_um, _ = solve_contacts(grams, (0.3, 0.0), LIMITS_UM, d_um, q_um)
    for _ in range(20):
        fast_um, _ = solve_contacts(grams, (0.6, 0.0), LIMITS_UM, d_um, q_um, BUILT_IN, [2.0, 2.0])
    assert fast_um == pytest.approx([2.0 * rms_um for rms_um in slow_um], rel=0.01)


def test_one_descent_ends_near_the_best_of_many_starts(plate: ModeShapes) -> None:
    random, own, best = np.random.default_rng(2), 0.0, 0.0
    for points_mm in pairs(3, 30):
        grams, targets_um = grams_at(plate, points_mm), (1.0, 0.0)
        starts = [random.normal(size=4) + 1j * random.normal(size=4) for _ in range(5)]
        own += cost(grams, targets_um, solved(grams, targets_um, calls=4)[0])
        best += min(cost(grams, targets_um, solved(grams, targets_um, start=start, calls=12)[0]) for start in starts)
    assert own < 1.05 * best


def test_amplitudes_follow_the_fingers_without_a_jump(plate: ModeShapes) -> None:
    """Along straight ways through the plate in steps of 0.1 mm, from knot to knot."""
    for begin_mm, end_mm in zip(pairs(6, 6), pairs(7, 6), strict=True):
        modal_um, _ = solved(grams_at(plate, begin_mm), (1.0, 0.0), calls=8)
        steps = int(np.hypot(*(end_mm - begin_mm).T).max() / 0.1)
        for share in np.linspace(0.0, 1.0, steps):
            before_um = modal_um
            modal_um, _ = solved(grams_at(plate, begin_mm + share * (end_mm - begin_mm)), (1.0, 0.0), start=before_um)
            assert np.abs(modal_um - before_um).max() < 1.0  # a flip would be 8 um


def test_no_slipping_finger_is_silence_and_the_start_is_the_same_each_time(plate: ModeShapes) -> None:
    grams = grams_at(plate, [(-40.0, 10.0), (35.0, -20.0)])
    assert not np.any(solved(grams, (0.0, 0.0), start=np.ones(4) + 0j)[0])
    assert np.array_equal(solved(grams, (1.0, 0.0))[0], solved(grams, (1.0, 0.0))[0])


@given(st.data())
def test_whatever_the_contacts_amplitudes_are_finite_and_within_the_limits(data: st.DataObject) -> None:
    """Two to eight modes, up to six contacts, some on top of each other, some that move nothing, at any scale."""
    modes, fingers = data.draw(st.integers(2, 8)), data.draw(st.integers(1, 6))
    random = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    phi = random.normal(size=(fingers, 7, modes)) * 10.0 ** data.draw(st.integers(-160, 120))
    phi[:, 1:] = phi[:, :1] + phi[:, 1:] * 10.0 ** data.draw(st.integers(-17, 0))
    if data.draw(st.booleans()):
        phi[-1] = phi[0]
    if data.draw(st.booleans()):
        phi[0] = 0.0
    grams = np.einsum("nqk,nql->nkl", phi, phi)
    targets_um = tuple(
        data.draw(st.lists(st.sampled_from((0.0, 1e-9, 0.5, 1.0, 1e6)), min_size=fingers, max_size=fingers))
    )
    limits_um = tuple((10.0 ** random.uniform(-3, 2, modes)).tolist())
    modal_um, _ = solved(grams.tolist(), targets_um, limits_um)
    for _ in range(3):
        assert np.isfinite(modal_um).all()
        assert np.all(np.abs(modal_um) <= np.array(limits_um) * (1.0 + 1e-12))
        modal_um, _ = solved(grams.tolist(), targets_um, limits_um, start=modal_um)


def test_solve_with_grams_gives_real_amplitudes_and_the_rms_of_each_contact(plate: ModeShapes) -> None:
    points_mm = [(-40.0, 10.0), (35.0, -20.0)]
    phi, grams = plate.evaluate(points_mm), np.array(grams_at(plate, points_mm))
    solution = solve(phi, [1.0, 0.0], LIMITS_UM, gram=grams)
    rms_um = [math.sqrt(solution.modal_um @ gram @ solution.modal_um) for gram in grams]
    assert solution.achieved_um == pytest.approx(rms_um)
    assert rms_um[0] > 10.0 * rms_um[1]
    assert solve(phi, [1.0, 0.0], LIMITS_UM).achieved_um[1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("gram", [np.zeros((2, 2)), np.full((2, 2, 2), np.nan), "three"])
def test_a_gram_of_another_shape_or_not_finite_is_one_sentence(gram: object) -> None:
    with pytest.raises(ValueError, match=r"^gram: .*\."):
        solve(np.eye(2), [1.0, 0.0], 4.0, gram=gram)
