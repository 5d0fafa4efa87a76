"""What is laid over the picture of the field."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.core.modes import ModeShapes
from hapticd.errors import RequestError
from hapticd.sim.plate import PlateSettings, PlateTruth
from hapticd.viewer import layers
from hapticd.viewer.layers import LAYERS, POINTS, LayerFinger

MODES = PlateTruth(PlateSettings()).cartography(1)
SIZE_MM = (137.5, 137.5)


def test_a_layer_is_told_from_the_top_left_with_its_gaps(monkeypatch: pytest.MonkeyPatch) -> None:
    def right_of_the_finger(
        modes: ModeShapes, fingers: list[LayerFinger], w_limit_um: list[float], points_mm: np.ndarray
    ) -> np.ndarray:
        assert modes is MODES
        assert w_limit_um == [4.0, 4.0]
        values = np.where(points_mm[:, 0] > fingers[0].x_mm, 2.0, -1.0)
        values[points_mm[:, 1] > 60.0] = np.nan
        return values

    monkeypatch.setitem(LAYERS, "right", right_of_the_finger)
    told = layers.picture("right", MODES, [LayerFinger(0.0, 0.0, 1.0)], [4.0, 4.0], SIZE_MM)
    levels = np.frombuffer(told, np.uint8).reshape(POINTS, POINTS)
    assert (levels[0] == 255).all()
    assert (levels[-1, : POINTS // 2] == 0).all()
    assert (levels[-1, POINTS // 2 + 1 :] == 254).all()


def test_a_layer_that_there_is_not_is_refused() -> None:
    with pytest.raises(RequestError, match="no layer 'still'"):
        layers.picture("still", MODES, [], [4.0, 4.0], SIZE_MM)
