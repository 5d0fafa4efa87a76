"""Constructed sessions of the paper's evaluation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec

from hapticd.tools.study.experiment import PAPER, Experiment, load
from hapticd.tools.study.session import Answer, Session, SessionFile


def paper(trials: int = 20) -> Experiment:
    return msgspec.structs.replace(load(PAPER), trials=trials)


def opposite(answer: str) -> str:
    return "high" if answer == "low" else "low"


def answer(trial: int, given: str) -> Answer:
    return Answer(trial, given, 1.7e9 + trial, 2.5, 2.25, 61.5, 0.375, 0.5, 7_000 + trial)


def session(participant: str, correct: int, trials: int = 20, seed: int = 5) -> Session:
    """A complete session with the first `correct` trials recognised."""
    made = Session(participant, seed, paper(trials))
    given = [one.correct if trial < correct else opposite(one.correct) for trial, one in enumerate(made.presented)]
    answers = tuple(answer(trial, one) for trial, one in enumerate(given, 1))
    return replace(made, answers=answers, is_over=True)


def write(folder: Path, held: Session, answers: int | None = None) -> Path:
    """Write it to the folder, with the first `answers` only if given."""
    path = folder / f"{held.participant}.jsonl"
    with SessionFile(path, replace(held, answers=(), is_over=False)) as file:
        for one in held.answers[:answers]:
            file.append(one)
        if file.session.is_complete:
            file.end()
    return path
