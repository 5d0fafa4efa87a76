"""The front end in the browser: what the page shows, as one document, and the presses on its buttons.

It lives in the loop of the commissioning. A simulated rig's time is virtual: it stands still while a person thinks.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any, Final

import msgspec

from .front import heading, volts_of
from .step import PageResult, StepPage

LOOK_EVERY_S: Final = 0.02  # for a press, while a simulated rig stands still
MOST_TEXT: Final = 40
STOP: Final = "stop"
BUTTONS: Final = {
    "begin": "Begin",
    "next": "Next",
    "repeat": "Repeat",
    "finish": "Finish",
    "look": "Let the technician look",
    "done": "Done",
    "enter": "Enter",
    "none": "Not measured",
    STOP: "Stop",
}


class Press(msgspec.Struct, forbid_unknown_fields=True):
    """A press on a button of the document `number`, with what was typed; without a button the page is alive."""

    number: Annotated[int, msgspec.Meta(ge=0, le=2**31 - 1)] = 0
    button: Annotated[str, msgspec.Meta(max_length=10)] = ""
    text: Annotated[str, msgspec.Meta(max_length=MOST_TEXT)] = ""


class PageFront:
    """Shows the steps; `publish` gets each new document as JSON. `place` is the step that is shown."""

    def __init__(
        self,
        steps: Sequence[StepPage],
        passed: Mapping[str, str],
        publish: Callable[[str], None],
        *,
        is_simulated: bool,
    ) -> None:
        self._steps, self._passed, self._publish, self._is_simulated = steps, passed, publish, is_simulated
        self.place, self.is_running = 0, False
        self._number = 0
        self._notes: list[str] = []
        self._shown: dict[str, Any] = {}
        self._result: dict[str, Any] | None = None
        self._waiting: asyncio.Future[Press] | None = None

    async def ready(self, step: StepPage) -> None:
        self.place, self._result = self._steps.index(step), None
        await self._pressed("begin")
        self._notes.clear()
        self.is_running = True
        self._show(STOP)

    async def ended(self, step: StepPage, result: PageResult) -> bool:
        self.is_running = False
        judgement = result.judgement
        self._result = {
            "passed": judgement.is_passed,
            "sentences": [one.sentence for one in judgement.findings] or [judgement.passed],
            "figures": judgement.figures,
            "chart": result.chart,
        }
        if judgement.is_passed:
            is_last = step is self._steps[-1]
            return (await self._pressed("finish" if is_last else "next", "repeat")).button == "repeat"
        if self._is_simulated:
            await self._pressed("look")
        return False

    def tell(self, sentence: str) -> None:
        self._notes.append(sentence)
        self._show(*self._shown.get("buttons", {}))

    async def confirm(self, request: str, then: str = "") -> None:
        await self._pressed("done", question=f"{request}{then and f' {then}'}.")

    async def read_volts(self, what: str) -> float | None:
        while True:
            press = await self._pressed("enter", "none", question=what, is_reading=True)
            try:
                return volts_of("" if press.button == "none" else press.text)
            except ValueError as error:
                self.tell(str(error))

    def stopped(self, why: str) -> None:
        """Show why a step ended before its result: it is shown again."""
        self.is_running, self._waiting = False, None
        self.tell(why)

    def end(self, sentence: str) -> None:
        """Show the last page."""
        self._notes.append(sentence)
        self._show(is_over=True)

    def press(self, press: Press) -> None:
        """Take a press; one on an earlier document, or on a button that is not shown, is ignored."""
        waiting = self._waiting
        if waiting is None or waiting.done() or press.number != self._number:
            return
        if press.button in self._shown["buttons"]:
            waiting.set_result(press)

    async def _pressed(self, *buttons: str, question: str = "", is_reading: bool = False) -> Press:
        waiting: asyncio.Future[Press] = asyncio.get_running_loop().create_future()
        self._waiting = waiting
        stop = (STOP,) if self.is_running else ()
        self._show(*buttons, *stop, question=question, is_reading=is_reading)
        while self._is_simulated and not waiting.done():
            time.sleep(LOOK_EVERY_S)  # the loop's time would pass in an await
            await asyncio.sleep(0)
        press = await waiting
        self._show(*((STOP,) if self.is_running else ()))
        return press

    def _show(self, *buttons: str, question: str = "", is_reading: bool = False, is_over: bool = False) -> None:
        self._number += 1
        step = self._steps[self.place]
        self._shown = {
            "number": self._number,
            "steps": [{"title": one.title, "passed": self._passed.get(one.name, "")} for one in self._steps],
            "place": self.place,
            "heading": heading(step, self.place, len(self._steps)),
            "todo": step.todo,
            "picture": step.picture,
            "notes": self._notes,
            "question": question,
            "isReading": is_reading,
            "isRunning": self.is_running,
            "isOver": is_over,
            "result": self._result,
            "buttons": {name: BUTTONS[name] for name in buttons},
        }
        self._publish(msgspec.json.encode(self._shown).decode())
