"""How well the plate follows: settling, cross-talk and tracking of both control laws, on nominal and other plates."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

from hapticd.sim.board import (
    FLAG_SATURATED,
    Board,
    BoardConfig,
    BoardTrace,
    PlateModel,
    reference_decay_1_s,
    reference_gain_um_per_v_s,
)
from hapticd.values import BoardStatus, Knot, LimitReason, SafeDrive
from hapticd.wire import device

Phasors = npt.NDArray[np.complex128]
TICK_MS = 0.5


def new_board(controller: str, quality: float = 500.0, damping: float = 1.0, detune_hz: float = 0.0) -> Board:
    """A plate of this quality, known to the board but for `damping` and `detune_hz`."""
    gain = reference_gain_um_per_v_s(quality)
    config = BoardConfig(controller=controller, decay_1_s=reference_decay_1_s(quality), gain_um_per_v_s=(gain, gain))
    model = PlateModel(
        decay_1_s=damping * np.array(config.decay_1_s),
        detuning_rad_s=np.array(config.detuning_rad_s) + 2 * np.pi * detune_hz,
        gain_um_per_v_s=gain * np.eye(2),
        sensor=np.eye(2),
        noise_um=0.0006,
        amplifier_limit_v=150.0,
    )
    return Board(model, config=config)


def follow(
    board: Board, knots_at: Callable[[float], list[tuple[float, Phasors]]], ticks: int, every: int
) -> BoardTrace:
    """Drives the board with what `knots_at` says at each frame's start (s): (ms after it, amplitudes)."""
    trace = BoardTrace(ticks, 2, 2)
    seq = 0
    for tick in range(0, ticks, every):
        knots = tuple(Knot(round(ms * 1e6), tuple(w)) for ms, w in knots_at(board.t_us * 1e-6))
        for _ in range(3 if tick == 0 else 1):
            board.receive(device.encode_reference(seq, SafeDrive(0, knots, LimitReason.NONE), board.t_us))
            seq += 1
        rows = min(every, ticks - tick)
        board.run(rows, np.zeros((rows, 0, 2)), np.zeros((rows, 0)), trace, tick)
    return trace


def step(board: Board, from_um: Phasors, to_um: Phasors) -> Phasors:
    """What the plate does from the tick of the step on."""

    def knots(t_s: float) -> list[tuple[float, Phasors]]:
        return [(0.0, to_um if t_s > 0.0999 else from_um)]

    return follow(board, knots, 400, 20).plate_um[200:]


def settling_ms(w_um: Phasors, target_um: complex) -> float:
    """Time after which the amplitude stays within 2 %."""
    outside = np.flatnonzero(np.abs(w_um - target_um) > 0.02 * abs(target_um))
    return 0.0 if len(outside) == 0 else float(outside[-1] + 2) * TICK_MS


def one_um_step(controller: str, **plate: float) -> tuple[float, float, float]:
    """Settling (ms), overshoot and largest W_q (fractions) of a step of W_d from 0 to 1000 nm, W_q held at 0."""
    w_um = step(new_board(controller, **plate), np.zeros(2, complex), np.array([1 + 0j, 0]))[:, 0]
    return settling_ms(w_um, 1.0), float(w_um.real.max()) - 1, float(np.abs(w_um.imag).max())


def test_the_default_law_settles_a_micrometre_in_under_three_ms() -> None:
    settling, overshoot, cross = one_um_step("pi_ff")
    assert settling <= 3.0
    assert overshoot < 0.005
    assert cross < 0.005


def test_the_papers_law_settles_in_the_papers_ten_ms() -> None:
    settling, overshoot, cross = one_um_step("pi")
    assert 9.0 <= settling <= 11.0
    assert overshoot < 0.05
    assert cross < 0.08


@pytest.mark.parametrize("quality", [200.0, 500.0, 1000.0])
@pytest.mark.parametrize(("damping", "detune_hz"), [(1, 0), (0.5, 0), (1.5, 0), (1, 20), (1, -20)])
def test_the_default_law_settles_in_under_ten_ms_on_every_plate(
    quality: float, damping: float, detune_hz: float
) -> None:
    assert one_um_step("pi_ff", quality=quality, damping=damping, detune_hz=detune_hz)[0] < 10.0


def test_v_q_drives_w_d_and_minus_v_d_drives_w_q() -> None:
    for target, voltage in ((1 + 0j, 1j), (1j, -1 + 0j)):
        trace = follow(new_board("pi"), lambda _, w=target: [(0.0, np.array([w, 0]))], 4, 4)  # type: ignore[misc]
        first = trace.voltage_v[1, 0]
        assert first / abs(first) == pytest.approx(voltage, abs=0.05)
        assert (trace.plate_um[3, 0] / target).real > 0


