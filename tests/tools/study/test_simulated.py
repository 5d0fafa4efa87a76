"""The simulated participant: the same each time, and worse off under a control that leaks."""

from __future__ import annotations

from dataclasses import replace

import pytest

from hapticd.tools.study import simulated
from hapticd.tools.study.protocol import Design, Friction, StudyError
from hapticd.tools.study.session import Session
from hapticd.tools.study.simulated import LEAST_TRIAL_S, SimulatedParticipant

TRIAL_S = 0.9
GIVEN = Session("S1", 5, Design(trials=4))


@pytest.fixture(autouse=True)
def _trained_briefly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulated, "TRAININGS", 1)


def test_a_session_gone_on_with_gives_the_answers_of_one_in_one_go() -> None:
    whole = tuple(SimulatedParticipant(GIVEN, trial_s=TRIAL_S).answers())
    rest = SimulatedParticipant(replace(GIVEN, answers=whole[:2]), trial_s=TRIAL_S).answers()
    assert tuple(rest) == whole[2:]
    assert [answer.trial for answer in whole] == [1, 2, 3, 4]


def test_the_paper_s_scheme_leaves_less_to_tell_the_frictions_apart_by() -> None:
    """The true amplitude under the finger, low friction less high, on the same strokes."""
    contrast_um = {}
    for scheme in ("hapticd", "paper"):
        participant = SimulatedParticipant(GIVEN, scheme, trial_s=TRIAL_S)
        felt = {friction: participant.feel(friction, 11) for friction in Friction}
        contrast_um[scheme] = felt[Friction.LOW].amplitude_um - felt[Friction.HIGH].amplitude_um
        assert 40.0 < felt[Friction.LOW].speed_mm_s < 110.0
    assert 0.2 < contrast_um["paper"] < 0.95 * contrast_um["hapticd"]


def test_who_feels_finely_is_right_and_who_hardly_feels_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    right = {}
    for noise_um in (1e-3, 1e3):
        monkeypatch.setattr(simulated, "NOISE_UM", noise_um)
        given = Session("S1", 5, Design(trials=8))
        answers = SimulatedParticipant(given, trial_s=LEAST_TRIAL_S).answers()
        right[noise_um] = sum(answer.answer is shown for answer, shown in zip(answers, given.presented, strict=True))
    assert right[1e-3] == 8
    assert 1 <= right[1e3] <= 7


def test_a_trial_too_short_to_feel_anything_is_refused() -> None:
    with pytest.raises(StudyError, match="cannot be felt"):
        SimulatedParticipant(GIVEN, trial_s=0.5)


def test_half_the_participants_have_less_than_the_median_noise() -> None:
    people = [SimulatedParticipant.noise_of(seed) for seed in range(400)]
    assert abs(sum(noise_um < simulated.NOISE_UM for noise_um in people) - 200) < 50
