"""Screens and keys of a session, shown by the terminal or a browser."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple, Protocol


class PanelKey(StrEnum):
    """Keys of a screen."""

    LOW = "low"
    HIGH = "high"
    NEXT = "next"
    PAUSE = "pause"


class Screen(NamedTuple):
    """One screen: heading, instructions, and its keys with their labels."""

    heading: str
    text: str
    keys: dict[PanelKey, str]


class StudyPanel(Protocol):
    """Interface that shows screens. Keys pressed before a screen was shown do not count on it."""

    def show(self, screen: Screen) -> None:
        """Replace the screen. The same screen again changes nothing."""

    def note(self, text: str) -> None:
        """Show a remark below the screen; empty removes it."""

    def pressed(self) -> PanelKey | None:
        """Return a key of the screen pressed since the last call, else None. Does not block."""


ANSWERS = {PanelKey.HIGH: "high friction: sticky", PanelKey.LOW: "low friction: slippery"}
CHOOSE = {PanelKey.HIGH: "feel high friction", PanelKey.LOW: "feel low friction"}
TRAINING_TEXT = (
    "Move one finger over the plate, slowly. A second finger that you cannot see walks on it too. Feel either "
    "friction, as often as you like, until you can tell them apart."
)
TRIAL_TEXT = "Move one finger over the plate. Is its friction high or low?"


def training(friction: PanelKey) -> Screen:
    """Return the screen of the training with this friction."""
    return Screen(f"Training: {friction} friction", TRAINING_TEXT, {**CHOOSE, PanelKey.NEXT: "begin the trials"})


def trial(number: int, trials: int) -> Screen:
    """Return the screen of a trial, which does not depend on its stimulus."""
    return Screen(f"Trial {number} of {trials}", TRIAL_TEXT, {**ANSWERS, PanelKey.PAUSE: "pause"})


def between(number: int, trials: int) -> Screen:
    """Return the screen of the rest before a trial."""
    return Screen(f"Trial {number} of {trials}", "The plate is at rest: wait a moment.", {})


def paused(answered: int, trials: int) -> Screen:
    """Return the screen of a pause, or of a resumed session; the interrupted trial is presented again."""
    text = "The plate is at rest. You can also stop here and continue another day with the same command."
    return Screen(f"{answered} of {trials} answered", text, {PanelKey.NEXT: "continue"})


def over(trials: int) -> Screen:
    """Return the last screen. The result is left to the report."""
    return Screen("Thank you", f"All {trials} answers are kept. You can lift your finger.", {})
