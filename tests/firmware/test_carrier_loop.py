"""The loop closed over real samples at 1 MHz: it does what the envelopes say, and what only a carrier can show."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from hapticd.bench.closed_loop import Phasors, follow, settling_ms
from hapticd.sim.board.board import Board, BoardConfig, BoardTrace, PlateModel
from hapticd.sim.board.carrier import SAMPLE_HZ, Converters
from hapticd.sim.plate.ground_truth import GroundTruth

from .bench import constantly, nominal_plate

DRIVE_HZ = 29205.0
LAWS = ("pi", "pi_ff", "deadbeat")
QUIET = Converters(noise_lsb=0.0)


def new_board(
    controller: str = "deadbeat",
    converters: Converters | None = QUIET,
    *,
    known_phase_rad: float | None = None,
    control_hz: float = 2000.0,
    seed: int = 0,
) -> Board:
    """The nominal plate, without noise but for the converters'; the board is calibrated to their loop phase."""
    if known_phase_rad is None:
        known_phase_rad = 0.0 if converters is None else converters.loop_phase_rad(DRIVE_HZ)
    config = BoardConfig(controller=controller, control_hz=control_hz, loop_phase_rad=(known_phase_rad,) * 2)
    return Board(nominal_plate(config), config=config, converters=converters, seed=seed)


