"""From one step to the next: one that fails is mended and run again, and nothing after it runs before it has passed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from ...design.commissioning.findings import Diagnosis, Judgement
from ...errors import DeviceError
from .bench import Bench
from .drive_steps import STEPS as DRIVE_STEPS
from .drive_steps import TOUCH
from .front import StepGuide
from .pad_steps import MAP, PAD
from .step import PageResult, StepPage
from .wire_steps import STEPS as WIRE_STEPS

STEPS: Final = (*WIRE_STEPS, *DRIVE_STEPS, MAP, PAD, TOUCH)
MOST_FUTILE: Final = 3  # runs of a step in which nothing was found where the verdict points


async def walk(
    bench: Bench,
    steps: Sequence[StepPage],
    guide: StepGuide,
    on_result: Callable[[StepPage, PageResult], None],
    first: int = 0,
) -> bool:
    """Run the steps from the `first` on; return whether all have passed. It ends where nothing is found to mend."""
    place, futile = first, 0
    while place < len(steps):
        step = steps[place]
        await guide.ready(step)
        result = await _run(step, bench)
        on_result(step, result)
        is_again = await guide.ended(step, result)
        if result.judgement.is_passed:
            if is_again:
                bench.forget()
            place, futile = place + (not is_again), 0
            continue
        is_mended = await bench.person.mend(result.judgement.findings)
        bench.forget()
        futile = 0 if is_mended else futile + 1
        if futile == MOST_FUTILE:
            return False
        if is_mended:
            place = place_of(step, steps)
    return True


def place_of(step: StepPage, steps: Sequence[StepPage]) -> int:
    """Return where to go on after something was mended at a step: a calibration with a wrong wire is no calibration."""
    names = [one.name for one in steps]
    return names.index(step.back_to) if step.back_to in names else names.index(step.name)


async def _run(step: StepPage, bench: Bench) -> PageResult:
    try:
        return await step.run(bench)
    except DeviceError as error:
        return PageResult(Judgement("", (Diagnosis(str(error)),)))
