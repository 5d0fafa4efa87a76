"""The reference in time: what the board follows, given frames that come early, late, twice or damaged."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest

from hapticd import board_protocol as protocol
from hapticd.board_values import BoardStatus, SetController
from hapticd.sim.board.board import FLAG_LIMITED
from hapticd.wire import device
from hapticd.wire.framing import encode_frame

from .bench import Bench

FLOAT32_UM = 4 * 2.0**-23


@pytest.fixture
def pi_bench() -> Bench:
    """The paper's law follows the reference at the tick itself, so the trace shows it to the last bit."""
    return Bench(controller="pi")


T_MS = 0.5 * (1 + np.arange(80))


@pytest.mark.parametrize(
    ("frames", "expected_um"),
    [
        ([(0, (0, 0j), (10, 2 + 0j), (15, 1 + 1j))], np.interp(T_MS, [0, 10, 15], [0, 2, 1 + 1j])),
        ([(0, (0, 0j), (100, 2 + 0j)), (20, (0, 3 + 0j))], np.where(T_MS < 20, 2 * T_MS / 100, 3)),
        ([(30, (0, 3 + 0j)), (10, (0, 1 + 0j))], np.where(T_MS < 10, 0, 1)),
    ],
    ids=["straight lines, and the last knot holds", "the old one until the new", "an earlier plan replaces a later"],
)
def test_a_reference_is_followed_in_time(
    pi_bench: Bench, frames: list[tuple[float, *tuple[tuple[float, complex], ...]]], expected_um: np.ndarray
) -> None:
    pi_bench.arm(0j, 0j)
    t0 = pi_bench.board.t_us
    for begin_ms, *knots in frames:
        line = ((ms, (w, -0.5j * w)) for ms, w in knots)
        pi_bench.say(pi_bench.polyline(*line, t_apply_us=t0 + round(1000 * begin_ms)))
    trace = pi_bench.run(len(T_MS))
    np.testing.assert_allclose(trace.reference_um.T, [expected_um, -0.5j * expected_um], rtol=0, atol=FLOAT32_UM)


@pytest.mark.parametrize(("ahead_us", "newest"), [(12_000, (93.9999, 94.0001)), (40_000, (60, 80))])
def test_frames_sent_faster_than_their_horizon_still_move_the_plate(
    pi_bench: Bench, ahead_us: int, newest: tuple[float, float]
) -> None:
    """More waiting frames than the board can hold coarsen the plan but keep it moving."""
    pi_bench.arm(0j, 0j)
    for i in range(100):
        pi_bench.say(pi_bench.polyline((0, (0.02 * i + 0j, 0j)), t_apply_us=pi_bench.board.t_us + ahead_us))
        reference_um = pi_bench.run(4).reference_um[-1, 0].real
    assert 0.02 * newest[0] < reference_um <= 0.02 * newest[1]


@pytest.mark.parametrize("t_start_us", [2**32 - 80_000, 2**32 - 10_250, 2**31 - 50_000])
def test_the_clock_may_wrap_in_the_middle_of_a_run(t_start_us: int) -> None:
    def history(start_us: int) -> list[bytes]:
        bench = Bench(t_start_us=start_us, noise_um=0.001)
        bench.arm(0j, 0j)
        parts = []
        for i in range(30):
            ahead_us = bench.board.t_us + 7_300
            bench.say(bench.polyline((0, (0.1 * i, 1j)), (8, (0.1 * i + 0.08, 1j)), t_apply_us=ahead_us))
            parts.append(bench.run(16))
        parts.append(bench.run(200))
        return [getattr(part, name).tobytes() for part in parts for name in part.__slots__]

    assert history(t_start_us) == history(3_000_000)


@pytest.mark.parametrize("dt_us", [1_000_001, 2**31 - 1, -50_001, -(2**31)])
def test_times_too_far_ahead_and_stale_are_dropped(pi_bench: Bench, dt_us: int) -> None:
    pi_bench.arm(0j, 0j)
    seq = pi_bench.seq
    pi_bench.say(pi_bench.polyline((0, (1 + 0j, 0j)), t_apply_us=pi_bench.board.t_us + dt_us))
    status = pi_bench.status()
    assert (status.seq, status.bad_frames, status.late_frames) == (seq, int(dt_us > 0), int(dt_us < 0))
    assert (pi_bench.run(5).reference_um == 0).all()


