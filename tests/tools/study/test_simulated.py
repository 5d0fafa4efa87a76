"""The simulated participant: reproducible, and less successful under a control that leaks."""

from __future__ import annotations

from dataclasses import replace

import pytest
from people import paper

from hapticd.tools.study import simulated
from hapticd.tools.study.session import Session
from hapticd.tools.study.simulated import LEAST_TRIAL_S, SimulatedParticipant

TRIAL_S = 0.9
GIVEN = Session("S1", 5, paper(4))


@pytest.fixture(autouse=True)
def _trained_briefly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulated, "TRAININGS", 1)


def test_a_continued_session_gives_the_same_answers() -> None:
    whole = tuple(SimulatedParticipant(GIVEN, trial_s=TRIAL_S).answers())
    rest = SimulatedParticipant(replace(GIVEN, answers=whole[:2]), trial_s=TRIAL_S).answers()
    assert tuple(rest) == whole[2:]
    assert [answer.trial for answer in whole] == [1, 2, 3, 4]


def test_the_paper_s_scheme_leaves_less_contrast() -> None:
    """The true amplitude under the finger, low friction less high, on the same strokes."""
    contrast_um = {}
    for scheme in ("hapticd", "paper"):
        participant = SimulatedParticipant(GIVEN, scheme, trial_s=TRIAL_S)
        stimuli = {friction: participant.play({"friction": friction}, 11) for friction in ("low", "high")}
        contrast_um[scheme] = stimuli["low"].amplitude_um - stimuli["high"].amplitude_um
        assert 40.0 < stimuli["low"].speed_mm_s < 110.0
    assert 0.2 < contrast_um["paper"] < 0.95 * contrast_um["hapticd"]


def test_little_noise_gives_right_answers_and_much_noise_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    right = {}
    for noise_um in (1e-3, 1e3):
        monkeypatch.setattr(simulated, "NOISE_UM", noise_um)
        given = Session("S1", 5, paper(8))
        answers = SimulatedParticipant(given, trial_s=LEAST_TRIAL_S).answers()
        right[noise_um] = sum(
            answer.answer == shown.correct for answer, shown in zip(answers, given.presented, strict=True)
        )
    assert right[1e-3] == 8
    assert 1 <= right[1e3] <= 7
