"""Digits of the solution, the wire's float32, and long walks, at every condition and scale."""

from __future__ import annotations

import math
import struct

import mpmath
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hapticd.board_protocol import REFERENCE
from hapticd.core.solver import solve
from hapticd.core.solver.instant import hold_still, turned
from hapticd.core.trajectory.gate import gate
from hapticd.values import Drive, Knot
from hapticd.wire.board_messages import FRAME_MAX
from hapticd.wire.device import encode_reference
from hapticd.wire.framing import FrameSplitter

LIMITS_UM = (4.0, 4.0)
shape = st.floats(-1.0, 1.0)
row = st.tuples(shape, shape)
exponent = st.floats(0.0, 17.0)


def conditioned(exponent: float, angle: float, other_angle: float) -> np.ndarray:
    """Two rows whose condition is 10^exponent, before they are rounded."""
    left, right = (
        np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]]) for turn in (angle, other_angle)
    )
    return left @ np.diag([1.0, 10.0**-exponent]) @ right


@given(exponent=exponent, angle=st.floats(0.1, 1.4), other=st.floats(0.1, 1.4), target_um=st.floats(1e-9, 1e12))
def test_with_one_finger_still_w_is_right_to_the_digits_that_its_gain_has(
    exponent: float, angle: float, other: float, target_um: float
) -> None:
    """The line is exact at every condition; how far along it W lies has the digits that the gain's two terms leave.

    At a limit these do not matter, and where none is left the plate is silent.
    """
    phi = conditioned(exponent, angle, other)
    solution = solve(phi, (target_um, 0.0), LIMITS_UM)
    modal, limited = tuple(solution.modal_um.tolist()), solution.limited
    with mpmath.workdps(60):
        (a, b), (c, d) = ([mpmath.mpf(value) for value in values] for values in phi.tolist())
        gain, terms = abs(a * d - b * c), abs(a * d) + abs(b * c)
        if modal == (0.0, 0.0):
            assert gain <= 1e-14 * terms
            return
        top = min(4 / abs(value) for value in (c, d) if value != 0)
        share = min(target_um / gain, top)
        lean = mpmath.sign(a * d - b * c)
        exact = [share * d * lean, -share * c * lean]
        error = max(abs(w - x) for w, x in zip(modal, exact, strict=True)) / max(map(abs, exact))
        assert error <= (1e-15 if limited and share == top else 1e-15 * terms / gain)
        assert abs(c * modal[0] + d * modal[1]) <= 1e-15 * max(map(abs, modal))


@given(
    still=row,
    slipping=row,
    slip_um=st.sampled_from([1e-12, 1e-3, 1.0, 1e12, 5e-324]),
    exponents=st.tuples(*[st.sampled_from([-300.0, -9.0, 0.0, 300.0])] * 2),
)
def test_the_wire_breaks_no_limit_and_leaks_less_than_a_nanometre(
    still: tuple[float, float],
    slipping: tuple[float, float],
    slip_um: float,
    exponents: tuple[float, float],
) -> None:
    sizes = [10.0**exponent for exponent in exponents]
    rows = tuple((x * size, y * size) for (x, y), size in zip((slipping, still), sizes, strict=True))
    for previous in ((0j, 0j), (1 + 2j, -0.3j)):
        pair, phase, _ = hold_still(rows[0], slip_um, rows[1], LIMITS_UM, previous)
        modal = turned(pair, phase, LIMITS_UM)
        drive = gate(Drive(0, (Knot(0, tuple(map(complex, modal))),)), LIMITS_UM)
        (message,) = FrameSplitter(FRAME_MAX).feed(encode_reference(1, drive, 0))
        parts = struct.unpack_from("<4f", message, 1 + REFERENCE.size + 2)
        sent = complex(*parts[:2]), complex(*parts[2:])
        assert all(abs(w) <= limit for w, limit in zip(sent, LIMITS_UM, strict=True))
        assert abs(still[0] * sent[0] + still[1] * sent[1]) < 1e-3
