"""What was fitted is tried against the loop before it is written."""

from __future__ import annotations

import cmath
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from parasitic_plate import AWAY_HZ, OWN, plate, swept

from hapticd.board_values import BoardHello, ModeCalibration
from hapticd.design import wiring
from hapticd.design.far_modes import with_far_modes
from hapticd.design.parasitic_fit import NO_PARASITIC
from hapticd.design.wiring import AmplifierSweep, MeasuredWiring, as_likely, fit_wiring
from hapticd.errors import DeviceError
from hapticd.sim.board.board import PLATE_MODES_MAX, PlateModel
from hapticd.tools.calibrate import trial
from hapticd.tools.calibrate.trial import LAW, NO_REMARK, fault_on, fitted_plate, try_out

HELLO = BoardHello(2, 0, "test", 1, 2, 2000.0, OWN.drive_hz, 50, (4.0, 4.0), 150.0)


FAR_HZ = (600.0, -1800.0)


def tried(sweeps: Sequence[AmplifierSweep], found: MeasuredWiring, modes: Sequence[ModeCalibration]) -> str:
    return try_out(sweeps, found, modes, HELLO, OWN.drive_hz).sentence


def ends(
    truth: PlateModel,
    modes: Sequence[ModeCalibration],
    monkeypatch: pytest.MonkeyPatch,
    hello: BoardHello = HELLO,
    law: str = LAW,
) -> int:
    """The fault in which this calibration ends on the true plate."""
    with monkeypatch.context() as patched:
        patched.setattr(trial, "fitted_plate", lambda *_: truth)
        return fault_on([fit_wiring(swept(plate(()), 1.0))], modes, hello, law, OWN.drive_hz)


@pytest.mark.parametrize("is_fitted", [False, True], ids=["hidden by noise", "not fitted"])
def test_modes_that_look_like_feedthrough_are_written_after_a_wider_sweep_alone(
    is_fitted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    truth = plate(AWAY_HZ)
    if is_fitted:
        monkeypatch.setattr(wiring, "find_parasitic", lambda *_: NO_PARASITIC)
    sweeps = swept(truth, 1.0 if is_fitted else 100.0)
    found = fit_wiring(sweeps)
    modes = found.calibrations()
    assert found.parasitic_hz() == []
    assert ends(truth, modes, monkeypatch) == 7
    assert ends(truth, [replace(mode, feedthrough_um_per_v=()) for mode in modes], monkeypatch) == 0
    with pytest.raises(DeviceError, match=r"Nothing is written: the 1\.6 nm/V that look like feedthrough"):
        tried(sweeps, found, modes)
    monkeypatch.undo()
    wider = swept(truth, 30.0, 400.0, 161)  # as it asks for
    found = fit_wiring(wider)
    assert found.parasitic_hz() == pytest.approx([29405.0, 29455.0], abs=2.0)
    assert tried(wider, found, found.calibrations()) == ""
    assert ends(truth, found.calibrations(), monkeypatch) == 0


@pytest.mark.parametrize(("noise", "through"), [(1.0, 0.0), (30.0, 0.02), (100.0, 0.002), (300.0, 0.02)])
def test_feedthrough_of_a_plate_with_noise_and_no_other_modes_is_written(
    noise: float, through: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    truth = plate((), through * np.array([[1.0, 0.1j], [0.0, 1.0 + 0.15j]]))
    sweeps = swept(truth, noise)
    found = fit_wiring(sweeps)
    assert as_likely(sweeps, found) == []
    assert tried(sweeps, found, found.calibrations()) == ""
    assert ends(truth, found.calibrations(), monkeypatch) == 0


def test_a_plate_that_the_loop_would_not_hold_is_refused_with_what_to_do() -> None:
    sweeps = swept(plate(AWAY_HZ), 1.0)
    found = fit_wiring(sweeps)
    turned = [
        replace(mode, loop_phase_rad=cmath.phase(1j * cmath.exp(1j * mode.loop_phase_rad)))
        for mode in found.calibrations()
    ]
    with pytest.raises(DeviceError, match=r"would not hold the plate as it was fitted \(fault \d+\).*294\d\d Hz"):
        tried(sweeps, found, turned)


@pytest.mark.parametrize("noise", [0.0, 1.0, 10.0])
def test_unstable_modes_beyond_the_sweep_are_found_and_a_slower_law_is_set(
    noise: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The narrow sweep does not show them, and the board is twice as fast as the plate bears."""
    truth, hello = plate(FAR_HZ), replace(HELLO, control_hz=5000.0)
    sweeps, wide = swept(truth, noise), swept(truth, noise, 2000.0, 101)
    found = fit_wiring(sweeps)
    modes = found.calibrations()
    assert try_out(sweeps, found, modes, hello, OWN.drive_hz) == NO_REMARK
    assert ends(truth, modes, monkeypatch, hello) == 7
    wider = with_far_modes(found, [*sweeps, *wide], 4)
    assert wider.parasitic_hz() == pytest.approx([27405.0, 29805.0], abs=2.0)
    said = try_out(sweeps, found, modes, hello, OWN.drive_hz, wider)
    assert said.sentence.startswith("deadbeat would make the modes swing that no amplifier is for (27405 Hz, 29805 Hz;")
    assert said.controller in ("pi_ff", "pi")
    assert ends(truth, modes, monkeypatch, hello, said.controller) == 0


@pytest.mark.parametrize("noise", [0.0, 1.0, 10.0])
@pytest.mark.parametrize("away_hz", [(), FAR_HZ])
def test_a_plate_that_bears_the_law_keeps_it(away_hz: tuple[float, ...], noise: float) -> None:
    truth = replace(plate(away_hz), sensor=np.hstack([np.eye(2), 0.05 * np.ones((2, len(away_hz)))]))
    sweeps, wide = swept(truth, noise), swept(truth, noise, 2000.0, 101)
    found = fit_wiring(sweeps)
    wider = with_far_modes(found, [*sweeps, *wide], 4)
    assert try_out(sweeps, found, found.calibrations(), HELLO, OWN.drive_hz, wider) == NO_REMARK
    assert len(wider.parasitic_hz()) == len(away_hz)


def test_what_cannot_be_tried_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    sweeps = swept(plate(()), 1.0)
    found = fit_wiring(sweeps)

    def missing(*_: object, **__: object) -> None:
        raise DeviceError("There is no build.")

    monkeypatch.setattr(trial, "Board", missing)
    said = tried(sweeps, found, found.calibrations())
    assert said == "What was fitted was not tried against the loop: There is no build."


def test_the_fitted_plate_answers_as_the_sweeps_did() -> None:
    truth = plate(AWAY_HZ, 0.002 * np.eye(2) + 0j)
    found = fit_wiring(swept(truth, 0.0))
    model = fitted_plate(found, OWN.drive_hz, 150.0)
    assert model.plate_modes <= PLATE_MODES_MAX
    for before, after in zip(swept(truth, 0.0), swept(model, 0.0), strict=True):
        largest = np.abs(before.response_um_per_v).max()
        np.testing.assert_allclose(after.response_um_per_v, before.response_um_per_v, atol=1e-3 * largest)
