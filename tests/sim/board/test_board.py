"""The lock-step board: its plate against the exact solution, its time, and what it refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy.linalg import expm

from hapticd.board_protocol import HelloRequest
from hapticd.board_values import BoardHello
from hapticd.sim.board.board import CHUNK_S, Board, BoardConfig, BoardTrace, PlateModel
from hapticd.values import Knot, LimitReason, SafeDrive
from hapticd.wire import device

TICK_S = 0.0005
LOOP_PHASE_RAD = (0.4, -0.7)


DETUNING_RAD_S = 2 * np.pi * 70.0  # of a finger


def plate() -> PlateModel:
    """Four modes, the outer two 80 Hz away; every amplifier drives and every sensor sees all of them."""
    return PlateModel(
        decay_1_s=np.array([183.0, 184.0, 150.0, 210.0]),
        detuning_rad_s=2 * np.pi * np.array([-10.0, 10.0, 83.0, -77.0]),
        gain_um_per_v_s=5.2 * np.array([[1.0, 0.02], [0.03, 0.95], [0.1, -0.15], [0.12, 0.1]]),
        sensor=np.array([[1.0, 0.01, 0.1, -0.05], [-0.02, 1.0, 0.08, 0.06]]),
        noise_um=0.0,
        amplifier_limit_v=150.0,
        loop_phase_rad=LOOP_PHASE_RAD,
    )


def reference(seq: int, *w_um: complex) -> bytes:
    return device.encode_reference(seq, SafeDrive(0, (Knot(0, w_um),), LimitReason.NONE), 0)


def refer(board: Board, *w_um: complex) -> None:
    """Three references at once, which a board wants before it trusts a host."""
    for seq in range(3):
        board.receive(reference(seq, *w_um))


def touched_run(
    board: Board, detuning_rad_s: float = 0.0
) -> tuple[BoardTrace, npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Three references at once, then two fingers on the move, the second lifting halfway."""
    rng = np.random.default_rng(5)
    phi = rng.uniform(-1, 1, (80, 2, 4))
    decay_1_s = np.repeat([[90.0, 140.0]], 80, axis=0)
    decay_1_s[40:, 1] = 0.0
    refer(board, 2 + 1j, -1 + 0.5j)
    trace = BoardTrace(80, 2, 4)
    detuning = np.full((80, 2), detuning_rad_s)
    board.run(80, phi, decay_1_s, trace, contact_detuning_rad_s=detuning if detuning_rad_s else None)
    return trace, phi, decay_1_s


def exact(
    model: PlateModel,
    trace: BoardTrace,
    phi: npt.NDArray[np.float64],
    decay_1_s: npt.NDArray[np.float64],
    tick_s: float = TICK_S,
    detuning_rad_s: float = 0.0,
) -> tuple[npt.NDArray[np.complex128], npt.NDArray[np.complex128]]:
    """Plate and measurement at each tick for the recorded voltages, by matrix exponentials: dW/dt = A W - j g V."""
    w_um = np.zeros(4, dtype=np.complex128)
    voltage_v = np.zeros((len(trace) + 2, 2), dtype=np.complex128)
    voltage_v[2:] = trace.voltage_v
    plate_um, measured_um = [], []
    for i in range(len(trace)):
        load_1_s = decay_1_s[i] - 1j * detuning_rad_s * (decay_1_s[i] > 0)
        contact = np.einsum("f,fp,fq->pq", load_1_s, phi[i], phi[i])
        a = np.diag(-model.decay_1_s + 1j * model.detuning_rad_s) - contact
        integral = np.zeros(4, dtype=np.complex128)
        for voltage, span_s in ((voltage_v[i], CHUNK_S), (voltage_v[i + 1], tick_s - CHUNK_S)):
            drive = -1j * model.gain_um_per_v_s @ (np.exp(1j * np.array(model.loop_phase_rad)) * voltage)
            steady = -np.linalg.solve(a, drive)
            after = steady + expm(a * span_s) @ (w_um - steady)
            integral += np.linalg.solve(a, after - w_um - drive * span_s)
            w_um = after
        plate_um.append(w_um)
        measured_um.append(model.sensor @ integral / tick_s)
    return np.array(plate_um), np.array(measured_um)


