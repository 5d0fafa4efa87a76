"""Strokes of a hand: their statistics are those of recorded touches, and a path is a function of time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hand_statistics import APPLE, played, statistics

from hapticd.__main__ import main
from hapticd.sim.fingers.paths import Touch, Touches
from hapticd.sim.fingers.real_strokes import HAND, RealStrokes
from hapticd.sim.fingers.scenarios import LAND_S, REAL, SCENARIOS, SMOOTH, with_motion

OTHER_SEEDS = range(1, 6)  # than those that the hand was fitted on


@pytest.mark.long
def test_a_hand_moves_like_those_that_were_recorded() -> None:
    found = statistics(played(HAND, OTHER_SEEDS, 20.0))
    for name, wanted in APPLE.items():
        assert found[name] == pytest.approx(wanted, rel=0.5 if name == "rest_frac" else 0.2), name


def test_positions_do_not_depend_on_what_was_asked_before() -> None:
    t_s = np.linspace(0.0, 40.0, 4001)
    whole = RealStrokes(3).position_mm(t_s)
    piecewise = RealStrokes(3)
    backwards = [piecewise.position_mm(part) for part in np.array_split(t_s[::-1], 7)]
    assert np.array_equal(np.concatenate(backwards)[::-1], whole)
    assert not np.array_equal(RealStrokes(4).position_mm(t_s), whole)


def test_a_hand_stays_on_the_plate_and_moves_without_jumps() -> None:
    for seed in range(5):
        path_mm = RealStrokes(seed).position_mm(np.arange(0.0, 30.0, 1e-3))
        assert np.abs(path_mm).max() < 58.0
        assert np.hypot(*np.diff(path_mm, axis=0).T).max() < 1.5  # mm in a millisecond


def test_two_hands_keep_apart_nearly_always() -> None:
    t_s = np.arange(0.0, 60.0, 0.01)
    first = RealStrokes(2, (-30.0, 0.0))
    second = RealStrokes(3, (30.0, 0.0), avoid=first)
    apart_mm = np.hypot(*(first.position_mm(t_s) - second.position_mm(t_s)).T)
    assert np.mean(apart_mm < 18.0) < 0.005
    assert apart_mm.min() > 10.0


@pytest.mark.parametrize("name", ["strokes", "both-slip", "virtual-finger"])
def test_hands_land_where_smooth_strokes_do_with_their_targets(name: str) -> None:
    smooth = SCENARIOS[name].build(5, 100.0)
    for usual, hand in zip(smooth, with_motion(smooth, REAL), strict=True):
        assert hand.steps_um == usual.steps_um
        if usual.path is not None and hand.path is not None:
            at_s = np.array([LAND_S - 0.01, LAND_S])
            assert np.allclose(hand.path.position_mm(at_s), usual.path.position_mm(at_s), atol=0.05, equal_nan=True)


def test_a_hand_that_lifts_and_lands_again_goes_on_with_its_movements() -> None:
    t_s = np.arange(0.0, 8.0, 0.01)
    is_down = ((t_s >= 1.0) & (t_s < 3.0)) | ((t_s >= 4.0) & (t_s < 7.0))
    smooth = SCENARIOS["strokes"].build(5, 100.0)
    for usual, hand in zip(smooth, with_motion(smooth, REAL), strict=True):
        assert usual.path is not None
        lifting = replace(usual, path=Touches((Touch(usual.path, 1.0, 3.0), Touch(usual.path, 4.0, 7.0))))
        found, steady = with_motion((lifting,), REAL)[0].path, hand.path
        assert found is not None
        assert steady is not None
        assert np.array_equal(found.position_mm(t_s)[is_down], steady.position_mm(t_s)[is_down])
        assert np.isnan(found.position_mm(t_s)[~is_down]).all()


def test_a_command_plays_real_hands_unless_a_speed_or_smooth_ones_are_asked_for(tmp_path: Path) -> None:
    def played_mm(*arguments: str) -> bytes:
        out = tmp_path / "run.npz"
        assert (
            main(["simulate", "strokes", "--seconds", "0.6", "--alone", "--force", "--out", str(out), *arguments]) == 0
        )
        with np.load(out) as arrays:
            return bytes(arrays["finger_true_mm"].tobytes())

    assert played_mm() == played_mm("--motion", REAL) != played_mm("--motion", SMOOTH)
    assert played_mm("--speed", "100") == played_mm("--motion", SMOOTH)
