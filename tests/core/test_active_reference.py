"""The reference in force: another one continues it."""

from __future__ import annotations

from hapticd.core.frame import interpolated_um
from hapticd.values import Knot, LimitReason, SafeDrive


def test_a_polyline_goes_on_from_where_it_is() -> None:
    turning = SafeDrive(1000, (Knot(0, (1j, 0j)), Knot(4000, (1 + 0j, 0j))), LimitReason.NONE)
    assert interpolated_um(turning, 3000) == (0.5 + 0.5j, 0j)
    assert interpolated_um(turning, 0) == (1j, 0j)  # not yet begun
    assert interpolated_um(turning, 9000) == (1.0, 0.0)  # long over
