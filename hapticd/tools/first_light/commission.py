"""One rig's commissioning: what is kept of it, at the terminal or in the browser."""

from __future__ import annotations

import asyncio
import socket
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ...errors import HapticdError
from .bench import Bench
from .front import FUTILE, Front, go_on_sentence, passed_sentence
from .page_front import STOP, PageFront, Press
from .state import Commissioning
from .step import PageResult, StepPage
from .terminal import Terminal
from .walk import STEPS, place_of, walk

STOPPED = "Stopped: the board is silent. The step begins again."
GONE = "The page was closed or did not answer: the step was stopped, and the board is silent. It begins again."

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


async def in_the_browser(kept: Kept, new_bench: NewBench, listener: socket.socket, *, opens: bool) -> bool:
    """Commission by the page; a step that is stopped, or breaks, is shown again. Returns True at the end."""
    from .server import PageServer

    commissioning = PageCommissioning(kept, asyncio.get_running_loop())
    with PageServer(listener, commissioning.on_press, commissioning.on_gone) as server:
        print(f"first light: {server.address}", flush=True)
        if opens:
            webbrowser.open(server.address)
        await commissioning.run(new_bench, server.publish)
    return True


class PageCommissioning:
    """The walk through the steps as presses lead it. `on_press` and `on_gone` may be called by any thread."""

    def __init__(self, kept: Kept, loop: asyncio.AbstractEventLoop) -> None:
        self._kept, self._loop = kept, loop
        self._walking: asyncio.Task[bool] | None = None
        self._why = ""

    def on_press(self, press: Press) -> None:
        if press.button == STOP:
            self._loop.call_soon_threadsafe(self._stop, STOPPED)
        else:
            self._loop.call_soon_threadsafe(self._press, press)

    def on_gone(self) -> None:
        """Stop the running step: it is out of sight."""
        self._loop.call_soon_threadsafe(self._stop, GONE)

    async def run(self, new_bench: NewBench, publish: Callable[[str], None]) -> None:
        """Lead through the steps until all have passed."""
        kept = self._kept
        self._front = front = PageFront(STEPS, kept.state.passed, publish, is_simulated=kept.state.is_simulated)
        bench = new_bench(front)
        bench.outputs_v = kept.state.outputs_v
        own, place, is_done = asyncio.current_task(), kept.first, False
        assert own is not None
        while not is_done:
            going = walk(bench, STEPS, front, lambda step, result: kept.keep(bench, step, result), place)
            self._why, self._walking = "", self._loop.create_task(going)
            try:
                is_done = await self._walking
                why = FUTILE
            except asyncio.CancelledError:
                if not self._walking.cancelled() or own.cancelling():
                    raise
                why = self._why
            except HapticdError as error:
                why = str(error)
            if not is_done:
                bench.forget()
                front.stopped(why)
            place = front.place
        front.end(passed_sentence(kept.out))

    def _press(self, press: Press) -> None:
        self._front.press(press)

    def _stop(self, why: str) -> None:
        if self._walking is not None and self._front.is_running:
            self._why = why
            self._walking.cancel()


def summary(kept: Kept, *, is_done: bool) -> str:
    """Return the last line at the terminal."""
    return passed_sentence(kept.out) if is_done else go_on_sentence(kept.out)
