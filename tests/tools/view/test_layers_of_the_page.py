"""Layers over the picture of the field."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.core.solver.public import solve
from hapticd.errors import RequestError
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.tools.view import layers
from hapticd.tools.view.layers import POINTS, LayerFinger

MODES = GroundTruth(PlateSettings()).measured_mode_map(1)
SIZE_MM = (137.5, 137.5)


def test_an_unknown_layer_is_refused() -> None:
    with pytest.raises(RequestError, match="no layer 'still'"):
        layers.picture("still", MODES, [], [4.0, 4.0], SIZE_MM)


SLIPPERY, STICKY = LayerFinger(1, -30.0, 20.0, 1.0), LayerFinger("post", 12.0, -33.0, 0.0)


def levels(name: str, fingers: list[LayerFinger], mover: int | str | None = None) -> np.ndarray:
    data = layers.picture(name, MODES, fingers, [4.0, 4.0], SIZE_MM, mover)
    return np.frombuffer(data, np.uint8).reshape(POINTS, POINTS)


def test_one_finger_more_could_be_sticky_where_the_solver_says_so() -> None:
    shown = levels("could be sticky", [SLIPPERY])
    for row, column in ((7, 9), (40, 40), (41, 14), (72, 55)):
        place = (np.linspace(-68.75, 68.75, POINTS)[column], np.linspace(68.75, -68.75, POINTS)[row])
        solved = solve(MODES.evaluate([SLIPPERY[1:3], place]), [1.0, 0.0], 4.0)
        assert shown[row, column] == pytest.approx(254.0 * min(solved.achieved_um[0], 1.0), abs=0.51)
    assert 0.5 < np.mean(shown == 254) < 0.95


def test_a_slippery_finger_is_asked_about_with_its_own_amplitude() -> None:
    stronger = SLIPPERY._replace(target_um=3.0)
    weak, strong = (levels("could be slippery", [finger, STICKY], 1) for finger in (SLIPPERY, stronger))
    assert np.mean(strong == 254) < np.mean(weak == 254)
    assert (strong <= weak).all()