@pytest.mark.parametrize(("control_hz", "detuning_rad_s"), [(2000.0, 0.0), (5000.0, 0.0), (2000.0, DETUNING_RAD_S)])
def test_the_plate_moves_as_the_exact_solution_does(control_hz: float, detuning_rad_s: float) -> None:
    """The voltage comes one chunk after its tick at every rate, turned by the loop's phase; sensors have one too."""
    model = replace(plate(), sensor=np.exp(1j * np.radians([[5.0], [-3.0]])) * plate().sensor)
    config = BoardConfig(control_hz=control_hz, loop_phase_rad=LOOP_PHASE_RAD)
    trace, phi, decay_1_s = touched_run(Board(model, config=config), detuning_rad_s)
    plate_um, measured_um = exact(model, trace, phi, decay_1_s, 1 / control_hz, detuning_rad_s)
    assert np.abs(trace.plate_um).max() > 1
    np.testing.assert_allclose(trace.plate_um, plate_um, rtol=0, atol=1e-6)
    np.testing.assert_allclose(trace.measured_um, measured_um, rtol=0, atol=1e-6)


def test_a_run_stops_at_the_tick_that_has_something_to_say() -> None:
    board = Board(plate())
    board.receive(reference(0, 0j, 0j))
    trace = BoardTrace(300, 2, 4)
    no_fingers = np.zeros((300, 0, 4)), np.zeros((300, 0))
    assert board.run(300, *no_fingers, trace, stop_on_transmit=True) == 1
    assert board.transmit() != b""
    assert board.run(300, *no_fingers, trace, stop_on_transmit=True) == 200  # the next STATUS, 100 ms later


def test_arrays_that_do_not_fit_are_refused_before_c_sees_them() -> None:
    board = Board(plate())
    trace = BoardTrace(10, 2, 4)
    phi, decay_1_s = np.zeros((10, 2, 4)), np.zeros((10, 2))
    for bad_phi, bad_decay in (
        (phi[:9], decay_1_s),
        (phi[:, :1], decay_1_s),
        (phi.astype(np.float32), decay_1_s),
        (np.zeros((4, 2, 10)).T, decay_1_s),
        (np.zeros((10, 2, 3)), decay_1_s),
        (phi, np.zeros((10, 1))),
    ):
        with pytest.raises(ValueError, match=r"must have C-contiguous float64 rows|do not fit arrays of 9 rows"):
            board.run(10, bad_phi, bad_decay, trace)
    for offset, other in ((1, trace), (-1, trace), (0, BoardTrace(10, 3, 4)), (0, BoardTrace(10, 2, 5))):
        with pytest.raises(ValueError, match=r"not fit a|not fit arrays of 10 rows"):
            board.run(10, phi, decay_1_s, other, offset)


def test_a_configuration_without_sense_is_refused_in_a_sentence() -> None:
    with pytest.raises(ValueError, match="The firmware refuses its configuration"):
        Board(plate(), config=BoardConfig(v_limit_v=float("nan")))
    with pytest.raises(ValueError, match="controller is 'pid', not one of pi, pi_ff, deadbeat"):
        BoardConfig(controller="pid")
    with pytest.raises(ValueError, match=r"loop_phase_rad .* \(2,\)"):
        BoardConfig(loop_phase_rad=(0.1,))
    with pytest.raises(ValueError, match=r"loop_phase_rad .* \(2,\)"):
        replace(plate(), loop_phase_rad=(0.1, float("nan")))
    with pytest.raises(ValueError, match="configured for 3 modes, its plate has 2"):
        Board(plate(), config=BoardConfig(w_limit_um=(4.0,) * 3, decay_1_s=(1.0,) * 3, **three_more()))


def three_more() -> dict[str, tuple[float, ...]]:
    return {"detuning_rad_s": (0.0,) * 3, "gain_um_per_v_s": (1.0,) * 3}


def test_a_reset_board_is_another_boot_and_drives_nothing_while_the_plate_decays() -> None:
    model = plate()
    board = Board(model, boot_id=7)
    touched_run(board)
    board.reset(8)
    assert board.t_us == 0
    board.receive(device.encode(HelloRequest()))
    (hello,) = [message for message in device.Decoder().feed(board.transmit()) if isinstance(message, BoardHello)]
    assert hello.boot_id == 8
    after = BoardTrace(60, 2, 4)
    board.run(60, np.zeros((60, 0, 4)), np.zeros((60, 0)), after)
    assert board.t_us == 60 * 500
    assert not after.voltage_v.any()
    ringing_um = np.abs(after.plate_um)
    assert ringing_um[0, 0] > 1.0
    np.testing.assert_allclose(ringing_um[1:] / ringing_um[:-1], np.tile(np.exp(-model.decay_1_s * TICK_S), (59, 1)))
