"""Runs in virtual time: what the whole of hapticd reaches on the simulated plate, and what a run holds."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from hapticd.errors import SimulationError
from hapticd.sim import lockstep
from hapticd.sim.board.board import FLAG_LIMITED
from hapticd.sim.fingers.pad_noise import FILTERED_NOISE, PadNoise
from hapticd.sim.fingers.scenarios import LAND_S, SCENARIOS
from hapticd.sim.lockstep import Run, Settings
from hapticd.sim.perfect import perfect
from hapticd.sim.plate.ground_truth import GroundTruth
from hapticd.sim.report import ARRAYS

SEEDS = (1, 2, 3, 4, 5)
W_LIM_UM = 4.0


@pytest.fixture(scope="module")
def strokes() -> dict[int, Run]:
    """Ten seconds at 10 cm/s on a pad whose firmware filters its noise: the defaults."""
    return {seed: lockstep.run("strokes", seed=seed) for seed in SEEDS}


@pytest.fixture(scope="module")
def papers(strokes: dict[int, Run]) -> dict[int, Run]:
    """The same fingers under the paper's scheme."""
    return {
        seed: lockstep.run("strokes", settings=lockstep.paper(ours.settings), seed=seed)
        for seed, ours in strokes.items()
    }


@pytest.fixture(scope="module")
def white() -> dict[int, tuple[Run, Run]]:
    """The same on a pad of white noise of 0.05 mm, and under the paper's scheme."""
    ours = Settings(noise=PadNoise(0.05))
    schemes = ours, lockstep.paper(ours)
    return {
        seed: tuple(lockstep.run("strokes", settings=scheme, seed=seed) for scheme in schemes)  # type: ignore[misc]
        for seed in SEEDS
    }


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


# --- the bar --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_the_still_finger_gets_an_eighth_of_what_the_papers_scheme_gives_it(
    seed: int, strokes: dict[int, Run], papers: dict[int, Run]
) -> None:
    ours, paper = strokes[seed], papers[seed]

    assert ours.settings.noise == FILTERED_NOISE
    assert ours.settings.speed_mm_s == 100.0
    np.testing.assert_array_equal(ours.finger_true_mm, paper.finger_true_mm)
    np.testing.assert_array_equal(ours.target_um, paper.target_um)
    assert ours.score.leak_um <= 0.045
    assert ours.score.leak_um <= paper.score.leak_um / 8.0


def test_over_all_seeds_the_still_finger_gets_a_tenth(strokes: dict[int, Run], papers: dict[int, Run]) -> None:
    ours_um2, papers_um2 = (sum(run.score.leak_um**2 for run in runs.values()) for runs in (strokes, papers))
    assert ours_um2 <= papers_um2 / 10.0**2


@pytest.mark.long
def test_on_a_pad_of_white_noise_the_still_finger_gets_a_ninth_and_over_all_seeds_an_eleventh(
    white: dict[int, tuple[Run, Run]],
) -> None:
    leaks_um = np.array([[run.score.leak_um for run in runs] for runs in white.values()])
    assert (leaks_um[:, 0] <= 0.045).all()
    assert (leaks_um[:, 0] <= leaks_um[:, 1] / 9.0).all()
    assert rms(leaks_um[:, 0]) <= rms(leaks_um[:, 1]) / 11.0


@pytest.mark.parametrize("seed", SEEDS)
def test_the_still_finger_does_not_gain_by_the_other_ones_loss(
    seed: int, strokes: dict[int, Run], papers: dict[int, Run]
) -> None:
    assert strokes[seed].score.slip_frac > 0.65
    assert strokes[seed].score.slip_error_um < papers[seed].score.slip_error_um + 0.05


@pytest.mark.parametrize("seed", SEEDS)
def test_no_reference_is_ever_above_the_limit(seed: int, strokes: dict[int, Run], papers: dict[int, Run]) -> None:
    for run in (strokes[seed], papers[seed]):
        assert np.abs(run.reference_um).max() <= W_LIM_UM
        assert run.score.largest_reference_um == np.abs(run.reference_um).max()
        assert run.status["touch"]["gated"] == 0
        assert not run.status["board"]["limited"]
        assert np.abs(run.modal_um).max() < 1.1 * W_LIM_UM  # the plate itself, overshoot and all


def test_perfect_knowledge_leaks_nothing_and_is_the_best_there_is(strokes: dict[int, Run]) -> None:
    best = perfect(strokes[1], every=20).score

    assert best.leak_um < 1e-9
    assert best.slip_error_um < strokes[1].score.slip_error_um
    assert best.largest_reference_um <= W_LIM_UM


# --- determinism ----------------------------------------------------------------------------------------------------


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others() -> None:
    runs = [lockstep.run("strokes", seed=seed, seconds=1.0) for seed in (7, 7, 8)]
    one, again, other = (b"".join(getattr(run, name).tobytes() for name in ARRAYS) for run in runs)

    assert one == again
    assert one != other
    assert runs[0].score == runs[1].score
    assert runs[0].status == runs[1].status


def test_a_longer_run_begins_like_the_shorter_one(strokes: dict[int, Run]) -> None:
    short = lockstep.run("strokes", seed=1, seconds=1.0)

    for name in ("t_s", "finger_true_mm", "target_um", "reference_um", "modal_um", "truth_um"):
        np.testing.assert_array_equal(getattr(short, name), getattr(strokes[1], name)[: len(short.t_s)])


