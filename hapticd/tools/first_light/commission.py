"""One rig's commissioning at the terminal, and what is kept of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from .bench import Bench
from .front import Front, go_on_sentence, passed_sentence
from .state import Commissioning
from .step import PageResult, StepPage
from .terminal import Terminal
from .walk import STEPS, place_of, walk

NewBench = Callable[[Front], Bench]


@dataclass(frozen=True, slots=True)
class Kept:
    """The state of a commissioning, and the folder that has its file."""

    state: Commissioning
    out: Path

    @property
    def first(self) -> int:
        """Place of the first step that has not passed."""
        return next((place for place, step in enumerate(STEPS) if step.name not in self.state.passed), len(STEPS))

    def keep(self, bench: Bench, step: StepPage, result: PageResult) -> None:
        """Write a result. Raises HapticdError."""
        if result.judgement.is_passed:
            self.state.passed[step.name] = result.judgement.sentence
        else:
            for one in STEPS[place_of(step, STEPS) :]:
                self.state.passed.pop(one.name, None)
        self.state.outputs_v = bench.outputs_v
        self.state.save(self.out)


async def at_the_terminal(kept: Kept, new_bench: NewBench) -> bool:
    """Commission at the terminal; return whether all steps have passed. Raises HapticdError."""
    front = Terminal(STEPS)
    bench = new_bench(front)
    bench.outputs_v = kept.state.outputs_v
    return await walk(bench, STEPS, front, lambda step, result: kept.keep(bench, step, result), kept.first)


def summary(kept: Kept, *, is_done: bool) -> str:
    """Return the last line at the terminal."""
    return passed_sentence(kept.out) if is_done else go_on_sentence(kept.out)
