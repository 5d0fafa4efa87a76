"""The front end on the terminal: pages as text, and lines that a script can give as well."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from ...errors import HapticdError
from .front import heading, volts_of
from .step import PageResult, StepPage

WIDTH = 78
LATER = "Stopped: `hapticd first-light` with the same --out goes on here."


class Terminal:
    """Prints, and asks for lines; an empty line is a reading that was not taken, q ends the commissioning."""

    def __init__(self, steps: Sequence[StepPage] = ()) -> None:
        self._steps = steps

    async def ready(self, step: StepPage) -> None:
        head = f" {heading(step, self._steps.index(step), len(self._steps))} "
        print(f"\n{head:=^{WIDTH}}\n{step.todo}\n\n{step.picture}", flush=True)

    async def ended(self, step: StepPage, result: PageResult) -> bool:
        del step
        print(_verdict(result), flush=True)
        return False

    def tell(self, sentence: str) -> None:
        print(f"  {sentence}", flush=True)

    async def confirm(self, request: str, then: str = "") -> None:
        await _line(f"{request}, then press Enter{then and f' {then} (q: stop here)'}")

    async def read_volts(self, what: str) -> float | None:
        while True:
            try:
                return volts_of(await _line(f"{what} (Enter: not measured)"))
            except ValueError as error:
                self.tell(str(error))


async def _line(question: str) -> str:
    """Return the answer; meanwhile keep-alives go on. Raises HapticdError for q, and at the input's end."""
    try:
        answer = (await asyncio.to_thread(input, f"  {question}: ")).strip()
    except EOFError:
        raise HapticdError(LATER) from None
    if answer.lower() == "q":
        raise HapticdError(LATER)
    return answer


def _verdict(result: PageResult) -> str:
    judgement = result.judgement
    width = max((len(name) for name, _ in judgement.figures), default=0)
    lines = [*result.chart.splitlines(), *(f"  {name:<{width}}  {value}" for name, value in judgement.figures)]
    if judgement.is_passed:
        return "\n".join([*lines, f"PASS: {judgement.sentence}"])
    return "\n".join([*lines, *(f"FAIL: {finding.sentence}" for finding in judgement.findings)])
