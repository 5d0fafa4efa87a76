"""What a commissioning needs of its front end: pages, results, questions."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final, Protocol

from ..calibrate.folder import CONFIG_FILE
from .step import PageResult, StepPage

FUTILE: Final = "It ends here: nothing was found where the verdict points."


class StepGuide(Protocol):
    """Leads a person through the steps."""

    async def ready(self, step: StepPage) -> None:
        """Show a step's page; return when it may begin."""

    async def ended(self, step: StepPage, result: PageResult) -> bool:
        """Show a step's result; return whether one that has passed is run again."""


class Front(StepGuide, Protocol):
    """A guide that also asks and reports while a step runs."""

    def tell(self, sentence: str) -> None:
        """Show a sentence at once."""

    async def confirm(self, request: str, then: str = "") -> None:
        """Ask for an action and return when it is done; `then` says what follows, "to measure again"."""

    async def read_volts(self, what: str) -> float | None:
        """Ask for a reading in V; None if it was not taken."""


class Unguided:
    """Shows nothing, and lets each step begin."""

    async def ready(self, step: StepPage) -> None:
        del step

    async def ended(self, step: StepPage, result: PageResult) -> bool:
        del step, result
        return False


def volts_of(text: str) -> float | None:
    """Return a typed number of volts, None for an empty text. Raises ValueError with a sentence."""
    if not text.strip():
        return None
    try:
        value = float(text.strip().replace(",", "."))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{text.strip()[:40]!r} is no number of volts, such as 1.65.")
    return value


def heading(step: StepPage, place: int, count: int) -> str:
    """Return the title of the step at `place`, from 0, of `count`."""
    return f"{place + 1} of {count}: {step.title}"


def passed_sentence(out: Path) -> str:
    """Return what to do once all steps have passed."""
    return f"All steps have passed: hapticd run --config {out / CONFIG_FILE}"


def go_on_sentence(out: Path) -> str:
    """Return how to go on where nothing was found to mend."""
    return f"{FUTILE} Go on with the same --out ({out})."
