"""The whole program of the firmware as a process: it boots, answers, closes the loop and stops the plate.

Steps of the bench hold its time, so nothing here depends on how fast this computer is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

from hapticd.board_protocol import BoardState, ClearFault
from hapticd.board_values import BoardHello
from hapticd.core.solver.public import solve
from hapticd.sim.plate.ground_truth import GroundTruth
from hapticd.wire import device

from .emulated import STEP_US, Emulator, Host

pytestmark = pytest.mark.long
WRAPS_SOON_US = (1 << 32) - 300_000  # the board's clock, in the middle of a run
TARGET_UM = np.array((1.0, 0.0))
W_LIM_UM = 4.0


@pytest.fixture
def start(program: Path) -> Iterator[Callable[..., Host]]:
    with ExitStack() as stack:

        def started(t_start_us: int = 0) -> Host:
            running = Emulator(program, boot_id=0x1234, t_start_us=t_start_us)
            return Host(stack.enter_context(running), t_start_us=t_start_us)

        yield started


def still_finger_mm(t_us: np.ndarray) -> np.ndarray:
    return np.stack((-25.0 + 0.0 * t_us, -35.0 + 0.0 * t_us), axis=-1)


def moving_finger_mm(t_us: np.ndarray) -> np.ndarray:
    """5 cm/s past the other, clear of positions where two modes cannot serve both."""
    return np.stack((-34.0 + 5e-6 * t_us, -16.0 - 5e-5 * t_us), axis=-1)


def shapes(t_us: np.ndarray) -> np.ndarray:
    """(T, 2 fingers, 2 modes)"""
    points = np.stack((moving_finger_mm(t_us), still_finger_mm(t_us)), axis=-2)
    return GroundTruth().shapes(points)[..., :2]


def play_two_fingers(host: Host, us: int) -> np.ndarray:
    """Connect, then solve and ask every 10 ms as the daemon does; the knots asked for, (K, 3): us, W_X, W_Y."""
    while not host.session.ready:
        host.step()
    start_us = host.now_us
    previous = None
    asked: list[tuple[float, ...]] = []
    while host.now_us < start_us + us:
        knots_us = host.now_us + np.array((2500, 7500, 12500, 17500))
        references = []
        for phi in shapes(knots_us - start_us):
            previous = solve(phi, TARGET_UM, W_LIM_UM, previous_um=previous).modal_um
            references.append(previous)
        host.ask(*((int(at - host.now_us), w) for at, w in zip(knots_us, references, strict=True)))
        asked += [(float(at), *w) for at, w in zip(knots_us[:2], references[:2], strict=True)]
        host.run(10_000)
    return np.array(asked)


def test_the_program_boots_and_says_who_it_is(start: Callable[..., Host]) -> None:
    host = start()
    host.step()
    (hello,) = (message for message in host.messages if isinstance(message, BoardHello))
    device.check_hello(hello, modes=2, w_limit_um=(4.0, 4.0), v_limit_v=150.0)
    assert hello.boot_id == 0x1234


def test_the_clocks_find_each_other(start: Callable[..., Host]) -> None:
    host = start(WRAPS_SOON_US)
    host.run(500_000)
    assert host.session.ready
    away_us = host.session.clock.to_board_us(host.now_us * 1000) - host.now_us
    # All that is between them is the step: the host stamps at its ends what the board answers within.
    assert abs((away_us + (1 << 31)) % (1 << 32) - (1 << 31)) <= STEP_US


def test_two_moving_fingers_close_the_loop(start: Callable[..., Host]) -> None:
    host = start(WRAPS_SOON_US)
    asked = play_two_fingers(host, 600_000)
    t_us, w_um = host.plate_um()
    settled = (t_us > asked[0, 0] + 60_000) & (t_us < asked[-1, 0])
    t_us, w_um = t_us[settled], w_um[settled]
    planned_um = np.stack([np.interp(t_us, asked[:, 0], asked[:, mode]) for mode in (1, 2)], axis=1)
    got_um = np.abs(np.einsum("tnm,tm->tn", shapes(t_us - (asked[0, 0] - 2500)), w_um))

    assert host.now_us > 1 << 32  # the board's clock has wrapped
    assert host.statuses[-1].state is BoardState.LIVE
    assert host.statuses[-1].deadman_trips == host.statuses[-1].bad_frames == host.statuses[-1].late_frames == 0
    # References change by up to 6 um/s, and the clocks agree within a step of 2.5 ms: 0.015 um, and as much again for
    # the corners at the knots.
    assert np.ptp(planned_um, axis=0).max() > 0.8
    assert np.abs(w_um - planned_um).max() < 0.03
    assert np.sqrt(np.mean(got_um[:, 1] ** 2)) < 0.02
    assert np.sqrt(np.mean((got_um[:, 0] - 1.0) ** 2)) < 0.03


def test_what_the_board_measures_is_what_the_plate_does(start: Callable[..., Host]) -> None:
    host = start()
    while not host.session.ready:
        host.step()
    for _ in range(20):
        host.ask((0, (1.5, -0.8)))
        host.run(10_000)
    truth_um = np.mean([report.plate_um for report in host.reports[-10:]], axis=0)
    # Two microns of full scale 9 um in 12 bits, averaged over 500 samples, and 0.04 % of the oscillator's table.
    np.testing.assert_allclose(host.statuses[-1].measured_um, truth_um, atol=2e-3)
    np.testing.assert_allclose(truth_um, (1.5, -0.8), atol=2e-3)


def test_damaged_bytes_are_counted_and_move_nothing(start: Callable[..., Host]) -> None:
    host = start()
    host.step()
    noise = np.random.default_rng(5).integers(1, 256, 3000, dtype=np.uint8).tobytes()
    frames = [noise[at : at + 60] + b"\0" for at in range(0, len(noise), 60)]
    for frame in frames:
        host.say(frame)
        host.step()
    assert host.statuses[-1].bad_frames > 0
    host.say(device.encode(ClearFault()))  # which asks for a status
    host.step()
    assert host.statuses[-1].bad_frames == len(frames)
    assert all(report.plate_um == (0j, 0j) for report in host.reports)


def test_the_same_bytes_in_give_the_same_bytes_out(start: Callable[..., Host]) -> None:
    runs = []
    for _ in range(2):
        host = start(WRAPS_SOON_US)
        play_two_fingers(host, 100_000)
        runs.append((host.line, host.reports))
    assert len(runs[0][0]) > 500
    assert runs[0] == runs[1]
