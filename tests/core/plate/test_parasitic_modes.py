"""Modes that only fingers drive: what they give a still finger is taken back, and no limit is passed for it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.core.plate.parasitic_modes import NODE_SHAPE_SQUARED, ParasiticModes, _all_zeroed
from hapticd.core.solver.instant import AskedPlace, InstantSolver

LIMIT_UM = (4.0, 4.0)
FINGER_DECAY_1_S = 100.0
DECAY_1_S, DETUNING_RAD_S = (180.0, 185.0), (470.0, 590.0)
STEP_NS = 2_800_000
positions_mm = st.floats(-60.0, 60.0)


def waves(wavelength_mm: float) -> ModeShapes:
    axis_mm = np.linspace(-68.75, 68.75, 111)
    wave = 0.5 * np.sin(2 * np.pi * axis_mm / wavelength_mm)
    return ModeShapes.from_grid(axis_mm, axis_mm, np.stack([np.tile(wave, (111, 1)), np.tile(wave, (111, 1)).T]))


DRIVEN, OTHERS = waves(27.0), waves(31.0)
NEIGHBOURS = ParasiticModes(OTHERS, DECAY_1_S, DETUNING_RAD_S, FINGER_DECAY_1_S)


def solver(parasitic_modes: ParasiticModes | None) -> InstantSolver:
    return InstantSolver(DRIVEN, LIMIT_UM, derating_mm2_um2=0.0, phase_rotation=True, parasitic_modes=parasitic_modes)


def felt_um(
    places: list[AskedPlace], modal_um: tuple[complex, ...], load_1_s: complex = FINGER_DECAY_1_S
) -> np.ndarray:
    """What each finger gets of all modes, by their equation of motion run to rest in steps of 50 us."""
    points = [place[:2] for place in places]
    phi, near = DRIVEN.evaluate(points), OTHERS.evaluate(points)
    driven_um = phi @ np.array(modal_um)
    others_um = np.zeros(2, complex)
    rate_1_s = -np.array(DECAY_1_S) + 1j * np.array(DETUNING_RAD_S)
    for _ in range(2000):
        others_um = others_um + 50e-6 * (rate_1_s * others_um - load_1_s * near.T @ (driven_um + near @ others_um))
    return np.asarray(driven_um + near @ others_um)


PLACES: list[AskedPlace] = [(-11.0, 17.0, 1.0), (20.5, -7.0, 0.0)]


def test_a_still_finger_feels_far_less_when_the_neighbours_are_known() -> None:
    unknown, known = (solver(given).solve(PLACES, (0.0, 0.0), STEP_NS).modal_um for given in (None, NEIGHBOURS))
    before_um, after_um = (abs(felt_um(PLACES, modal_um)) for modal_um in (unknown, known))
    assert before_um[1] > 0.005
    assert after_um[1] < 0.05 * before_um[1]
    assert after_um[0] == pytest.approx(before_um[0], rel=0.02)


@pytest.mark.parametrize("load_1_s", [1000.0, 100.0 - 300.0j, 100.0 + 300.0j, 100.0 - 1200.0j])
def test_heavy_fingers_and_those_that_detune_are_compensated_as_well(load_1_s: complex) -> None:
    known = ParasiticModes(OTHERS, DECAY_1_S, DETUNING_RAD_S, load_1_s.real, -load_1_s.imag)
    by_usual, by_own = (
        abs(felt_um(PLACES, solver(given).solve(PLACES, (0.0, 0.0), STEP_NS).modal_um, load_1_s))[1]
        for given in (NEIGHBOURS, known)
    )
    assert by_own < 0.1 * by_usual


def test_a_load_that_puts_a_mode_on_the_drive_is_not_divided_by() -> None:
    place: AskedPlace = (-11.0, 17.0, 0.0)
    shape = np.array(OTHERS.at(*place[:2]))
    own_1_s = np.array((1e-9, 1.0)) - 1j * np.array((470.0, 590.0))
    resonant_1_s = -1.0 / np.sum(shape**2 / own_1_s)
    modes = ParasiticModes(OTHERS, (1e-9, 1.0), (470.0, 590.0), resonant_1_s.real, -resonant_1_s.imag)
    phi = (DRIVEN.at(*place[:2]), DRIVEN.at(20.5, -700.0))
    modal_um = modes.silenced([place, (20.5, -700.0, 1.0)], phi, (1.0, -2.0), LIMIT_UM)
    assert np.isfinite(modal_um).all()


def test_several_still_fingers_share_the_least_change() -> None:
    three = ModeShapes.from_grid(
        DRIVEN.x_mm, DRIVEN.y_mm, np.concatenate((DRIVEN.shapes, waves(23.0).shapes[:1] * waves(35.0).shapes[1:] * 2))
    )
    places: list[AskedPlace] = [*PLACES, (-40.0, -33.0, 0.0)]
    phi = three.evaluate([place[:2] for place in places])
    still = np.linalg.svd(phi[1:])[2][-1]
    before = tuple((2.0 * still).tolist())
    after = NEIGHBOURS.silenced(places, tuple(map(tuple, phi.tolist())), before, (4.0,) * 3)
    near = OTHERS.evaluate([place[:2] for place in places])
    own_1_s = np.array(DECAY_1_S) - 1j * np.array(DETUNING_RAD_S)
    moved = np.linalg.inv(np.eye(3) + FINGER_DECAY_1_S * (near / own_1_s) @ near.T)

    def of_still(modal_um: tuple[complex, ...]) -> float:
        return float(np.abs(moved @ phi @ np.array(modal_um))[1:].max())

    assert of_still(after) < 0.2 * of_still(before)


@given(st.lists(st.tuples(positions_mm, positions_mm, st.sampled_from((0.0, 1.0, 4.0))), min_size=1, max_size=4))
@settings(max_examples=60)
def test_no_mode_passes_its_limit(places: list[AskedPlace]) -> None:
    moment = solver(NEIGHBOURS).solve(places, (4.0 + 0j, -4.0 + 0j), STEP_NS)
    assert all(abs(w_um) <= limit_um for w_um, limit_um in zip(moment.modal_um, LIMIT_UM, strict=True))


def test_one_slipping_finger_keeps_its_sign_from_knot_to_knot_though_amplitudes_are_complex() -> None:
    def walked(chosen: InstantSolver) -> np.ndarray:
        modal_um: list[tuple[complex, ...]] = [(0.0, 0.0)]
        for step in range(400):
            places = [(-30.0 + 0.1 * step, 17.0, 1.0), (24.0, -8.0 + 0.05 * step, 0.0)]
            modal_um.append(chosen.solve(places, modal_um[-1], STEP_NS).modal_um)
        return np.array(modal_um)

    assert np.abs(walked(solver(NEIGHBOURS)) - walked(solver(None))).max() < 0.5


def test_numbers_that_do_not_belong_to_the_modes_are_refused() -> None:
    with pytest.raises(ValueError, match="as many decays"):
        ParasiticModes(OTHERS, (180.0,), DETUNING_RAD_S, 100.0)
    with pytest.raises(ValueError, match="above 0"):
        ParasiticModes(OTHERS, (180.0, 0.0), DETUNING_RAD_S, 100.0)
    for infinite in (float("nan"), float("inf")):
        with pytest.raises(ValueError, match="finite"):
            ParasiticModes(OTHERS, DECAY_1_S, (DETUNING_RAD_S[0], infinite), 100.0)
        with pytest.raises(ValueError, match="finite"):
            ParasiticModes(OTHERS, DECAY_1_S, DETUNING_RAD_S, infinite)


@given(seed=st.integers(0, 10**6), modes=st.integers(1, 8), fingers=st.integers(1, 26))
def test_any_number_of_still_fingers_is_zeroed_as_by_the_matrix_of_them_all(
    seed: int, modes: int, fingers: int
) -> None:
    random = np.random.default_rng(seed)
    shapes = random.uniform(-1, 1, (fingers, modes)) + 1j * random.uniform(-1, 1, (fingers, modes))
    modal = random.normal(size=modes) + 1j * random.normal(size=modes)
    felt = [(row.real.tolist(), row.imag.tolist()) for row in shapes]
    d_um, q_um = _all_zeroed(felt, tuple(modal.tolist()))
    known = shapes @ shapes.conj().T + NODE_SHAPE_SQUARED * np.eye(fingers)
    expected = modal - shapes.conj().T @ np.linalg.solve(known, shapes @ modal)
    # One after the other, they are zeroed with an error of the condition squared, which is up to 2e4, times rounding.
    assert np.array(d_um) + 1j * np.array(q_um) == pytest.approx(expected, abs=1e-7)
