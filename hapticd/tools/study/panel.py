"""What a participant sees and presses, whatever shows it: the terminal or a browser."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple, Protocol


class Key(StrEnum):
    """What can be pressed."""

    LOW = "low"
    HIGH = "high"
    NEXT = "next"
    PAUSE = "pause"


class Screen(NamedTuple):
    """One screen: a heading, what to do, and the keys that count on it with what they say."""

    heading: str
    text: str
    keys: dict[Key, str]


class Panel(Protocol):
    """A place for screens. Keys pressed before a screen was shown do not count on it."""

    def show(self, screen: Screen) -> None:
        """Replace what is shown. The same screen again changes nothing."""

    def note(self, text: str) -> None:
        """A passing remark below the screen; empty: none."""

    def pressed(self) -> Key | None:
        """A key of the screen, pressed since the last call. Does not wait."""


ANSWERS = {Key.HIGH: "high friction: sticky", Key.LOW: "low friction: slippery"}
CHOOSE = {Key.HIGH: "feel high friction", Key.LOW: "feel low friction"}
TRAINING_TEXT = (
    "Move one finger over the plate, slowly. A second finger that you cannot see walks on it too. Feel either "
    "friction, as often as you like, until you can tell them apart."
)
TRIAL_TEXT = "Move one finger over the plate. Is its friction high or low?"


def training(feeling: Key) -> Screen:
    """The training, while this friction is to be felt."""
    return Screen(f"Training: {feeling} friction", TRAINING_TEXT, {**CHOOSE, Key.NEXT: "begin the trials"})


def trial(number: int, trials: int) -> Screen:
    """A trial; says nothing of what is presented."""
    return Screen(f"Trial {number} of {trials}", TRIAL_TEXT, {**ANSWERS, Key.PAUSE: "pause"})


def between(number: int, trials: int) -> Screen:
    """The rest before a trial."""
    return Screen(f"Trial {number} of {trials}", "The plate is at rest: wait a moment.", {})


def paused(answered: int, trials: int) -> Screen:
    """A pause, or the way back into a session; the trial that it broke off is presented anew."""
    text = "The plate is at rest. You can also stop here and go on another day: start the same command again."
    return Screen(f"{answered} of {trials} answered", text, {Key.NEXT: "go on"})


def over(trials: int) -> Screen:
    """The end. How well it went is for the report, when all have been here."""
    return Screen("Thank you", f"All {trials} answers are kept. You can lift your finger.", {})