def stepped(board: Board, amplitude_um: float) -> BoardTrace:
    """50 ms at rest, then 50 ms of one mode at `amplitude_um`."""
    ticks = round(0.1 * board.config.control_hz)

    def knots(t_s: float) -> list[tuple[float, Phasors]]:
        return [(0.0, np.array([amplitude_um if t_s > 0.0499 else 0.0, 0j]))]

    return follow(board, knots, ticks, ticks // 10)


def after_step(trace: BoardTrace) -> Phasors:
    return trace.plate_um[len(trace) // 2 :, 0]


def ripple_um(w_um: Phasors) -> float:
    return math.sqrt(float(np.mean(np.abs(w_um - w_um.mean()) ** 2)))


def loop_phase_deg(trace: BoardTrace) -> float:
    """The angle by which a held amplitude is off -j g V / (sigma - j delta)."""
    config = BoardConfig()
    ideal = -1j * config.gain_um_per_v_s[0] / complex(config.decay_1_s[0], -config.detuning_rad_s[0])
    held = slice(-20, None)
    ratio = trace.plate_um[held, 0].mean() / (ideal * trace.voltage_v[held, 0].mean())
    return math.degrees(math.atan2(ratio.imag, ratio.real))


@pytest.mark.parametrize("control_hz", [2000.0, 5000.0])
@pytest.mark.parametrize("amplitude_um", [0.4, 1.0, 2.0])
@pytest.mark.parametrize("controller", LAWS)
def test_carrier_and_envelopes_agree_on_a_step(controller: str, amplitude_um: float, control_hz: float) -> None:
    envelope, carrier = (
        after_step(stepped(new_board(controller, converters, control_hz=control_hz), amplitude_um))
        for converters in (None, QUIET)
    )
    tick_ms = 1e3 / control_hz
    settled_ms = [settling_ms(w_um, amplitude_um, tick_ms) for w_um in (envelope, carrier)]
    assert abs(settled_ms[0] - settled_ms[1]) < 1.5 * tick_ms
    # reading W off a real signal that moves at g V is uncertain by g V / 2 w = 2 nm, in the test and in the firmware
    assert np.abs(carrier - envelope).max() < 0.004 + 0.005 * amplitude_um
    assert abs(carrier[-20:].mean() - amplitude_um) < 0.001 * amplitude_um


def test_with_a_finger_and_neighbouring_modes_they_agree_too() -> None:
    truth = GroundTruth()
    model = PlateModel(truth.decay_1_s, truth.detuning_rad_s, truth.gain_um_per_v_s, truth.sensor, 0.0, 150.0)
    points_mm = np.stack((np.linspace(5, 13, 160), np.full(160, 20.0)), axis=1)
    landing_1_s = np.where(np.arange(160) < 100, 0.0, 115.0)[:, np.newaxis]
    plates = []
    for converters in (None, QUIET):
        phase_rad = (converters.loop_phase_rad(DRIVE_HZ),) * 2 if converters else ()
        config = BoardConfig(gain_um_per_v_s=tuple(truth.nominal_gain_um_per_v_s), loop_phase_rad=phase_rad)
        board = Board(model, config=config, converters=converters)
        touch = (truth.shapes(points_mm)[:, np.newaxis, :], landing_1_s)
        plates.append(follow(board, constantly(1.0, -0.5j), 160, 20, touch).plate_um)
    assert np.abs(plates[1] - plates[0]).max() < 0.005
    assert np.abs(plates[0][100:, 0] - plates[0][99, 0]).max() > 0.01  # the finger was felt


def test_v_q_drives_w_d_and_v_d_drives_minus_w_q() -> None:
    for target, voltage in ((1 + 0j, 1j), (1j, -1 + 0j)):
        board = new_board("pi", known_phase_rad=0.0)
        trace = follow(board, constantly(target, 0.0), 6, 6)
        first = trace.voltage_v[1, 0]
        assert first / abs(first) == pytest.approx(voltage, abs=0.05)
        assert (trace.plate_um[5, 0] / target).real > 0
        assert (trace.measured_um[5, 0] / target).real > 0


@pytest.mark.parametrize("lag_us", [0.0, 0.5, 2.0])
def test_half_a_held_sample_and_the_amplifier_s_lag_are_the_loop_s_phase(lag_us: float) -> None:
    converters = Converters(noise_lsb=0.0, amplifier_lag_us=lag_us)
    measured_deg = loop_phase_deg(stepped(new_board(converters=converters, known_phase_rad=0.0), 2.0))
    half_sample_deg = 180.0 * DRIVE_HZ / SAMPLE_HZ
    assert half_sample_deg == pytest.approx(5.3, abs=0.05)
    assert measured_deg == pytest.approx(-half_sample_deg - math.degrees(math.atan(0.1835 * lag_us)), abs=0.1)
    assert measured_deg == pytest.approx(math.degrees(converters.loop_phase_rad(DRIVE_HZ)), abs=0.1)


@pytest.mark.parametrize("controller", ["pi_ff", "deadbeat"])
def test_a_calibrated_loop_keeps_a_step_on_its_axis(controller: str) -> None:
    converters = Converters(noise_lsb=0.0, amplifier_lag_us=0.5)
    cross_um = [
        float(np.abs(after_step(stepped(new_board(controller, converters, known_phase_rad=known), 1.0)).imag).max())
        for known in (0.0, converters.loop_phase_rad(DRIVE_HZ))
    ]
    assert cross_um[1] < 0.01
    assert cross_um[0] > 5 * cross_um[1]


@pytest.mark.parametrize("control_hz", [2000.0, 5000.0])
def test_a_held_amplitude_is_measured_to_what_quantisation_and_noise_leave(control_hz: float) -> None:
    converters = Converters()
    trace = stepped(new_board("pi_ff", converters, control_hz=control_hz), 2.0)
    held = slice(-round(0.02 * control_hz), None)
    # each axis: sqrt(2 / N) times the noise of a sample, its own step of 1/12 included
    expected_um = converters.um_per_lsb * math.sqrt((1 + 1 / 12) * 4 / (SAMPLE_HZ / control_hz))
    assert ripple_um(trace.measured_um[held, 0]) == pytest.approx(expected_um, rel=0.5)
    assert ripple_um(trace.plate_um[held, 0]) < 0.0004
    assert abs(trace.plate_um[held, 0].mean() - 2.0) < 0.001


def test_an_offset_of_the_converters_does_not_move_the_plate() -> None:
    held = [
        stepped(new_board(converters=c), 1.0).plate_um[-40:, 0].mean() for c in (QUIET, Converters(offset_lsb=150.0))
    ]
    assert abs(held[1] - held[0]) < 0.0005


def test_an_amplifier_beyond_its_limit_clips_and_the_loop_recovers() -> None:
    def knots(t_s: float) -> list[tuple[float, Phasors]]:
        return [(0.0, np.array([3.9 + 0j, 0]) if t_s < 0.0499 else np.array([1 + 0j, 0]))]

    nominal = new_board()
    damped = replace(nominal.model, decay_1_s=1.5 * nominal.model.decay_1_s)
    board = Board(damped, config=nominal.config, converters=QUIET)
    trace = follow(board, knots, 200, 20)
    assert np.abs(trace.voltage_v).max() <= 150.0 * (1 + 1e-6)
    assert trace.plate_um[99, 0].real < 3.8
    assert abs(trace.plate_um[-1, 0] - 1.0) < 0.01


def test_the_same_seed_gives_the_same_bits_and_another_does_not() -> None:
    plates = [stepped(new_board(converters=Converters(), seed=seed), 1.0).plate_um for seed in (1, 1, 2)]
    np.testing.assert_array_equal(plates[0], plates[1])
    assert not np.array_equal(plates[0], plates[2])


@pytest.mark.parametrize("control_hz", [1999.0, 3000.0])
def test_a_tick_that_is_no_whole_number_of_chunks_is_refused(control_hz: float) -> None:
    with pytest.raises(ValueError, match="chunks of 50 us"):
        new_board(control_hz=control_hz)


@pytest.mark.parametrize(
    ("name", "value"),
    [("volts_per_lsb", 0.0), ("um_per_lsb", math.nan), ("noise_lsb", -1.0), ("offset_lsb", math.inf)]
    + [("amplifier_lag_us", value) for value in (-1.0, 0.01, math.nan, math.inf)],
)
def test_converters_that_cannot_be_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"Converters: .*{name}"):
        Converters(**{name: value})


def test_a_loop_phase_told_twice_is_refused() -> None:
    plate = nominal_plate(BoardConfig(), loop_phase_rad=(0.1, 0.1))
    with pytest.raises(ValueError, match="omit loop_phase_rad"):
        Board(plate, converters=QUIET)
