"""Constructed sessions: of the paper's evaluation, and of participants who answer by a rule."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec

from hapticd_study.experiment import PAPER, Experiment, load
from hapticd_study.order import Trial
from hapticd_study.session import Answer, Session, SessionFile


def paper(trials: int = 20) -> Experiment:
    return msgspec.structs.replace(load(PAPER), trials=trials)


def answer(trial: int, given: str) -> Answer:
    return Answer(trial, given, 1.7e9 + trial, 2.5, 2.25, 61.5, 0.375, 0.5, 0.2, 7_000 + trial)


def answered(session: Session, rule: Callable[[Trial], str]) -> Session:
    """The session, complete, with each trial answered by the rule."""
    while not session.is_complete:
        number = len(session.answers)
        given = answer(number + 1, rule(session.presented[number]))
        session = replace(session, answers=(*session.answers, given))
    return replace(session, is_over=True)


def session(participant: str, correct: int, trials: int = 20, seed: int = 5) -> Session:
    """A complete session of the paper's with the first `correct` trials recognised."""
    left, wrong = iter(range(trials)), {"low": "high", "high": "low"}
    return answered(
        Session(participant, seed, paper(trials)),
        lambda trial: trial.correct if next(left) < correct else wrong[trial.correct],
    )


def write(folder: Path, held: Session, answers: int | None = None) -> Path:
    """Write it to the folder, with the first `answers` only if given."""
    path = folder / f"{held.participant}.jsonl"
    with SessionFile(path, replace(held, answers=(), is_over=False)) as file:
        for one in held.answers[:answers]:
            file.append(one)
        if file.session.is_complete:
            file.end()
    return path
