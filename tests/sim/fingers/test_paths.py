"""Finger paths: the stated speeds, smoothness, bounds and determinism."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.sim.fingers.strokes import Strokes


@given(st.integers(0, 2**31), st.floats(20.0, 600.0), st.floats(0.0, 2000.0))
@settings(deadline=None, max_examples=40)
def test_strokes_never_leave_the_plate(seed: int, speed: float, t_begin_s: float) -> None:
    positions = Strokes(seed, speed).position_mm(t_begin_s + np.arange(0.0, 20.0, 0.01))
    assert np.abs(positions).max() <= 58.0


def test_times_are_finite() -> None:
    for t_s in (math.nan, math.inf):
        with pytest.raises(ValueError, match="finite"):
            Strokes(0).position_mm(np.array([t_s]))