def test_a_step_keeps_the_node_under_a_still_finger() -> None:
    """Two amplitudes of one direction: the combination that the still finger feels stays near zero on the way."""
    still = np.array([0.6, -0.8])
    along = np.array([0.8, 0.6])
    leak_um = {
        controller: float(np.abs(step(new_board(controller), 0.5 * along + 0j, 3.0 * along + 0j) @ still).max())
        for controller in ("pi", "pi_ff")
    }
    assert leak_um["pi_ff"] < 0.004
    assert leak_um["pi"] > 0.1  # each mode goes its own way there


def tracking_rms_um(controller: str, f_hz: float) -> float:
    """Sinusoids of 3 um as of fingers that cross the waves, sent as polylines of 3 ms knots 90 times a second."""

    def amplitudes(t_s: float) -> Phasors:
        return 3 * np.array([np.sin(2 * np.pi * f_hz * t_s), np.cos(1.6 * np.pi * f_hz * t_s)]) + 0j

    def knots(t_s: float) -> list[tuple[float, Phasors]]:
        return [(ms, amplitudes(t_s + ms * 1e-3)) for ms in range(0, 18, 3)]

    trace = follow(new_board(controller), knots, 1600, 22)
    return float(np.sqrt(np.mean(np.abs(trace.plate_um - trace.reference_um)[200:] ** 2)))


@pytest.mark.parametrize("f_hz", [2.0, 10.0, 15.0])
def test_the_default_law_follows_a_moving_reference_to_nanometres_without_delay(f_hz: float) -> None:
    assert tracking_rms_um("pi_ff", f_hz) < 0.002


def test_the_papers_law_lags_a_moving_reference() -> None:
    assert 0.05 < tracking_rms_um("pi", 10.0) < 0.2


@pytest.mark.parametrize("controller", ["pi", "pi_ff"])
def test_a_reference_out_of_reach_saturates_and_lets_go_again(controller: str) -> None:
    def knots(t_s: float) -> list[tuple[float, Phasors]]:
        return [(0.0, np.array([3.9 + 0j, 0]) if t_s < 0.0999 else np.array([1 + 0j, 0]))]

    trace = follow(new_board(controller, damping=1.5), knots, 400, 20)
    assert (trace.flags[100:200] & FLAG_SATURATED).all()
    assert np.abs(trace.voltage_v[150, 0]) == pytest.approx(150, rel=1e-5)
    assert settling_ms(trace.plate_um[200:, 0], 1.0) < 20
    assert not (trace.flags[300:] & FLAG_SATURATED).any()


def test_a_reference_out_of_reach_is_shrunk_whole() -> None:
    """At Q 200 the voltage holds under 2 um of the first mode; the pattern on the plate is kept, and follows a step."""
    config = BoardConfig(decay_1_s=reference_decay_1_s(200.0))
    gain = np.diag(config.gain_um_per_v_s)
    model = PlateModel(np.array(config.decay_1_s), np.array(config.detuning_rad_s), gain, np.eye(2), 0.0, 150.0)
    wanted_um = np.array([3.9 + 0j, 1])
    board = Board(model, config=config)
    w_um = step(board, wanted_um * [1, -1], wanted_um)
    np.testing.assert_allclose(w_um[-1] / w_um[-1, 0], wanted_um / wanted_um[0], atol=1e-3)
    assert 1.5 < w_um[-1, 0].real < 2
    assert settling_ms(w_um[:, 1], w_um[-1, 1]) < 10
    (status,) = device.Decoder().feed(board.transmit())
    assert isinstance(status, BoardStatus)
    assert status.saturated


def test_coupling_compensation_keeps_a_touch_out_of_the_other_axis() -> None:
    """A finger takes away W_d only; far from resonance the plate itself would turn the loss into W_q."""
    gain = reference_gain_um_per_v_s()
    config = BoardConfig(detuning_rad_s=(-2 * np.pi * 60, 2 * np.pi * 60))
    model = PlateModel(
        np.array(config.decay_1_s), np.array(config.detuning_rad_s), gain * np.eye(2), np.eye(2), 0.0, 150.0
    )
    board = Board(model, config=config)
    follow(board, lambda _: [(0.0, np.array([1 + 0j, 0]))], 100, 20)
    trace = BoardTrace(30, 2, 2)
    board.run(30, np.tile([1.0, 0.0], (30, 1, 1)), np.full((30, 1), 90.0), trace)
    loss_um = 1 - trace.plate_um[:, 0].real.min()
    assert loss_um > 0.03
    assert np.abs(trace.plate_um[:, 0].imag).max() < 0.2 * loss_um
