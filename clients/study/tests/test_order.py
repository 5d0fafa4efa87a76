"""The order of the trials: balanced, shuffled and stable; Latin squares; and adaptive methods that find a threshold."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from itertools import pairwise
from statistics import NormalDist
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from people import paper
from test_experiment import BARE, SPOT

from hapticd_study.adaptive import LevelTrack, next_level
from hapticd_study.experiment import QuestPlus, Staircase, parse
from hapticd_study.order import examples, latin_row, practised, presented
from hapticd_study.psychometric import fit

GUESS_FRAC = 0.5


def test_a_seed_has_the_same_order_under_every_version_of_python() -> None:
    assert "".join(trial.correct[0] for trial in presented(paper(12), "P1", 7)) == "hlhlhhhllllh"
    assert "".join(trial.correct[0] for trial in presented(paper(5), "P1", 2**40)) == "hlhlh"


@settings(deadline=None)
@given(st.integers(0, 2**63 - 1), st.integers(1, 60))
def test_every_condition_comes_as_often_as_the_others(seed: int, trials: int) -> None:
    made = parse({**SPOT, "trials": trials})
    counts = Counter(tuple(trial.levels.items()) for trial in presented(made, "P1", seed))
    assert sum(counts.values()) == trials
    assert all(count - trials // 4 in (0, 1) for count in counts.values())


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6])
def test_a_latin_square_balances_places_and_successors_of_blocks(count: int) -> None:
    rows = [latin_row(count, row) for row in range(2 * count)]
    for place in range(count):
        assert set(Counter(row[place] for row in rows).values()) == {2}
    assert set(Counter(pair for row in rows for pair in pairwise(row)).values()) == {2}


def test_blocks_follow_the_latin_square_by_the_participant_s_number() -> None:
    made = parse({**SPOT, "blocks": "period_mm", "trials": 8})
    for participant, first_mm in (("P01", 4.0), ("P02", 2.0), ("P03", 4.0)):
        order = [float(trial.levels["period_mm"]) for trial in presented(made, participant, 3)]
        assert order == [first_mm] * 4 + [6.0 - first_mm] * 4
    assert [t.correct for t in presented(made, "P01", 3)] != [t.correct for t in presented(made, "P01", 4)]


def test_the_standard_is_first_in_half_of_the_trials_and_the_answer_follows_from_it() -> None:
    made = parse({**BARE, "adaptive": None, "intervals": {"of": "x", "standard": 0.5}, "factors": {"x": [0.2, 0.8]},
                  "trials": 400, "plate": {"targets": [{"finger": 1, "friction": "$x"}]}})  # fmt: skip
    trials = presented(made, "P1", 1)
    assert 160 < sum(trial.is_standard_first for trial in trials) < 240
    assert all((trial.correct == "second") is trial.is_standard_first for trial in trials)


def test_an_adaptive_session_shows_the_next_trial_alone_and_continues_the_same() -> None:
    made = parse(BARE)
    shown = presented(made, "P1", 5)
    answers: list[str] = []
    while len(answers) < made.trials:
        shown = presented(made, "P1", 5, answers)
        assert len(shown) == len(answers) + 1
        answers.append(shown[-1].correct if len(answers) % 3 else "first")
    assert presented(made, "P1", 5, answers) == presented(made, "P1", 5, tuple(answers))
    assert len({trial.levels["level"] for trial in shown}) > 2


def test_practice_begins_with_easy_trials_training_with_a_stimulus_of_each() -> None:
    made = parse({**BARE, "practice": 3})
    assert [trial.levels["level"] for trial in practised(made, 5)] == [1.0] * 3
    assert examples(parse(SPOT)) == {
        "smooth": {"kind": "smooth", "period_mm": 2.0},
        "rough": {"kind": "rough", "period_mm": 2.0},
    }


def staircase(**change: Any) -> Staircase:
    return Staircase(**{"start": 1.0, "step": 0.05, "first_step": 0.1, "lowest": 0.0, "highest": 1.2, **change})


def test_a_staircase_goes_down_after_two_right_answers_and_up_after_a_wrong_one() -> None:
    answers = [True, True, True, True, False, True, True, True, False]
    levels: list[float] = []
    for count in range(len(answers) + 1):
        levels.append(next_level(staircase(), tuple(zip(levels, answers[:count], strict=False)), GUESS_FRAC))
    assert levels == pytest.approx([1.0, 1.0, 0.9, 0.9, 0.8, 0.9, 0.9, 0.85, 0.85, 0.9])


@given(st.lists(st.booleans(), max_size=60), st.sampled_from(["lower", "higher"]))
def test_a_staircase_stays_within_its_bounds(answers: list[bool], harder: str) -> None:
    method, track = staircase(harder=harder), ()
    for is_right in answers:
        level = next_level(method, track, GUESS_FRAC)
        assert method.lowest <= level <= method.highest
        track = (*track, (level, is_right))


def observer(rng: np.random.Generator) -> tuple[float, Callable[[float], bool]]:
    """A threshold, and a participant who has it: right or wrong at a level."""
    middle, spread, lapse = rng.uniform(0.25, 0.75), rng.uniform(0.08, 0.2), rng.choice([0.0, 0.02, 0.04])
    share = 1.0 - GUESS_FRAC - lapse
    return middle, lambda level: bool(rng.random() < GUESS_FRAC + share * NormalDist(middle, spread).cdf(level))


def played(method: Staircase | QuestPlus, trials: int, answer: Callable[[float], bool]) -> LevelTrack:
    track: LevelTrack = ()
    for _ in range(trials):
        level = next_level(method, track, GUESS_FRAC)
        track = (*track, (level, answer(level)))
    return track


FINE = tuple(float(level) for level in np.linspace(0.0, 1.2, 25))
QUEST_PLUS = QuestPlus(levels=FINE[::2], thresholds=FINE, spreads=(0.05, 0.1, 0.2, 0.3))


@pytest.mark.long
@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ("method", "trials", "sessions"), [(staircase(), 80, 100), (QUEST_PLUS, 40, 20)], ids=["staircase", "quest+"]
)
def test_the_interval_holds_the_threshold_of_19_participants_of_20(
    method: Staircase | QuestPlus, trials: int, sessions: int
) -> None:
    held, errors, widths = 0, [], []
    for seed in range(sessions):
        middle, answer = observer(np.random.default_rng(seed))
        curve = fit(played(method, trials, answer), GUESS_FRAC, falls=False)
        assert curve is not None
        low, high = curve.threshold_interval
        held += low <= middle <= high
        errors.append(curve.threshold - middle)
        widths.append(high - low)
    print(f"{held} of {sessions}, errors {np.std(errors):.3f}, interval {np.median(widths):.2f}")
    assert held >= 0.95 * sessions
    assert float(np.median(widths)) < 0.5  # of a range of 1.2
    assert float(np.std(errors)) < 0.09


def test_quest_plus_on_a_falling_scale_is_the_mirror_image() -> None:
    track: LevelTrack = ()
    for is_right in (True, True, False, True):
        rising = next_level(QUEST_PLUS, track, GUESS_FRAC)
        levels = [tuple(-level for level in one) for one in (QUEST_PLUS.levels, FINE)]
        mirrored = QuestPlus(levels=levels[0], thresholds=levels[1], spreads=QUEST_PLUS.spreads, harder="higher")
        falling = next_level(mirrored, tuple((-level, right) for level, right in track), GUESS_FRAC)
        assert falling == -rising
        track = (*track, (rising, is_right))
