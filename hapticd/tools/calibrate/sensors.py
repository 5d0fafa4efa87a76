"""The sensors of a bare rig at rest: hum and noise in the board's ticks."""

from __future__ import annotations

from ...design.commissioning import rest
from ...design.commissioning.findings import Judgement
from . import measure
from .bench import Bench, bench_step, design_of

PICTURE = """\
   plate  |~~~~~~  no drive, no finger on it

   sensor k --coax--> front end --> ADC k
                                    noise? hum?
"""


async def _rest(bench: Bench) -> Judgement:
    async with bench.board() as board:
        design = await design_of(board)
        t_us, measured_um = await measure.at_rest(board)
    return rest.judge_rest(rest.at_rest(t_us, measured_um, design), design, len(t_us))


STEP = bench_step(
    "sensors",
    2,
    "measure noise and hum of the sensors at rest",
    "Take everything off the plate and keep still for two seconds.",
    PICTURE,
    _rest,
    back_to="sensors",
)
