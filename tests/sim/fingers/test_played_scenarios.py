"""The scenarios as they are played: figures 7, 10 and 11 of the paper, roles that follow fingers, and rest."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from hapticd.config.sections import Config
from hapticd.daemon import machine
from hapticd.daemon.settings import pipeline_settings
from hapticd.sim import lockstep
from hapticd.sim.fingers.scenarios import LAND_S, STEP_S
from hapticd.sim.lockstep import Run
from hapticd.sim.report import step_response
from hapticd.sim.settings import Settings

W_LIM_UM = 4.0


@cache
def played(scenario: str, seed: int = 1) -> Run:
    return lockstep.run(scenario, seed=seed)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("controller", ["deadbeat", "pi_ff", "pi"])
def test_figure_7_a_step_settles_within_10_ms_and_leaves_the_quadrature_alone(controller: str) -> None:
    config = Config()
    config = replace(config, device=replace(config.device, controller=controller))
    run = lockstep.run("step", settings=Settings(config=config))

    response = step_response(run.t_s, run.modal_um[:, 0], t_step_s=STEP_S)

    assert response["final_um"] == pytest.approx(1.0, abs=0.02)
    assert response["settling_ms"] <= 10.0
    assert response["overshoot_frac"] < 0.05
    assert response["largest_q_um"] < (0.1 if controller == "pi" else 0.01)
    assert np.abs(run.modal_um[:, 1]).max() < 0.05  # the other mode stays out of it
    assert np.abs(run.modal_um[run.t_s < STEP_S]).max() < 0.01
    assert Config().device.controller == "deadbeat"


def test_figure_10_the_references_stay_within_the_limits_and_both_fingers_are_served() -> None:
    run = played("paper-figure-10")

    assert run.score.largest_reference_um < 0.9 * W_LIM_UM
    assert run.score.limited_frac == 0.0
    assert run.score.leak_um < 0.03
    assert run.score.slip_error_um < 0.03
    assert np.abs(run.modal_um.imag).max() < 0.1  # W_kq = 0, but for what the neighbouring modes are paid back
    settled = run.t_s > LAND_S + 0.05
    assert rms(np.abs(run.modal_um - run.reference_um)[settled]) < 0.05  # measurement and reference are one line
    assert np.ptp(run.reference_um[settled].real, axis=0).min() > 4.0


def test_figure_11_the_references_reach_the_limits_w2_stays_nothing_and_w1_dips() -> None:
    run = played("paper-figure-11")
    settled = run.t_s > LAND_S + 0.1
    slippery_um = np.abs(run.truth_um[settled, 0])

    assert (np.abs(run.reference_um).max(axis=0) > 0.85 * W_LIM_UM).all()
    assert run.score.largest_reference_um <= W_LIM_UM
    assert 0.15 < run.score.limited_frac < 0.45
    assert run.score.leak_um < 0.03
    dips = np.flatnonzero((slippery_um[1:] < 0.5) & (slippery_um[:-1] >= 0.5))
    assert len(dips) >= 8
    assert np.median(slippery_um) == pytest.approx(1.0, abs=0.03)
    assert slippery_um.max() < 1.2


def test_a_virtual_finger_is_held_still_where_it_walks_and_the_real_one_slips() -> None:
    run = played("virtual-finger")

    assert run.score.leak_um < 0.05
    assert run.score.slip_frac > 0.6
    assert run.status["fingers"] == 1
    assert run.status["virtual_fingers"] == 1
    later = run.t_s > 1.0
    speeds_mm_s = np.hypot(*np.diff(run.finger_true_mm[later, 1], axis=0).T) * 2000.0
    assert np.median(speeds_mm_s) == pytest.approx(40.0, rel=1e-3)
    # Nothing measures a virtual finger, so where it will be is known; only where it turns is a corner cut.
    miss_mm = np.hypot(*(run.finger_predicted_mm[later, 1] - run.finger_true_mm[later, 1]).T)
    assert np.quantile(miss_mm, 0.98) < 0.05
    assert miss_mm.max() < 40.0 * 0.017


def test_at_rest_most_passes_send_nothing_and_the_leak_stays_within_tolerance(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    skipping = played("rest")
    usual = pipeline_settings(Config())
    monkeypatch.setattr(
        machine, "pipeline_settings", lambda config: replace(pipeline_settings(config), tolerance_um=1e-4)
    )
    always = lockstep.run("rest")

    touch = skipping.status["touch"]
    assert touch["skipped_standing"] > 0.6 * touch["passes"]
    assert touch["solves"] < always.status["touch"]["solves"] / 2
    assert skipping.score.leak_um < always.score.leak_um + usual.tolerance_um
