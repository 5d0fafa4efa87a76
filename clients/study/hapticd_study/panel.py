"""Screens and keys of a session, shown by the terminal or a browser."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from .experiment import Experiment

NEXT, PAUSE = "next", "pause"  # keys of a screen besides the experiment's answers
UNDER_FINGERS = "fj"  # two answers, under the index fingers; of more each has its number


class ScreenKey(NamedTuple):
    """A key of a screen: what it answers, its label, and the letter that types it; "enter" is a letter too."""

    name: str
    label: str
    letter: str


class Screen(NamedTuple):
    """One screen: heading, instructions, and its keys."""

    heading: str
    text: str
    keys: tuple[ScreenKey, ...] = ()

    def typed(self, letter: str) -> str | None:
        """Return the key that a letter types, None if it types none."""
        return next((key.name for key in self.keys if key.letter == letter), None)


class StudyPanel(Protocol):
    """Interface that shows screens. Keys pressed before a screen was shown do not count on it."""

    def show(self, screen: Screen) -> None: ...  # the same screen again changes nothing

    def note(self, text: str) -> None: ...  # below the screen; empty removes it

    def pressed(self) -> str | None: ...  # a key pressed since the last call; does not block


def answers(made: Experiment, before: str = "") -> tuple[ScreenKey, ...]:
    """Return the keys of the answers; `before` stands before each label."""
    letters = UNDER_FINGERS if len(made.choices) == 2 else "123456789"
    return tuple(
        ScreenKey(name, before + (name if before else label), letter)
        for (name, label), letter in zip(made.choices.items(), letters, strict=False)
    )


def training(made: Experiment, answer: str) -> Screen:
    """Return the screen of the training in which this answer would be right."""
    keys = (*answers(made, "feel "), ScreenKey(NEXT, "begin the trials", "enter"))
    return Screen(f"Training: {answer}", made.training, keys)


def trial(made: Experiment, heading: str) -> Screen:
    """Return the screen of a trial, which does not depend on its stimulus."""
    return Screen(heading, made.question, (*answers(made), ScreenKey(PAUSE, "pause", "p")))


def interval(heading: str, which: str) -> Screen:
    """Return the screen of an interval, "first" or "second"."""
    return Screen(heading, f"The {which} one: move over the plate.", (ScreenKey(PAUSE, "pause", "p"),))


def between(heading: str) -> Screen:
    """Return the screen of the rest before a trial."""
    return Screen(heading, "The plate is at rest: wait a moment.")


def paused(answered: int, trials: int) -> Screen:
    """Return the screen of a pause, or of a resumed session; the interrupted trial is presented again."""
    text = "The plate is at rest. You can also stop here and continue another day with the same command."
    return Screen(f"{answered} of {trials} answered", text, (ScreenKey(NEXT, "continue", "enter"),))


def graded(heading: str, *, is_right: bool) -> Screen:
    """Return the screen after an answer with feedback."""
    return Screen(heading, "Right." if is_right else "Wrong.", (ScreenKey(NEXT, "continue", "enter"),))


def over(trials: int) -> Screen:
    """Return the last screen. The result is left to the report."""
    return Screen("Thank you", f"All {trials} answers are kept. You can lift your finger.")
