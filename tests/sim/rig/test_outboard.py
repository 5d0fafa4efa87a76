"""References decoded on their way to a board in another process."""

from __future__ import annotations

import numpy as np

from hapticd.sim.rig.outboard import ReferenceMonitor
from hapticd.values import Knot, LimitReason, SafeDrive
from hapticd.wire import device


def reference(seq: int, t_apply_us: int, *knots: tuple[int, complex, complex]) -> bytes:
    drive = SafeDrive(0, tuple(Knot(us * 1000, (x, y)) for us, x, y in knots), LimitReason.NONE)
    return device.encode_reference(seq, drive, t_apply_us)


def test_the_boards_clock_may_wrap_between_two_frames() -> None:
    references = ReferenceMonitor()
    now_us = (1 << 32) - 10
    references.feed(reference(1, now_us, (0, 1j, 1j)), now_us)
    references.feed(reference(2, (now_us + 20) & 0xFFFFFFFF, (0, 2j, 2j)), now_us)
    np.testing.assert_allclose(references.at(now_us + np.array([0, 19, 20])), np.array([[1j] * 2, [1j] * 2, [2j] * 2]))
