"""The reference in force: another one continues it."""

from __future__ import annotations

from hapticd.core.frame import interpolated_um
from hapticd.core.trajectory.gate import silence
from hapticd.values import Knot, LimitReason, SafeDrive


def test_a_polyline_goes_on_in_floats_without_and_in_phasors_with_turned_phases() -> None:
    plain = SafeDrive(1000, (Knot(0, (1.0, 0.0)), Knot(4000, (2.0, 1.0))), LimitReason.NONE)
    turning = plain._replace(knots=(Knot(0, (1j, 0j)), Knot(4000, (1 + 0j, 0j))))

    assert interpolated_um(plain, 2000) == (1.25, 0.25)
    for t_ns in (0, 2000, 9000):
        assert all(type(w_um) is float for w_um in interpolated_um(plain, t_ns))
    assert all(type(w_um) is float for w_um in interpolated_um(silence(1000, 2), 2000))
    assert interpolated_um(turning, 3000) == (0.5 + 0.5j, 0j)
    assert interpolated_um(turning, 0) == (1j, 0j)  # not yet begun
    assert interpolated_um(turning, 9000) == (1.0, 0.0)  # long over
