"""The simulated technician of `first-light --sim`, who says what was found and mended."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ...design.commissioning.findings import Diagnosis
from ...sim.commissioning.bench import SimulatedTechnician
from ...sim.commissioning.mistakes import Mistake
from ...sim.commissioning.rig import FaultyRig
from .front import Front


class ShownTechnician(SimulatedTechnician):
    """Reports each mistake that was mended to the front end; `on_left` gets the remaining ones."""

    def __init__(self, rig: FaultyRig, seed: int, front: Front, on_left: Callable[[tuple[Mistake, ...]], None]) -> None:
        super().__init__(rig, seed)
        self._front, self._on_left = front, on_left

    async def mend(self, findings: Sequence[Diagnosis]) -> bool:
        """Look where the verdict points; return whether something was wrong there, and is mended."""
        before = list(self.rig.mistakes)
        found = await super().mend(findings)
        for one in before:
            if one not in self.rig.mistakes:
                where = f" ({', '.join(map(str, one.wires))})" if one.wires else ""
                self._front.tell(f"Found and mended: {one.cause.value}{where}.")
        if not found:
            self._front.tell("Nothing is wrong there.")
        self._on_left(tuple(self.rig.mistakes))
        return found
