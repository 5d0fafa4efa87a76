"""Contact discs in place of points: the still finger's mean square is least, and radius 0 is the point's rule."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import null_space

from hapticd.core.solver import solve, solve_batch, solve_phased
from hapticd.core.solver.contacts import principal_axes

Array = npt.NDArray[np.float64]


def disc(random: np.random.Generator, modes: int, spread: float, row: Array) -> Array:
    """The mean of phi phi' over points of a contact whose shapes differ by `spread` about a row."""
    points = row + spread * random.normal(size=(40, modes))
    gram: Array = points.T @ points / len(points)
    return gram


@pytest.mark.parametrize("modes", [2, 3, 5])
def test_of_all_amplitudes_as_great_the_contact_moves_least(modes: int) -> None:
    random = np.random.default_rng(modes)
    for _ in range(20):
        phi = random.uniform(-1, 1, (2, modes))
        gram = np.stack([disc(random, modes, 0.2, row) for row in phi])
        modal_um = solve(phi, [1.0, 0.0], 1e6, gram=gram).modal_um
        least, greatest = np.linalg.eigvalsh(gram[1])[[0, -1]]
        axis = np.linalg.eigh(gram[1])[1][:, -1]
        mean_square = modal_um @ gram[1] @ modal_um / (modal_um @ modal_um)
        assert axis @ modal_um == pytest.approx(0.0, abs=1e-9 * np.linalg.norm(modal_um))
        assert least * (1 - 1e-9) <= mean_square < greatest
        if modes == 2:
            assert mean_square == pytest.approx(least)


@pytest.mark.parametrize("modes", [2, 3])
def test_a_contact_of_no_size_is_a_point(modes: int) -> None:
    phi = np.random.default_rng(1).uniform(-1, 1, (3, modes))
    gram = np.einsum("nk,nl->nkl", phi, phi)
    for target_um in ([1.0, 0.0, 0.5], [1.0, 0.3, 0.5], [0.0, 0.0, 0.0]):
        points = solve(phi, target_um, 4.0)
        discs = solve(phi, target_um, 4.0, gram=gram)
        assert discs.modal_um == pytest.approx(points.modal_um, abs=1e-9)
        assert discs.limited == points.limited


def test_several_still_contacts_give_up_as_many_directions_as_their_points() -> None:
    random = np.random.default_rng(2)
    phi = random.uniform(-1, 1, (3, 4))
    gram = np.stack([disc(random, 4, 0.1, row) for row in phi])
    modal_um = solve(phi, [1.0, 0.0, 0.0], 1e6, gram=gram).modal_um
    axes = np.array(principal_axes(gram[1:], 2))
    assert axes @ axes.T == pytest.approx(np.eye(2), abs=1e-12)
    assert axes @ modal_um == pytest.approx([0.0, 0.0], abs=1e-12 * np.linalg.norm(modal_um))
    left = null_space(axes)
    ratio = np.linalg.eigvalsh(left.T @ (gram[1] + gram[2]) @ left)
    assert ratio == pytest.approx(np.linalg.eigvalsh(gram[1] + gram[2])[:2])


def test_a_still_finger_on_a_node_asks_for_nothing_and_two_unlike_ones_for_silence() -> None:
    gram = np.full((3, 2, 2), 0.1)
    free = solve([[0.5, 0.9], [0.0, 0.0], [0.0, 0.0]], [1.0, 0.0, 0.0], 4.0, gram=gram)
    assert free.modal_um == pytest.approx(solve([[0.5, 0.9]], [1.0], 4.0).modal_um)
    silent = solve([[0.5, 0.9], [1.0, 0.0], [0.0, 1.0]], [1.0, 0.0, 0.0], 4.0, gram=gram)
    assert not np.any(silent.modal_um)


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 10**6), fingers=st.integers(1, 4), modes=st.integers(1, 4))
def test_a_batch_of_discs_is_solve_after_solve(seed: int, fingers: int, modes: int) -> None:
    random = np.random.default_rng(seed)
    phi = random.uniform(-1, 1, (6, fingers, modes))
    gram = np.array([[disc(random, modes, 0.2, row) for row in rows] for rows in phi])
    target_um = random.uniform(0.1, 3.0, (6, fingers)) * (random.random((6, fingers)) < 0.6)
    batch = solve_batch(phi, target_um, 4.0, gram=gram)
    previous: Array | None = None
    for shapes, target, discs, modal_um in zip(phi, target_um, gram, batch, strict=True):
        previous = solve(shapes, target, 4.0, gram=discs, previous_um=previous).modal_um
        assert modal_um == pytest.approx(previous, rel=0, abs=1e-12)


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 10**6), fingers=st.integers(1, 4), modes=st.integers(1, 4))
def test_while_one_finger_slips_phases_free_move_discs_no_more_than_signs(seed: int, fingers: int, modes: int) -> None:
    random = np.random.default_rng(seed)
    phi = random.uniform(-1, 1, (fingers, modes))
    gram = np.stack([disc(random, modes, 0.2, row) for row in phi])
    target_um = np.zeros(fingers)
    target_um[0] = random.uniform(0.1, 3.0)
    turned_um = solve_phased(phi, target_um, 4.0, gram=gram, previous_um=random.normal(size=(modes, 2)) @ [1.0, 1.0j])
    real_um = solve(phi, target_um, 4.0, gram=gram).modal_um
    assert np.abs(turned_um) == pytest.approx(np.abs(real_um), rel=0, abs=1e-12)
    if np.any(real_um):
        assert abs(np.vdot(turned_um, real_um)) == pytest.approx(real_um @ real_um)


def test_between_two_slipping_fingers_a_still_disc_stays_on_its_axis() -> None:
    random = np.random.default_rng(4)
    phi = random.uniform(-1, 1, (3, 3))
    gram = np.stack([disc(random, 3, 0.1, row) for row in phi])
    (axis,) = principal_axes(gram[2:], 1)
    previous = None
    for turn in np.linspace(0.0, 2.0, 30):
        shapes = phi + 0.3 * np.sin(turn * np.arange(1.0, 10.0)).reshape(3, 3) * [[1.0], [1.0], [0.0]]
        previous = solve_phased(shapes, [1.0, 0.6, 0.0], 4.0, gram=gram, previous_um=previous)
        assert abs(np.dot(axis, previous)) < 1e-14 * np.linalg.norm(previous)


@pytest.mark.parametrize("gram", [np.zeros((2, 2)), np.zeros((2, 3, 3)), np.full((2, 2, 2), np.nan), "plate"])
def test_a_gram_of_another_shape_or_not_finite_is_one_sentence(gram: object) -> None:
    for refuses in (solve, solve_phased):
        with pytest.raises(ValueError, match=r"^gram[^\n]*\.$"):
            refuses([[0.5, 0.4], [0.3, -0.2]], [1.0, 0.0], 4.0, gram=gram)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"^gram[^\n]*\.$"):
        solve_batch(np.ones((3, 2, 2)), [1.0, 0.0], 4.0, gram=gram)  # type: ignore[arg-type]
