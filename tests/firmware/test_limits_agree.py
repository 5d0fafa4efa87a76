"""The two amplitude limits, `core/trajectory/gate.py` and `firmware/core/limiter.c`: each alone sufficient, and of one
mind."""

from __future__ import annotations

import ctypes
import math

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from hapticd.core.trajectory.gate import gate
from hapticd.sim.board import firmware
from hapticd.values import Drive, Knot, LimitReason

REASONS = (LimitReason.NONE, LimitReason.AMPLITUDE, LimitReason.NOT_FINITE)  # by the C limiter's result
TOLERANCE = 1e-6  # HD_LIMIT_TOLERANCE: what float32 may add to a reference that the host had already limited
OVERFLOWS_UM = 1.8e19  # above it the square of a float32 magnitude is infinite
ULP = 2.0**-23  # of float32, relative
ROUND_DOWN = 2.0**-21  # by which the C limiter stays below a limit, to outweigh its roundings

single = st.floats(width=32) | st.sampled_from(
    [0.0, -0.0, 4.0, 2.5, 1e-45, -1e-45, 1.1754944e-38, 3.4e38, -3.4e38, math.nan, math.inf, -math.inf]
)
near_the_limit = st.floats(-6, 6, width=32)
parts = st.lists(single | near_the_limit, min_size=6, max_size=6)
limit = st.floats(np.float32(0.01), 20, width=32)


def limited_by_c(values: list[float], limit_um: tuple[float, ...]) -> tuple[LimitReason, list[complex]]:
    """(d, q) of as many modes as there are limits, through the board's own code."""
    modes = len(limit_um)
    phasors = np.array(values[: 2 * modes], dtype=np.float32)
    limits = np.array(limit_um, dtype=np.float32)
    result = firmware.load(modes).hd_limit_amplitudes(
        ctypes.c_void_p(phasors.ctypes.data), ctypes.c_void_p(limits.ctypes.data)
    )
    return REASONS[result], [complex(d, q) for d, q in phasors.reshape(-1, 2).astype(np.float64)]


def limited_by_python(values: list[float], limit_um: tuple[float, ...]) -> tuple[LimitReason, list[complex]]:
    modal_um = tuple(complex(*values[2 * k : 2 * k + 2]) for k in range(len(limit_um)))
    safe = gate(Drive(0, (Knot(0, modal_um),)), limit_um)
    return safe.reasons, list(safe.knots[0].modal_um)


@given(parts, st.tuples(limit, limit) | st.tuples(limit, limit, limit))
@example([3.4e38, 3.4e38, 1.0, 0.0, 0.0, 0.0], (4.0, 4.0))
@example([1.7e19, 1.0, -0.0, 0.0, 0.0, 0.0], (4.0, 4.0))
@example([1e-45, -1e-45, 0.0, 4.0, 0.0, 0.0], (4.0, 4.0))
@example([4.0, 0.0, 2.5, 1e-45, math.nan, 0.0], (4.0, 2.5))
def test_host_and_board_limit_two_and_three_modes_alike(values: list[float], limit_um: tuple[float, ...]) -> None:
    values = [float(np.float32(value)) for value in values]
    reason, out_um = limited_by_c(values, limit_um)
    wanted_reason, wanted_um = limited_by_python(values, limit_um)
    used = values[: 2 * len(limit_um)]
    over = [math.hypot(*used[2 * k : 2 * k + 2]) / limit for k, limit in enumerate(limit_um)]
    if not all(map(math.isfinite, used)):
        assert reason is wanted_reason is LimitReason.NOT_FINITE
        assert not any(out_um)
    elif 1 < max(over) < 1 + 2 * TOLERANCE:
        assert all(abs(w) <= limit * (1 + 1.2 * TOLERANCE) for w, limit in zip(out_um, limit_um, strict=True))
    else:
        assert reason is wanted_reason
        if max(map(abs, used)) < OVERFLOWS_UM / 2:  # beyond it the board's answer is silence
            below = 0.0 if reason is LimitReason.NONE else ROUND_DOWN
            for ours, theirs in zip(out_um, wanted_um, strict=True):
                assert abs(ours - theirs * (1 - below)) <= 2 * ULP * abs(theirs) + 2.0**-149
        elif max(over) > 1:
            assert all(abs(ours) <= abs(theirs) * (1 + ULP) for ours, theirs in zip(out_um, wanted_um, strict=True))


@given(parts, limit, limit)
def test_what_the_host_let_through_the_board_leaves_alone(values: list[float], x_um: float, y_um: float) -> None:
    """The encoder rounds towards zero, so the board finds nothing above its limit."""
    _, safe_um = limited_by_python(values, (x_um, y_um))
    sent = [float(np.float32(part)) for w in safe_um for part in (w.real, w.imag)]
    assert limited_by_c(sent, (x_um, y_um))[0] is LimitReason.NONE
