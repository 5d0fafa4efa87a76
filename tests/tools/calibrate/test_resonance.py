"""Sweeps of the simulated plate against its ground truth, and the verdicts on sound and unsound ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from virtual_board import PlateLink, in_virtual_time

from hapticd.board_protocol import Sweep
from hapticd.board_values import BoardHello, SweepPoint
from hapticd.design.resonance import Resonance
from hapticd.errors import SweepEndedError
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.tools.calibrate import resonance
from hapticd.tools.calibrate.resonance import refined, sweep_modes
from hapticd.tools.calibrate.step import Outcome
from hapticd.tools.firmware.conversation import Conversation
from hapticd.tools.firmware.sweep import ModeSweep
from hapticd.values import FloatArray

PLAN = Sweep(0, 29105.0, 29305.0, 21, 70, 15.0)
HELLO = BoardHello(2, 0, "test", 1, 2, 2000.0, 29205.0, 50, (4.0, 4.0), 150.0)


def swept(settings: PlateSettings, plate: GroundTruth | None = None) -> resonance.MeasuredModes:
    async def sweep() -> resonance.MeasuredModes:
        async with Conversation(PlateLink(plate or GroundTruth(settings)), "the bench") as board:  # type: ignore[arg-type]
            return await sweep_modes(board, PLAN)

    found: resonance.MeasuredModes = in_virtual_time(sweep())
    return found


@pytest.mark.parametrize(
    "settings",
    [PlateSettings(detune_hz=35.0, q_factor=300.0, loop_phase_rad=0.7), PlateSettings(q_factor=2500.0)],
    ids=["warm and damped", "sharp"],
)
def test_every_mode_is_found_within_half_a_hertz_and_three_percent_of_quality(settings: PlateSettings) -> None:
    truth = GroundTruth(settings)
    sweeps = swept(settings).sweeps
    assert [one.mode for one in sweeps] == [0, 1]
    for one in sweeps:
        assert one.fit.frequency_hz == pytest.approx(truth.frequency_hz[one.mode], abs=0.5)
        assert one.fit.q_factor == pytest.approx(settings.q_factor, rel=0.03)


@pytest.mark.parametrize(
    ("wiring", "patches", "sentence"),
    [
        ("paper", np.eye(2), ""),
        ("identity", np.eye(2)[::-1], "Amplifiers 0 and 1, or their sensors, are swapped: amplifier 0 moves sensor 1."),
        (
            "identity",
            np.diag([1.0, -1.0]),
            "Amplifier 1 or sensor 1 is inverted: the sensor moves against the amplifier.",
        ),
    ],
)
def test_wires_are_measured_and_what_is_wrong_with_them_is_said(
    wiring: str, patches: FloatArray, sentence: str
) -> None:
    """In the paper's wiring each amplifier drives both modes, and both sensors see both."""
    settings = PlateSettings(wiring=wiring)
    truth = GroundTruth(settings)
    truth.gain_um_per_v_s = truth.gain_um_per_v_s @ patches
    measured = swept(settings, truth)
    found = resonance.verdict(HELLO, measured, {}, is_simulated=True)
    assert found.outcome is (Outcome.WARN if sentence else Outcome.PASS)
    assert sentence in found.sentence
    assert measured.parasitic_hz == ()
    for mode in measured.modes:
        assert mode.frequency_hz == pytest.approx(truth.frequency_hz[mode.mode], abs=0.5)
        does = truth.gain_um_per_v_s[:2] @ np.array([one.drive for one in measured.modes]).T
        sees = np.array([one.sense for one in measured.modes]) @ truth.sensor[:, :2]
        whole = sees @ does * np.exp(1j * mode.loop_phase_rad)
        assert abs(whole[mode.mode, 1 - mode.mode]) < 0.01 * abs(whole[mode.mode, mode.mode])


