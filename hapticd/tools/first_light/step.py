"""A step of the commissioning: its page, and what measures and judges it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from ...design.commissioning.findings import Judgement
from .bench import Bench


@dataclass(frozen=True, slots=True)
class PageResult:
    """A judgement with the chart of what was measured."""

    judgement: Judgement
    chart: str = ""


@dataclass(frozen=True, slots=True)
class StepPage:
    """A page: its name for the state file, title, what to do, and a drawing.

    `back_to` is the step from which all is measured again once something was mended here; None: this one.
    """

    name: str
    title: str
    todo: str
    picture: str
    run: Callable[[Bench], Awaitable[PageResult]]
    back_to: str | None = None
