"""Finger paths: the stated speeds, smoothness, bounds and determinism."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.sim.fingers.paths import (
    Circle,
    Line,
    Path,
    Reach,
    Rest,
    Strokes,
    strokes_pair,
)

STEP_S = 1e-3
T_S = np.arange(0.0, 12.0, STEP_S)
MOVING = {
    "line": Line((-40.0, -6.0), (45.0, 20.0), 150.0),
    "reach": Reach((-30.0, 0.0), (30.0, 10.0)),
    "circle": Circle((5.0, -3.0), 20.0, -300.0, 1.0),
    "strokes": Strokes(4),
    "fast strokes": Strokes(5, 400.0),
    "avoiding strokes": strokes_pair(6)[1],
    "trembling rest": Rest((3.0, 4.0), tremor_mm=0.04, seed=1),
}


def speed_mm_s(positions: np.ndarray) -> np.ndarray:
    return np.hypot(*np.diff(positions, axis=0).T) / STEP_S


@pytest.mark.parametrize("path", MOVING.values(), ids=MOVING)
def test_a_path_is_independent_of_the_order_of_calls(path: Path) -> None:
    whole = path.position_mm(T_S)
    assert whole.shape == (len(T_S), 2)
    assert whole.dtype == np.float64
    one_by_one = np.concatenate([path.position_mm(T_S[i : i + 1]) for i in range(0, len(T_S), 701)])
    np.testing.assert_allclose(one_by_one, whole[::701], rtol=0, atol=1e-12)
    backwards = path.position_mm(T_S[::-1])[::-1]
    np.testing.assert_allclose(backwards, whole, rtol=0, atol=1e-12)


@pytest.mark.parametrize("path", MOVING.values(), ids=MOVING)
def test_speed_has_no_steps(path: Path) -> None:
    velocity = np.diff(path.position_mm(T_S), axis=0) / STEP_S
    change_mm_s = np.hypot(*np.diff(velocity, axis=0).T)
    peak_mm_s = speed_mm_s(path.position_mm(T_S)).max()
    # A turn within 0.1 s along a half cosine accelerates by at most pi v / 0.1 s, which is above what strokes do;
    # tremor on each axis by a w^2.
    tremor_mm_s2 = math.sqrt(2) * 0.04 * (2 * math.pi * 9.0) ** 2
    assert change_mm_s.max() <= (1.05 * math.pi * peak_mm_s / 0.1 + tremor_mm_s2) * STEP_S


@given(st.integers(0, 2**31), st.floats(20.0, 600.0), st.floats(0.0, 2000.0))
@settings(deadline=None, max_examples=40)
def test_strokes_never_leave_the_plate(seed: int, speed: float, t_begin_s: float) -> None:
    positions = Strokes(seed, speed).position_mm(t_begin_s + np.arange(0.0, 20.0, 0.01))
    assert np.abs(positions).max() <= 58.0


def test_strokes_that_do_not_fit_are_refused_and_times_must_be_finite() -> None:
    with pytest.raises(ValueError, match="do not fit"):
        Strokes(0, half_size_mm=20.0)
    with pytest.raises(ValueError, match="speed_mm_s"):
        Strokes(0, speed_mm_s=0.0)
    for t_s in (math.nan, math.inf):
        with pytest.raises(ValueError, match="finite"):
            Strokes(0).position_mm(np.array([t_s]))
