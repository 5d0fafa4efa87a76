"""Runs in virtual time: what the whole of hapticd reaches on the simulated plate, and what a run holds."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from hapticd.errors import SimulationError
from hapticd.sim import lockstep
from hapticd.sim.fingers.pad_noise import FILTERED_NOISE
from hapticd.sim.fingers.scenarios import LAND_S, SCENARIOS
from hapticd.sim.lockstep import Run
from hapticd.sim.perfect import perfect
from hapticd.sim.report import ARRAYS
from hapticd.sim.settings import Settings, paper_settings

W_LIM_UM = 4.0


@pytest.fixture(scope="module")
def strokes() -> Run:
    """Three seconds at 10 cm/s on a pad whose firmware filters its noise: the defaults."""
    return lockstep.run("strokes", seconds=3.0)


# --- the bar --------------------------------------------------------------------------------------------------------


def test_the_still_finger_gets_an_eighth_of_what_the_papers_scheme_gives_it(strokes: Run) -> None:
    paper = lockstep.run("strokes", settings=paper_settings(strokes.settings), seconds=3.0)

    assert strokes.settings.noise == FILTERED_NOISE
    assert strokes.settings.speed_mm_s == 100.0
    np.testing.assert_array_equal(strokes.finger_true_mm, paper.finger_true_mm)
    np.testing.assert_array_equal(strokes.target_um, paper.target_um)
    assert strokes.score.leak_um <= 0.045
    assert strokes.score.leak_um <= paper.score.leak_um / 8.0


def test_perfect_knowledge_leaks_nothing_and_is_the_best_there_is(strokes: Run) -> None:
    best = perfect(strokes, every=20).score

    assert best.leak_um < 1e-9
    assert best.slip_error_um < strokes.score.slip_error_um
    assert best.largest_reference_um <= W_LIM_UM


# --- determinism ----------------------------------------------------------------------------------------------------


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others() -> None:
    runs = [lockstep.run("strokes", seed=seed, seconds=1.0) for seed in (7, 7, 8)]
    one, again, other = (b"".join(getattr(run, name).tobytes() for name in ARRAYS) for run in runs)

    assert one == again
    assert one != other
    assert runs[0].score == runs[1].score
    assert runs[0].status == runs[1].status


# --- what a run holds -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_the_arrays_have_the_stated_shapes_and_nan_where_a_finger_is_absent(scenario: str) -> None:
    run = lockstep.run(scenario, seconds=0.7)
    ticks, fingers, modes = 1400, len(SCENARIOS[scenario].build(1, 100.0)), 2

    assert run.finger_true_mm.shape == run.finger_predicted_mm.shape == (ticks, fingers, 2)
    assert run.reference_um.shape == run.modal_um.shape == (ticks, modes)
    np.testing.assert_allclose(run.t_s, np.arange(1, ticks + 1) / 2000.0, rtol=0.0, atol=1e-12)
    absent = np.isnan(run.finger_true_mm[..., 0])
    np.testing.assert_array_equal(np.isnan(run.finger_true_mm[..., 1]), absent)
    np.testing.assert_array_equal(np.isnan(run.truth_um), absent)
    assert np.isnan(run.target_um[absent]).all()
    assert np.isfinite(run.reference_um).all()
    assert np.isfinite(run.modal_um).all()
    assert np.isfinite(run.finger_true_mm[run.t_s > LAND_S]).all()
    assert np.isfinite(run.target_um[run.t_s > LAND_S]).all()


# --- the link and the board ------------------------------------------------------------------------------------------


def test_every_link_delay_is_met_with_the_prediction_it_needs() -> None:
    leaks_um = [
        lockstep.run("strokes", settings=Settings(link_ms=link_ms), seconds=2.0).score.leak_um
        for link_ms in (1.0, 12.0)
    ]

    assert leaks_um[0] < leaks_um[1]  # the farther ahead, the less is known
    assert leaks_um[1] < 0.15


def test_no_frame_is_late_and_the_board_never_falls_silent(strokes: Run) -> None:
    board = strokes.status["board"]
    assert (board["late_frames"], board["bad_frames"], board["deadman_trips"]) == (0, 0, 0)
    assert board["state"] == "LIVE"
    assert strokes.status["state"] == "ACTIVE"


# --- refusals -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        ({"scenario": "juggling"}, "no scenario 'juggling': choose one of strokes"),
        ({"settings": {"scheme": "best"}}, "no scheme 'best': choose one of hapticd, paper"),
        ({"settings": {"motion": "wild"}}, "choose one of real, smooth"),
        ({"settings": {"speed_mm_s": 0.0}}, "speed_mm_s is 0.0"),
        ({"settings": {"stamp_jitter_ms": -1.0}}, "stamp_jitter_ms is -1.0"),
        ({"settings": {"link_ms": math.inf}}, "link_ms is inf"),
        ({"settings": {"report_period_ms": math.nan}}, "report_period_ms is nan"),
        ({"seconds": 0.0}, "a run of 0.0 s"),
        ({"seconds": math.nan}, "a run of nan s"),
        ({"seed": -1}, "the seed is -1"),
        ({"scenario": "swap", "settings": {"speed_mm_s": 3000.0}}, "swap cannot be played at 3000 mm/s"),
    ],
)
def test_what_cannot_be_simulated_is_refused_in_a_sentence(arguments: dict[str, Any], what: str) -> None:
    given = {"scenario": "strokes", "seconds": 0.1, "settings": {}} | arguments
    with pytest.raises(SimulationError, match=what) as refusal:
        lockstep.run(**given | {"settings": Settings(**given["settings"])})
    assert isinstance(refusal.value, ValueError)
    assert str(refusal.value).endswith(".")
