"""How well the plate follows: settling, cross-talk and tracking of both control laws, on nominal and other plates."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.bench.firmware import Phasors, follow, new_board, one_um_step, settling_ms, step, tracking_rms_um
from hapticd.sim.board import (
    FLAG_SATURATED,
    Board,
    BoardConfig,
    BoardTrace,
    PlateModel,
    reference_decay_1_s,
    reference_gain_um_per_v_s,
)
from hapticd.values import BoardStatus
from hapticd.wire import device


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