def test_damaged_frames_are_refused_whole(pi_bench: Bench) -> None:
    """Knots out of order, wrong counts, anything not finite."""
    pi_bench.arm(0j, 0j)

    def head(knots: int, modes: int = 2) -> bytes:
        return protocol.REFERENCE.pack(9, pi_bench.board.t_us, knots, modes)

    knot = (1.0, 0.0, 1.0, 0.0)
    frames = [
        head(2) + struct.pack("<H4fH4f", 5, *knot, 5, *knot),
        head(2) + struct.pack("<H4fH4f", 5, *knot, 4, *knot),
        head(2) + struct.pack("<H4f", 5, *knot),
        head(0),
        head(1, 3) + struct.pack("<H6f", 0, *knot, 0.0, 0.0),
        head(1, 3) + struct.pack("<H4f", 0, *knot),
        head(1) + struct.pack("<H4fB", 0, *knot, 0),
        head(1)[:3],
    ]
    for value in (math.nan, math.inf, -math.inf):
        frames += [head(2) + struct.pack("<H4fH4f", 0, *knot, 5, *knot[:k], value, *knot[k + 1 :]) for k in (0, 3)]
    for payload in frames:
        pi_bench.say(encode_frame(bytes((protocol.MSG_REFERENCE,)) + payload))
    assert pi_bench.status().bad_frames == len(frames)
    assert (pi_bench.run(20).reference_um == 0).all()


def test_an_amplitude_above_the_limit_is_scaled_with_all_modes_and_flagged(pi_bench: Bench) -> None:
    pi_bench.arm(0j, 0j)
    pi_bench.say(pi_bench.constant(6 + 8j, 1 + 0j))
    trace = pi_bench.run(5)
    np.testing.assert_allclose(trace.reference_um[-1], [2.4 + 3.2j, 0.4], rtol=1e-6)
    assert abs(trace.reference_um[-1, 0]) <= 4
    assert (trace.flags[1:] & FLAG_LIMITED).all()
    assert pi_bench.messages[-1].limited
    pi_bench.say(pi_bench.constant(4 * (1 + 9e-7), 0j))
    assert not (pi_bench.run(5).flags & FLAG_LIMITED).any()
    assert pi_bench.messages[-1].limited  # it was, since the status before
    assert not pi_bench.status().limited


def test_each_reference_is_acknowledged_once_when_it_takes_effect(pi_bench: Bench) -> None:
    pi_bench.arm(0j, 0j)
    pi_bench.messages.clear()
    t0 = pi_bench.board.t_us
    first, second = pi_bench.seq + 1, pi_bench.seq + 2
    pi_bench.say(pi_bench.polyline((0, (1 + 0j, 0j)), t_apply_us=t0 + 3_200), at_us=t0 + 100)
    pi_bench.say(pi_bench.polyline((0, (2 + 0j, 0j)), t_apply_us=t0 + 9_000), at_us=t0 + 150)
    pi_bench.run(30)
    acks = pi_bench.received(BoardStatus)
    assert [(a.seq, a.applied, a.t_received_us - t0, a.t_applied_us - t0) for a in acks] == [
        (first, True, 100, 3_500),
        (second, True, 150, 9_000),
    ]


def test_a_change_of_law_at_the_start_of_a_polyline_does_not_skip_it(bench: Bench) -> None:
    """The default law looks 1.2 ticks ahead; the paper's may then be asked for an instant before the first knot."""
    bench.arm(0j, 0j)
    t_us = bench.board.t_us + 500
    bench.say(bench.polyline((0, (0j, 0j)), (100, (4 + 0j, 0j)), t_apply_us=t_us + 580))
    bench.run(1)
    bench.say(device.encode(SetController("pi")))
    assert np.abs(bench.run(1).reference_um).max() == 0
