"""Parasitic modes outside a sweep: they are fitted as modes, and feedthrough is what is constant."""

from __future__ import annotations

import numpy as np
import pytest
from parasitic_plate import NO_THROUGH, OWN, plate, swept

from hapticd.design import wiring
from hapticd.design.parasitic_fit import NO_PARASITIC
from hapticd.design.wiring import AmplifierSweep, MeasuredWiring, fit_wiring
from hapticd.sim.board.board import Board, BoardConfig, PlateModel
from hapticd.sim.board.closed_loop import follow
from hapticd.values import FloatArray

FALSE_UM_PER_V = 0.0015  # of feedthrough that these modes look like, where no pole is fitted to them


def calibrated(model: PlateModel, found: MeasuredWiring) -> Board:
    modes = found.calibrations()
    models = [one.model(OWN.drive_hz) for one in modes]
    config = BoardConfig(
        decay_1_s=(models[0].decay_1_s, models[1].decay_1_s),
        detuning_rad_s=(models[0].detuning_rad_s, models[1].detuning_rad_s),
        gain_um_per_v_s=(models[0].gain_um_per_v_s, models[1].gain_um_per_v_s),
        loop_phase_rad=tuple(one.loop_phase_rad for one in modes),
        drive=np.array([one.drive for one in modes]).T,
        sense=np.array([one.sense for one in modes]),
        feedthrough_um_per_v=np.array([one.feedthrough_um_per_v for one in modes]),
    )
    return Board(model, config=config)


def swings(board: Board) -> bool:
    """Whether the board has ended the drive within 0.2 s."""
    trace = follow(board, lambda _: [(0.0, np.array([2.0, -1.0], complex))], 400, 100)
    return not np.abs(trace.voltage_v[-1]).any()


def test_modes_beside_the_sweep_are_no_feedthrough_and_the_loop_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    found = fit_wiring(swept(plate()))
    assert found.parasitic_hz() == pytest.approx([29405.0, 29455.0], abs=40.0)
    assert np.abs(found.background_um_per_v).max() < FALSE_UM_PER_V / 5.0
    assert [fit.frequency_hz for fit in found.fits] == pytest.approx([29195.0, 29215.0], abs=0.05)
    assert max(fit.residual_frac for fit in found.fits) < 0.001
    assert not swings(calibrated(plate(), found))
    monkeypatch.setattr(wiring, "find_parasitic", lambda *_: NO_PARASITIC)
    believed = fit_wiring(swept(plate()))
    assert np.abs(believed.background_um_per_v).max() > FALSE_UM_PER_V
    assert 0.01 < max(fit.residual_frac for fit in believed.fits) < 0.03
    assert swings(calibrated(plate(), believed))


@pytest.mark.parametrize("away_hz", [(200.0, 250.0), (-200.0, 250.0), (225.0,), (-230.0, -210.0)])
def test_what_is_constant_stays_feedthrough_beside_them(away_hz: tuple[float, ...]) -> None:
    through = 0.02 * np.eye(2) + 0.003j
    found = fit_wiring(swept(plate(away_hz, through)))
    assert found.parasitic_hz()
    np.testing.assert_allclose(found.background_um_per_v, through, atol=FALSE_UM_PER_V / 5.0)
    assert not swings(calibrated(plate(away_hz, through), found))


@pytest.mark.parametrize("noise", [0.0, 1.0, 100.0])
@pytest.mark.parametrize("through", [NO_THROUGH, 0.02 * np.eye(2)])
def test_a_plate_without_them_is_fitted_as_ever(
    noise: float, through: FloatArray, monkeypatch: pytest.MonkeyPatch
) -> None:
    sweeps = swept(plate((), through.astype(complex)), noise)
    found = fit_wiring(sweeps)
    assert found.parasitic_hz() == []
    monkeypatch.setattr(wiring, "find_parasitic", lambda *_: NO_PARASITIC)
    assert found.calibrations() == fit_wiring(sweeps).calibrations()
    assert found.fits == fit_wiring(sweeps).fits


def test_too_few_points_show_no_neighbouring_modes() -> None:
    few = [AmplifierSweep(k, one.frequency_hz[::4], one.response_um_per_v[::4]) for k, one in enumerate(swept(plate()))]
    assert fit_wiring(few).parasitic_hz() == []
