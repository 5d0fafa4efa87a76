"""The person at a real bench: asked through the front end."""

from __future__ import annotations

from collections.abc import Sequence

from ...config.sections import TrackpadConfig
from ...design.commissioning.findings import Diagnosis
from .. import pads
from ..calibrate.trackpad import touch_marks
from .front import Front

SUPPLIES = ("VDDA at the board's 3.3 V pin", "the +24 V rail", "the -24 V rail")
TOUCH_WITHIN_S = 120.0
PRESS_S = 60.0  # until a stop that was pressed counts as without effect
TOUCH_S = 5.0  # to find the plate with a finger, and to rest there


class AtTheBench:
    """Asks for readings and actions."""

    def __init__(self, front: Front, pad: TrackpadConfig | None = None) -> None:
        self._front = front
        self._pad = TrackpadConfig() if pad is None else pad

    async def read_supply(self, place: int) -> float | None:
        return await self._front.read_volts(f"{SUPPLIES[place]}, V")

    async def read_idle(self, sensor: int) -> float | None:
        return await self._front.read_volts(f"DC at the ADC pin of sensor {sensor}, V")

    async def read_output(self, amplifier: int, asked_v: float) -> float | None:
        return await self._front.read_volts(
            f"peak at the output of amplifier {amplifier} ({asked_v:g} V is asked for), V; negative if it falls where "
            "the DAC's pin rises"
        )

    async def pull_cable(self) -> None:
        self._front.tell("Pull the board's USB cable NOW.")

    async def plug_cable(self) -> None:
        await self._front.confirm("Plug the cable in again")

    async def push_stop(self, pushed: bool) -> None:
        if pushed:
            self._front.tell("Press the emergency stop NOW.")
        else:
            await self._front.confirm("Release the stop")

    async def touch_plate(self, touched: bool) -> None:
        self._front.tell("Rest a finger on the plate NOW." if touched else "Lift it.")

    async def touch(
        self, marks_mm: Sequence[tuple[float, float]]
    ) -> tuple[dict[str, object], list[tuple[float, float]]]:
        source = pads.connected(self._pad)
        pad, touched = await touch_marks(source, marks_mm, TOUCH_WITHIN_S, tell=self._front.tell)
        return pads.settings(self._pad, pad.model), touched.rests_mm

    async def mend(self, findings: Sequence[Diagnosis]) -> bool:
        del findings
        await self._front.confirm("Mend it with the amplifiers' supply off", "to measure again")
        return True
