"""The drive frequency: it minimises the largest voltage for any modes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.board_values import ModeCalibration
from hapticd.design.drive import largest_voltage_v, propose_drive_hz, voltage_v

modes = st.builds(
    ModeCalibration,
    st.just(0),
    st.floats(29000.0, 29400.0),
    st.floats(100.0, 3000.0),
    st.floats(0.5, 50.0),
    st.just(0.0),
)


def test_equal_modes_are_driven_half_way() -> None:
    pair = [ModeCalibration(0, 29195.0, 500.0, 7.5, 0.0), ModeCalibration(1, 29215.0, 500.0, 7.5, 0.0)]
    assert propose_drive_hz(pair, (4.0, 4.0)) == pytest.approx(29205.0, abs=0.05)
    nearer_the_weak = propose_drive_hz([pair[0], ModeCalibration(1, 29215.0, 500.0, 5.0, 0.0)], (4.0, 4.0))
    assert 29205.0 < nearer_the_weak <= 29215.0


def test_at_its_resonance_a_mode_needs_what_damping_takes() -> None:
    mode = ModeCalibration(0, 29200.0, 500.0, 7.5, 0.0)
    assert voltage_v(mode, 29200.0, 4.0) == pytest.approx(4.0 * np.pi * 29200.0 / 500.0 / 7.5)
    assert propose_drive_hz([mode], (4.0,)) == 29200.0


@settings(deadline=None, max_examples=60)
@given(st.lists(modes, min_size=1, max_size=4))
def test_no_other_frequency_needs_less(some: list[ModeCalibration]) -> None:
    amplitude_um = [4.0] * len(some)
    best_v = largest_voltage_v(some, propose_drive_hz(some, amplitude_um), amplitude_um)
    others_v = [largest_voltage_v(some, hz, amplitude_um) for hz in np.linspace(28900.0, 29500.0, 301)]
    assert best_v <= min(others_v) * (1.0 + 1e-6)


def test_no_modes_have_no_drive() -> None:
    with pytest.raises(ValueError, match="one mode or more"):
        propose_drive_hz([], ())
