"""Choice of the drive and of the driven modes from a scan, and what the modes that stay undriven do."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from hapticd.design.contact_pairs import surfaces
from hapticd.design.felt_places import touches
from hapticd.design.felt_tolerances import Copy
from hapticd.design.glued_plate import GluedPlate, Patch
from hapticd.design.materials import MATERIALS
from hapticd.design.mode_choice import FeltTask, NearModes, choose
from hapticd.design.mode_shape import ModeShape
from hapticd.design.patch_reach import PatchDrive

SIZE_MM, TASK = (120.0, 120.0), FeltTask()
HZ = np.array([29000.0, 29040.0, 29080.0, 29110.0])
NODES = ((9, 0), (0, 9), (7, 5), (5, 7))


def near(gain: list[list[float]], finger_decay_1_s: float = 60.0) -> NearModes:
    shapes = []
    for lines in NODES:
        coefficients = np.zeros((12, 12))
        coefficients[lines] = 1.0 / math.sqrt((2 * lines[0] + 1) * (2 * lines[1] + 1))
        shapes.append(ModeShape(SIZE_MM, coefficients, lines, ""))
    driven = PatchDrive(HZ, math.pi * HZ / 500.0, np.array(gain), np.full(len(gain[0]), 150.0))
    return NearModes(driven, touches(surfaces(shapes), SIZE_MM, 5.0, 2, 60, 1), finger_decay_1_s)


def test_modes_that_no_patch_moves_stay_undriven_and_at_rest() -> None:
    modes = near([[9.0, 1.0, 0.0], [0.0, 0.0, 0.0], [1.0, 9.0, 1.0], [0.0, 2.0, 9.0]], finger_decay_1_s=0.0)
    choice = choose(modes, TASK)
    assert choice is not None
    assert choice.used == (0, 2, 3)
    assert np.all(modes.pushed(choice.used, choice.drive_hz) == 0.0)
    found = modes.under(choice.used, choice.drive_hz)
    np.testing.assert_array_equal(found.true, modes.found.true[..., [0, 2, 3]])
    assert np.all(np.array(choice.limits_um) <= modes.of(choice.used).reach_um(choice.drive_hz))
    assert np.abs(HZ[[0, 2, 3]] - choice.drive_hz).max() <= TASK.farthest_hz


def test_undriven_modes_move_as_the_equation_of_motion_says() -> None:
    modes = near([[9.0, 1.0], [1.0, 8.0], [4.0, 3.0], [2.0, 5.0]])
    used, drive_hz, held_um = [0, 1], 29030.0, np.array([2.0, 1.0j])
    own = modes.driven.stiffness_1_s(drive_hz)
    for place in (0, 7):
        phi = modes.found.true[place]
        load = 60.0 * np.einsum("nqa,nqb,q->ab", phi, phi, modes.found.weights)
        alone = np.diag(own) + load * np.isin(np.arange(4), used)  # what undriven modes brake of each other is small
        force = alone[np.ix_(used, used)] @ held_um
        volts = np.linalg.solve(modes.driven.gain_um_per_v_s[used], force)
        others_um = (modes.driven.gain_um_per_v_s[2:] @ volts - load[2:, used] @ held_um) / own[2:]
        expected = phi[..., used] @ held_um + phi[..., 2:] @ others_um
        found = modes.under(used, drive_hz)
        np.testing.assert_allclose(found.true[place] @ held_um, expected, rtol=1e-9, atol=1e-12)
    shared = modes.found.solved[..., used] + modes.found.solved[..., 2:] @ modes.pushed(used, drive_hz).real
    np.testing.assert_allclose(found.solved, shared)


def test_no_choice_where_no_drive_is_near_enough() -> None:
    assert choose(near(np.eye(4)[:, :3].tolist()), replace(TASK, farthest_hz=20.0)) is None


def test_a_copy_is_the_same_again_within_its_tolerances() -> None:
    patches = tuple(Patch(*at, (8.0, 8.0), 0.3) for at in ((-46.0, 0.0), (0.0, 46.0)))
    plate = GluedPlate((100.0, 100.0), 2.0, MATERIALS["glass"], patches)
    made = Copy(plate, 29500.0, TASK, 17).made()
    assert made == Copy(plate, 29500.0, TASK, 17).made() != Copy(plate, 29500.0, TASK, 18).made()
    assert 0.0 < abs(made.thickness_mm - 2.0) <= 0.2
    assert np.abs(np.array(made.size_mm) - 50.0 * made.thickness_mm).max() <= 50.0 * 0.02 + 0.1  # cut as measured
    for one in made.patches:
        assert 0.0 <= min(np.array(made.size_mm) / 2.0 - 4.0 - np.abs((one.x_mm, one.y_mm))) <= 0.5
        assert 0.8 <= one.material.young_gpa / patches[0].material.young_gpa <= 1.0
