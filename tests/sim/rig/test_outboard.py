"""References decoded on their way to a board in another process."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hapticd.board_protocol import Keepalive
from hapticd.sim.rig.outboard import ReferenceMonitor
from hapticd.values import Knot, LimitReason, SafeDrive
from hapticd.wire import device


def reference(seq: int, t_apply_us: int, *knots: tuple[int, complex, complex]) -> bytes:
    drive = SafeDrive(0, tuple(Knot(us * 1000, (x, y)) for us, x, y in knots), LimitReason.NONE)
    return device.encode_reference(seq, drive, t_apply_us)


TWO_FRAMES = (
    reference(1, 1000, (0, 1.0 + 0.5j, 0j), (4000, 3.0 + 0.5j, 2j))
    + device.encode(Keepalive(1))
    + reference(2, 3000, (0, 0j, -1.0 + 0j))
)


def test_before_the_first_reference_the_reference_is_zero() -> None:
    references = ReferenceMonitor()
    references.feed(TWO_FRAMES, 0)
    np.testing.assert_array_equal(references.at(np.array([0, 999])), np.zeros((2, 2)))


def test_a_polyline_holds_until_a_later_one_begins() -> None:
    references = ReferenceMonitor()
    references.feed(TWO_FRAMES, 0)
    np.testing.assert_allclose(
        references.at(np.array([1000, 2000, 2999, 3000, 90_000])),
        [[1 + 0.5j, 0j], [1.5 + 0.5j, 0.5j], [1.9995 + 0.5j, 0.9995j], [0j, -1 + 0j], [0j, -1 + 0j]],
        atol=1e-6,
    )


def test_the_boards_clock_may_wrap_between_two_frames() -> None:
    references = ReferenceMonitor()
    now_us = (1 << 32) - 10
    references.feed(reference(1, now_us, (0, 1j, 1j)), now_us)
    references.feed(reference(2, (now_us + 20) & 0xFFFFFFFF, (0, 2j, 2j)), now_us)
    np.testing.assert_allclose(references.at(now_us + np.array([0, 19, 20])), np.array([[1j] * 2, [1j] * 2, [2j] * 2]))


@given(st.lists(st.integers(0, len(TWO_FRAMES)), max_size=8))
def test_it_does_not_matter_in_which_pieces_the_bytes_pass(cuts: list[int]) -> None:
    whole, pieces = ReferenceMonitor(), ReferenceMonitor()
    whole.feed(TWO_FRAMES, 0)
    ends = [0, *sorted(cuts), len(TWO_FRAMES)]
    for start, end in pairwise(ends):
        pieces.feed(TWO_FRAMES[start:end], 0)
    t_us = np.arange(0, 8000, 100)
    np.testing.assert_array_equal(whole.at(t_us), pieces.at(t_us))
