"""The person at a real bench: asked on the terminal, in lines that a script can give as well."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Sequence

from ...config.sections import TrackpadConfig
from ...design.commissioning.findings import Diagnosis
from ...errors import HapticdError
from .. import pads
from ..calibrate.trackpad import touch_marks

SUPPLIES = ("VDDA at the board's 3.3 V pin", "the +24 V rail", "the -24 V rail")
TOUCH_WITHIN_S = 120.0
PRESS_S = 60.0  # until a stop that was pressed counts as without effect
TOUCH_S = 5.0  # to find the plate with a finger, and to rest there
LATER = "Stopped: `hapticd first-light` with the same --out goes on here."


class AtTheBench:
    """Asks for readings and actions; an empty line is a reading that was not taken, q ends the commissioning."""

    def __init__(self, pad: TrackpadConfig | None = None) -> None:
        self._pad = TrackpadConfig() if pad is None else pad

    async def read_supply(self, place: int) -> float | None:
        return await _volts(f"{SUPPLIES[place]}, V")

    async def read_idle(self, sensor: int) -> float | None:
        return await _volts(f"DC at the ADC pin of sensor {sensor}, V")

    async def read_output(self, amplifier: int, asked_v: float) -> float | None:
        return await _volts(
            f"peak at the output of amplifier {amplifier} ({asked_v:g} V is asked for), V; negative if it falls where "
            "the DAC's pin rises"
        )

    async def pull_cable(self) -> None:
        print("  Pull the board's USB cable NOW.", flush=True)

    async def plug_cable(self) -> None:
        await _line("Plug the cable in again, then press Enter")

    async def push_stop(self, pushed: bool) -> None:
        if pushed:
            print("  Press the emergency stop NOW.", flush=True)
        else:
            await _line("Release the stop, then press Enter")

    async def touch_plate(self, touched: bool) -> None:
        print("  Rest a finger on the plate NOW." if touched else "  Lift it.", flush=True)

    async def touch(
        self, marks_mm: Sequence[tuple[float, float]]
    ) -> tuple[dict[str, object], list[tuple[float, float]]]:
        pad, touched = await touch_marks(pads.connected(self._pad), marks_mm, TOUCH_WITHIN_S)
        return pads.settings(self._pad, pad.model), touched.rests_mm

    async def mend(self, findings: Sequence[Diagnosis]) -> bool:
        del findings
        await _line("Mend it with the amplifiers' supply off, then press Enter to measure again (q: stop here)")
        return True


async def _line(question: str) -> str:
    """Return the answer; meanwhile keep-alives go on. Raises HapticdError for q, and at the input's end."""
    try:
        answer = (await asyncio.to_thread(input, f"  {question}: ")).strip()
    except EOFError:
        raise HapticdError(LATER) from None
    if answer.lower() == "q":
        raise HapticdError(LATER)
    return answer


async def _volts(question: str) -> float | None:
    while answer := await _line(f"{question} (Enter: not measured)"):
        try:
            value = float(answer.replace(",", "."))
        except ValueError:
            value = math.nan
        if math.isfinite(value):
            return value
        print(f"  {answer!r} is no number of volts, such as 1.65.", flush=True)
    return None
