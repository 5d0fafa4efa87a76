"""The instant solver: two slipping fingers change signs by turning, within the limits."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pipeline_bench import PLATE, contact_grams

from hapticd.core.phasors import Phasors
from hapticd.core.solver.instant import LEAST_STEP_UM, AskedPlace, InstantSolver, ModalSolution
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings

W_LIMIT_UM = (4.0, 4.0)
STEP_NS = 500_000
positions_mm = st.floats(-60.0, 60.0)


def solver() -> InstantSolver:
    return InstantSolver(PLATE, W_LIMIT_UM)


def walked(chosen: InstantSolver, first_um: float, second_um: float) -> list[ModalSolution]:
    """The second finger crosses the plate, and with it many singular positions; the first one rests."""
    solutions: list[ModalSolution] = []
    previous_um: Phasors = (0j, 0j)
    for step in range(2000):
        places: list[AskedPlace] = [(-9.0, -4.0, first_um), (-50.0 + 0.05 * step, 21.0 - 0.011 * step, second_um)]
        solutions.append(chosen.solve(places, previous_um, STEP_NS))
        previous_um = solutions[-1].modal_um
    return solutions


def shapes_at(solution: ModalSolution) -> np.ndarray:
    return PLATE.evaluate([place[:2] for place in solution.places])


def least_midway_um(solutions: list[ModalSolution]) -> float:
    """The least that a finger gets halfway between two solutions that both serve, where the board interpolates."""
    least_um = math.inf
    for before, after in pairwise(solutions):
        if before.limited or after.limited:
            continue
        middle_um = (np.array(before.modal_um) + np.array(after.modal_um)) / 2
        least_um = min(least_um, float(np.abs(shapes_at(after) @ middle_um).min()))
    return least_um


def test_two_slipping_fingers_pass_singular_positions_without_a_dip() -> None:
    assert least_midway_um(walked(solver(), 1.0, 1.0)) > 0.7  # signs alone: less than 0.1


@pytest.mark.parametrize("wanted_um", [(1.0, 0.0), (0.0, 1.0)])
def test_with_one_finger_still_amplitudes_are_real_and_it_gets_nothing(wanted_um: tuple[float, float]) -> None:
    for solution in walked(solver(), *wanted_um):
        assert not any(w_um.imag for w_um in solution.modal_um)
        assert solution.achieved_um[wanted_um.index(0.0)] < 1e-15


def test_from_turned_amplitudes_a_finger_that_becomes_still_gets_0_phase_stays() -> None:
    chosen = solver()
    before = next(one for one in walked(chosen, 1.0, 1.0)[100:] if min(abs(w.imag) for w in one.modal_um) > 0.1)
    after = chosen.solve([before.places[0], (*before.places[1][:2], 0.0)], before.modal_um, STEP_NS)
    assert abs(shapes_at(after)[1] @ np.array(after.modal_um)) < 1e-14
    assert np.vdot(after.modal_um, before.modal_um).real > 0.0
    assert abs(np.vdot(after.modal_um, before.modal_um).imag) < 1e-9
    assert all(abs(w_um) <= limit_um for w_um, limit_um in zip(after.modal_um, W_LIMIT_UM, strict=True))


def test_when_one_of_two_slipping_fingers_lifts_the_other_feels_nothing_of_it() -> None:
    chosen = solver()
    before = walked(chosen, 1.0, 1.0)
    turned = next(solution for solution in before if not solution.limited and any(w.imag for w in solution.modal_um))
    alone = chosen.solve(turned.places[:1], turned.modal_um, STEP_NS)

    midway_um = (np.array(turned.modal_um) + np.array(alone.modal_um)) / 2
    assert alone.achieved_um == pytest.approx([1.0], rel=1e-3)
    assert abs(shapes_at(alone)[0] @ midway_um) > 0.9


@given(
    places=st.lists(
        st.tuples(positions_mm, positions_mm, st.sampled_from((0.0, 0.3, 1.0, 4.0))), min_size=1, max_size=5
    ),
    previous_um=st.tuples(*[st.complex_numbers(max_magnitude=4.0, allow_nan=False)] * 2),
    since_ns=st.integers(0, 20_000_000),
)
@example(  # an angle below the range of floats
    places=[(0.0, 0.0, 0.0), (16.0, 0.0, 0.3), (-29.0, 0.0, 0.3)], previous_um=(5e-324 + 3j, 0j), since_ns=0
)
@settings(max_examples=60)
def test_no_mode_passes_its_limit_for_any_targets(
    places: list[AskedPlace], previous_um: Phasors, since_ns: int
) -> None:
    solution = solver().solve(places, previous_um, since_ns)
    assert all(math.hypot(w.real, w.imag) <= limit for w, limit in zip(solution.modal_um, W_LIMIT_UM, strict=True))


def test_with_a_radius_fingers_are_contacts_and_what_they_get_is_their_rms() -> None:
    plate = GroundTruth(PlateSettings.of("fingertip"))
    modes = plate.measured_mode_map(1)
    chosen = InstantSolver(modes, plate.w_limit_um, contact_radius_mm=5.0)
    solution = chosen.solve([(-40.0, 10.0, 1.0), (35.0, -20.0, 0.0)], (0j,) * 4, 20_000_000)
    grams = contact_grams(modes, [(-40.0, 10.0), (35.0, -20.0)], 5.0)
    modal_um = np.array(solution.modal_um)

    assert solution.achieved_um == pytest.approx(
        [math.sqrt((modal_um.conj() @ gram @ modal_um).real) for gram in grams], rel=0.01, abs=0.01
    )
    assert solution.achieved_um[0] > 8.0 * solution.achieved_um[1]
    assert all(abs(w_um) <= limit_um for w_um, limit_um in zip(solution.modal_um, plate.w_limit_um, strict=True))


def test_a_finger_that_lands_turns_the_amplitudes_no_faster_than_the_plate_follows() -> None:
    plate = GroundTruth(PlateSettings.of("fingertip"))
    chosen = InstantSolver(plate.true_mode_map(), plate.w_limit_um, contact_radius_mm=5.0)
    slipping, landed = (-40.0, 10.0, 1.0), (35.0, -20.0, 0.0)
    modal_um: Phasors = (0j,) * 4
    for _ in range(20):
        modal_um = chosen.solve([slipping], modal_um, 8_000_000).modal_um
    first = chosen.solve([slipping, landed], modal_um, 0)
    assert 0.5 < max(abs(now - was) for now, was in zip(first.modal_um, modal_um, strict=True)) <= LEAST_STEP_UM + 1e-9
    second = chosen.solve([slipping, landed], first.modal_um, 17_000_000)
    assert second.achieved_um[1] < 0.7 * first.achieved_um[1]
    assert not any(chosen.solve([(-40.0, 10.0, 0.0), landed], second.modal_um, 0).modal_um)  # silence is never slow
