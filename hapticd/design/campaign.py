"""Tasks that do not depend on each other: what searches ask of whoever plays them (`tools.campaign` has processes)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")


class TaskRunner(Protocol):
    """Returns the result of `play`, a function of a module, for each task; `what` says for people what is played."""

    def __call__(self, what: str, play: Callable[[Task], Result], tasks: Sequence[Task], /) -> list[Result]: ...


def one_by_one(_: str, play: Callable[[Task], Result], tasks: Sequence[Task], /) -> list[Result]:
    """Play them here, one after another."""
    return [*map(play, tasks)]
