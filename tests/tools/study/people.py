"""Constructed sessions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from hapticd.tools.study.protocol import Design, FrictionLevel
from hapticd.tools.study.session import Answer, Session, SessionFile


def opposite(friction: FrictionLevel) -> FrictionLevel:
    return FrictionLevel.HIGH if friction is FrictionLevel.LOW else FrictionLevel.LOW


def answer(trial: int, friction: FrictionLevel) -> Answer:
    return Answer(trial, friction, 1.7e9 + trial, 2.5, 2.25, 61.5, 0.375)


def session(participant: str, correct: int, trials: int = 20, seed: int = 5) -> Session:
    """A complete session with the first `correct` trials recognised."""
    made = Session(participant, seed, Design(trials=trials))
    given = [friction if trial < correct else opposite(friction) for trial, friction in enumerate(made.presented)]
    answers = tuple(answer(trial, friction) for trial, friction in enumerate(given, 1))
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