# --- what a run holds -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_the_arrays_have_the_stated_shapes_and_nan_where_a_finger_is_absent(scenario: str) -> None:
    run = lockstep.run(scenario, seconds=0.7)
    ticks, fingers, modes = 1400, len(SCENARIOS[scenario].build(1, 100.0)), 2

    assert run.t_s.shape == run.limited.shape == (ticks,)
    assert run.finger_true_mm.shape == run.finger_predicted_mm.shape == (ticks, fingers, 2)
    assert run.target_um.shape == run.truth_um.shape == (ticks, fingers)
    assert run.reference_um.shape == run.modal_um.shape == (ticks, modes)
    assert [getattr(run, name).dtype for name in ("reference_um", "modal_um", "truth_um")] == [np.complex128] * 3
    np.testing.assert_allclose(run.t_s, np.arange(1, ticks + 1) / 2000.0, rtol=0.0, atol=1e-12)
    absent = np.isnan(run.finger_true_mm[..., 0])
    np.testing.assert_array_equal(np.isnan(run.finger_true_mm[..., 1]), absent)
    np.testing.assert_array_equal(np.isnan(run.truth_um), absent)
    assert np.isnan(run.target_um[absent]).all()
    assert np.isfinite(run.reference_um).all()
    assert np.isfinite(run.modal_um).all()
    assert np.isfinite(run.finger_true_mm[run.t_s > LAND_S]).all()
    assert np.isfinite(run.target_um[run.t_s > LAND_S]).all()


def test_what_a_finger_gets_is_the_plate_s_motion_at_its_true_place(strokes: dict[int, Run]) -> None:
    run = strokes[2]
    own = np.einsum("tnm,tm->tn", GroundTruth().shapes(run.finger_true_mm)[..., :2], run.modal_um)
    present = np.isfinite(run.truth_um)

    away_um = np.abs(own - run.truth_um)[present]
    assert 0.0 < rms(away_um) < 0.03  # the neighbour modes' share


def test_where_the_reference_took_a_finger_to_be_is_near_where_it_was(strokes: dict[int, Run]) -> None:
    run = strokes[3]
    known = np.isfinite(run.finger_predicted_mm[..., 0])
    miss_mm = np.hypot(*np.moveaxis(run.finger_predicted_mm - run.finger_true_mm, -1, 0))

    assert known[run.t_s > LAND_S + 0.1].all()
    assert not known[run.t_s < LAND_S].any()
    assert rms(miss_mm[known]) < 0.35  # the paper's 15 ms at 10 cm/s are 1.5 mm


def test_limited_marks_targets_out_of_reach(strokes: dict[int, Run]) -> None:
    run = strokes[1]
    part = (run.t_s > 1.0) & np.isfinite(run.truth_um).all(axis=1)
    met = np.abs(np.abs(run.truth_um[:, 0]) - 1.0)

    assert run.limited.dtype == np.bool_
    assert run.score.limited_frac == run.limited.mean()
    assert np.median(met[part & ~run.limited]) < 0.03
    assert np.median(met[part & run.limited]) > 0.2


# --- the link and the board ------------------------------------------------------------------------------------------


def test_every_link_delay_is_met_with_the_prediction_it_needs() -> None:
    leaks_um = [
        lockstep.run("strokes", settings=Settings(link_ms=link_ms), seconds=4.0).score.leak_um
        for link_ms in (1.0, 12.0)
    ]

    assert leaks_um[0] < leaks_um[1]  # the farther ahead, the less is known
    assert leaks_um[1] < 0.15


def test_no_frame_is_late_and_the_board_never_falls_silent(strokes: dict[int, Run]) -> None:
    for run in strokes.values():
        board = run.status["board"]
        assert (board["late_frames"], board["bad_frames"], board["deadman_trips"]) == (0, 0, 0)
        assert board["state"] == "LIVE"
        assert run.status["state"] == "ACTIVE"


def test_a_history_that_was_dropped_leaves_the_rest_as_it_was() -> None:
    whole, dropped = (lockstep.Simulation(SCENARIOS["strokes"].build(1, 100.0), Settings(), 1) for _ in "ab")
    whole.run(2.2)
    dropped.run(2.2, lambda share: dropped.forget() if 0.498 < share < 0.502 else None)
    t_s, rest = whole.world.recording().t_s, dropped.world.recording()
    kept = np.flatnonzero(t_s >= rest.t_s[0])
    assert 0.5 < rest.t_s[0] < 1.1
    assert np.array_equal(rest.t_s, t_s[kept])
    assert np.array_equal(rest.plate_um, whole.world.recording().plate_um[kept])


def test_the_world_stops_at_the_given_time_and_its_recording_is_continuous() -> None:
    simulation = lockstep.Simulation(SCENARIOS["circles"].build(1, 100.0), Settings(), 1)
    simulation.run(1.2345)
    recording = simulation.world.recording()

    assert len(recording.t_s) == int(1.2345 * 2000)
    assert {len(getattr(recording, name)) for name in recording.__slots__} == {len(recording.t_s)}
    steps = np.abs(np.diff(recording.plate_um[1200:, :2], axis=0))
    assert steps.max() < 0.8  # what the amplifiers move in a tick, from one chunk of ticks to the next as within
    assert not (recording.flags & FLAG_LIMITED).any()
    assert all(later > earlier for earlier, later in pairwise(recording.t_s))


# --- refusals -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        ({"scenario": "juggling"}, "no scenario 'juggling': choose one of strokes"),
        ({"settings": {"scheme": "best"}}, "no scheme 'best': choose one of hapticd, paper"),
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


def test_the_paper_s_scheme_has_a_sensor_of_its_own() -> None:
    ours = Settings(noise=PadNoise(0.1), link_ms=3.0)

    assert lockstep.paper(ours) == Settings("paper", noise=PadNoise(0.1), link_ms=3.0, report_period_ms=10.0)
