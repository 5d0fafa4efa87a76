"""Derating: where an amplitude costs the still finger too much, and where the reference would jump."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.solver.derating import LEAST_SHARE, STEEPEST_UM_MM, Slope, derated, is_near_node

W_UM = (3.0, -2.0)
FAR_FROM_NODES: tuple[Slope, ...] = ((0.2, 0.05, 0.0), (0.3, 0.0, -0.05))  # w = 0, |grad w| = 0.18 um/mm
SLOPE_UM_MM = math.hypot(0.05 * 3.0, 0.05 * 2.0)
shapes = st.floats(-1.0, 1.0)
slopes = st.floats(-0.2, 0.2)
amplitudes = st.floats(-4.0, 4.0)


def test_nothing_changes_where_targets_are_met_far_from_nodes() -> None:
    assert derated(W_UM, 1.0, [FAR_FROM_NODES], 100.0, limited=False) == W_UM


def test_where_a_limit_binds_amplitude_gives_way_to_what_its_share_is_worth() -> None:
    for share in (0.0, 0.1, 0.6, 0.9):
        price = 50.0 * SLOPE_UM_MM**2
        expected = min(1.0, math.hypot(share, LEAST_SHARE) / price)
        got = derated(W_UM, share, [FAR_FROM_NODES], 50.0, limited=True)
        assert got == pytest.approx([w_um * expected for w_um in W_UM])


def test_across_a_common_node_the_reference_turns_no_faster_than_the_bound() -> None:
    """Two crossing waves, and a still finger that passes their common node at 5 um distance."""
    wave_1_mm = 2.0 * math.pi / 27.0
    turned: list[tuple[float, ...]] = []
    for step in range(-400, 401):
        x_mm, y_mm = 0.005 * step, 0.005
        x, y = (0.5 * math.sin(wave_1_mm * at_mm) for at_mm in (x_mm, y_mm))
        dx, dy = (0.5 * wave_1_mm * math.cos(wave_1_mm * at_mm) for at_mm in (x_mm, y_mm))
        size = math.hypot(x, y)
        line = (4.0 * y / size, -4.0 * x / size)
        turned.append(derated(line, 1.0, [((x, dx, 0.0), (y, 0.0, dy))], 5.0, limited=False))
    slopes_um_mm = np.abs(np.diff(turned, axis=0)).max(axis=1) / 0.005
    assert slopes_um_mm.max() < 1.1 * math.sqrt(2.0) * STEEPEST_UM_MM
    assert abs(turned[0][1]) == pytest.approx(4.0, rel=1e-4)  # a good way off nothing is taken


@given(
    st.tuples(amplitudes, amplitudes),
    st.floats(0.0, 1.0),
    st.lists(st.tuples(st.tuples(shapes, slopes, slopes), st.tuples(shapes, slopes, slopes)), max_size=3),
    st.floats(0.0, 100.0),
    st.booleans(),
)
def test_amplitudes_only_shrink_and_all_by_one_factor(
    modal_um: tuple[float, float], share: float, still: list[tuple[Slope, ...]], price: float, limited: bool
) -> None:
    got = derated(modal_um, share, still, price, limited=limited)
    assert all(abs(after) <= abs(before) for before, after in zip(modal_um, got, strict=True))
    assert abs(got[0] * modal_um[1] - got[1] * modal_um[0]) <= 1e-12


def test_far_from_a_node_no_amplitude_turns_too_fast() -> None:
    steepest_1_mm = 0.05
    assert not is_near_node((0.2, 0.3), W_UM, steepest_1_mm)
    assert is_near_node((0.01, 0.02), W_UM, steepest_1_mm)
    assert is_near_node((0.0, 0.0), W_UM, steepest_1_mm)
    assert derated(W_UM, 1.0, [((0.0, 0.05, 0.0), (0.0, 0.0, 0.05))], 5.0, limited=False) == (0.0, 0.0)
