"""References in what sensors with errors read."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.trajectory.gate import gate
from hapticd.core.trajectory.readings import as_read, as_they_are
from hapticd.values import Drive, Knot

W_UM = (1.5, -0.5 + 2.0j)
DRIVE = gate(Drive(7, (Knot(0, W_UM), Knot(1000, (0.0, 0.0)))), (4.0, 4.0))
element = st.complex_numbers(max_magnitude=2.0)


def test_sensors_without_errors_read_what_is() -> None:
    assert as_read(DRIVE, as_they_are(2)) == Drive(7, ((0, W_UM), (1000, (0j, 0j))))


@given(element, element, element, element)
def test_every_knot_is_multiplied_and_keeps_its_time(one: complex, two: complex, three: complex, four: complex) -> None:
    read = as_read(DRIVE, ((one, two), (three, four)))
    assert read.t_apply_ns == DRIVE.t_apply_ns
    for before, after in zip(DRIVE.knots, read.knots, strict=True):
        assert after.dt_ns == before.dt_ns
        assert after.modal_um == pytest.approx(np.array(((one, two), (three, four))) @ before.modal_um)
