"""Pairs of modes, materials, and support points."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.design import free_plate_modes
from hapticd.design.pairs import ModePair, mode_pairs
from hapticd.design.stamps import common_nodes

SIZE_MM = (137.5, 137.5)
MODES = free_plate_modes(SIZE_MM)


@pytest.fixture(scope="module")
def pair() -> ModePair:
    return mode_pairs(MODES, 28200.0, 60.0)[0]


def test_the_reference_plate_s_own_pair_comes_first(pair: ModePair) -> None:
    assert pair.name == "11x0 + 0x11"
    assert pair.splitting_hz == 0.0
    assert pair.next_hz == pytest.approx(105.1, abs=0.1)
    assert pair.centre_hz == pytest.approx(28118.7, abs=1.0)


def test_a_stamp_moves_as_the_worst_point_within_it_and_a_wider_one_more(pair: ModePair) -> None:
    node = common_nodes(pair.shapes, 2.0)[0]
    angles = np.linspace(0.0, 2.0 * np.pi, 721)
    rim = np.stack((node.x_mm + 2.0 * np.cos(angles), node.y_mm + 2.0 * np.sin(angles)), axis=-1)
    worst = sum(np.abs(shape.evaluate(rim)) for shape in pair.shapes).max()
    assert node.moved_frac == pytest.approx(worst, rel=0.03)
    assert common_nodes(pair.shapes, 0.0)[0].moved_frac < 1e-8
    assert common_nodes(pair.shapes, 4.0)[0].moved_frac > 1.5 * node.moved_frac