@pytest.mark.parametrize("wiring", ["identity", "paper"])
def test_modes_that_no_amplifier_is_for_are_named_and_are_no_feedthrough(wiring: str) -> None:
    """The reference plate's next pair, 125 and 105 Hz below the drive, with gains and pick-up of 0.4: at the sweep's
    end both look like one."""
    measured = swept(PlateSettings(wiring=wiring, parasitic_coupling=0.4, parasitic_pickup=0.4))
    next_hz = GroundTruth(PlateSettings()).frequency_hz[2:]
    assert measured.parasitic_hz == pytest.approx([next_hz.mean()], abs=5.0)
    found = resonance.verdict(HELLO, measured, {}, is_simulated=True)
    assert found.outcome is Outcome.PASS
    assert [figure.value for figure in found.figures if figure.name == "parasitic mode"] == [*measured.parasitic_hz]
    assert np.abs([mode.feedthrough_um_per_v for mode in measured.modes]).max() < 2e-4


def a_sweep(mode: int, f0_hz: float = 29195.0, *, gain: float = 7.5, residual: float = 0.0) -> ModeSweep:
    f_hz = np.linspace(29105.0, 29305.0, 41)
    fit = Resonance(f0_hz, 500.0, gain, 0.1, 0j, residual)
    return ModeSweep(mode, f_hz, fit.response(f_hz), fit)


@pytest.mark.parametrize(
    ("second", "outcome", "sentence"),
    [
        (a_sweep(1, 29215.0), Outcome.PASS, "the drive of 29205.0 Hz lies 0.0 Hz off the best one"),
        (a_sweep(1, 29215.0, residual=0.08), Outcome.WARN, "Mode 1 leaves 8 %"),
        (a_sweep(1, 29215.0, residual=0.5), Outcome.FAIL, "Mode 1 shows no resonance circle"),
        (a_sweep(1, 29500.0), Outcome.FAIL, "Mode 1 lies outside its sweep"),
        (a_sweep(1, 29295.0), Outcome.WARN, "At 29245.0 Hz full amplitude would take"),
        (a_sweep(1, 29215.0, gain=2.0), Outcome.WARN, "the amplifiers end at 150"),
    ],
)
def test_sound_pair_passes_and_a_fault_is_reported(second: ModeSweep, outcome: Outcome, sentence: str) -> None:
    sweeps = (a_sweep(0), second)
    measured = resonance.MeasuredModes(sweeps, tuple(one.fit.calibration(one.mode) for one in sweeps))
    found = resonance.verdict(HELLO, measured, {}, is_simulated=True)
    assert found.outcome is outcome
    assert sentence in found.sentence


def test_a_resonance_that_the_plan_shows_well_is_not_swept_again() -> None:
    fit = a_sweep(0).fit
    assert refined(PLAN, fit, HELLO) is None
    sharp = refined(PLAN, replace(fit, q_factor=5000.0), HELLO)
    assert sharp is not None
    assert sharp.dwell_ms > 10 * 5000.0 / (29.195 * 3.15)
    assert sharp.start_hz < fit.frequency_hz < sharp.stop_hz < PLAN.stop_hz
    narrow = refined(PLAN, replace(fit, frequency_hz=29500.0), HELLO)
    assert narrow is not None
    assert narrow.start_hz < 29500.0 < narrow.stop_hz
    assert refined(PLAN, replace(fit, frequency_hz=39500.0), HELLO) is None  # the board does not sweep there


def test_a_sweep_in_pieces_has_the_same_frequencies() -> None:
    for points in (1, 2, 6, 7, 13, 14, 41, 2001):
        plan = replace(PLAN, points=points)
        parts = resonance.pieces(plan)
        f_hz = np.concatenate([np.linspace(part.start_hz, part.stop_hz, part.points) for part in parts])
        np.testing.assert_allclose(f_hz, np.linspace(plan.start_hz, plan.stop_hz, points))
        assert max(part.points for part in parts) < 2 * resonance.PIECE_POINTS


@pytest.mark.parametrize("ended", [1, resonance.TRIES])
def test_a_piece_that_the_board_ends_is_swept_again_but_not_for_ever(
    ended: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = [SweepEndedError("ended")] * ended

    async def stumbling(board: Conversation, plan: Sweep) -> list[SweepPoint]:
        if left:
            raise left.pop()
        return await measured(board, plan)

    measured = resonance.sweep.measured
    monkeypatch.setattr(resonance.sweep, "measured", stumbling)
    if ended < resonance.TRIES:
        assert swept(PlateSettings()).sweeps[0].fit.frequency_hz == pytest.approx(29195.0, abs=0.5)
    else:
        with pytest.raises(SweepEndedError):
            swept(PlateSettings())
