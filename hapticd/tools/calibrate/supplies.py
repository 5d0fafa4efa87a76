"""Supplies, idle levels and interlocks of a bare rig, by a meter and the board's log."""

from __future__ import annotations

from ...design.commissioning import rest
from ...design.commissioning.findings import Judgement
from .bench import Bench, bench_step

CONFIG_FAULT = 6  # the board refuses its own configuration
PICTURE = """\
   3.3 V pin ----o meter     +24 V o---+---o drive
   ADC pin k ----o meter, DC   0 V o---+
   ground    ----o           -24 V o---+---o drive

   PB14 (PC6) o--[thermostat]----o ground
   PB15 (PC7) o--[stop, closed]--o ground
"""


async def _supplies(bench: Bench) -> Judgement:
    person = bench.person
    async with bench.board() as board:
        readings = rest.MeterReadings(
            board_v=await person.read_supply(0),
            plus_v=await person.read_supply(1),
            minus_v=await person.read_supply(2),
            idle_v=tuple([await person.read_idle(sensor) for sensor in range(board.hello.modes)]),
        )
        is_configured = (await board.status()).fault_code != CONFIG_FAULT
        _, events = await board.events()
        drives = is_configured and await board.drives()
        interlock = None if drives else rest.interlock_of(events)
    return rest.judge_supply(readings, interlock, is_configured=is_configured, supply_fell=rest.SUPPLY in events)


STEP = bench_step(
    "supplies",
    1,
    "read supplies, idle levels and interlocks of a bare rig",
    "Switch the supplies on. Read VDDA at the board's 3.3 V pin, both rails, and the DC at each ADC pin.",
    PICTURE,
    _supplies,
    back_to="supplies",
)
