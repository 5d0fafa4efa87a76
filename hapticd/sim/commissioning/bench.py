"""The line to a simulated rig, in the event loop's time, and the technician at its bench."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...design.commissioning.findings import Diagnosis
from ..board.virtual_link import VirtualLink
from .rig import FaultyRig

METER_FRAC = 0.003  # of a reading, as a cheap meter has it
SCOPE_FRAC = 0.03
TREMBLE_MM = 0.3  # of a finger on its mark
AWAY_S = 0.5  # of a pulled cable


class RigLink(VirtualLink):
    """The line to a rig's board."""

    def __init__(self, rig: FaultyRig) -> None:
        self._rig = rig
        self.step_s = rig.step_s

    def receive(self, data: bytes) -> None:
        self._rig.board.receive(data)

    def advance(self) -> Iterator[bytes]:
        self._rig.run()
        while said := self._rig.board.transmit():
            yield said


class SimulatedTechnician:
    """Reads the rig's meters with their errors, pulls its lines, touches it, and mends what is named.

    Without an oscilloscope amplifiers' outputs are not read.
    """

    def __init__(self, rig: FaultyRig, seed: int, *, has_scope: bool = True) -> None:
        self.rig, self.has_scope = rig, has_scope
        self.link = RigLink(rig)
        self._random = np.random.default_rng((seed, 11))

    def new_link(self) -> RigLink:
        """Return the board's line, as after the cable was plugged in."""
        self.link = RigLink(self.rig)
        return self.link

    async def read_supply(self, place: int) -> float:
        """Return VDDA (0), the plus (1) or the minus rail (2) in V."""
        return self._read(self.rig.supply_v(place), METER_FRAC)

    async def read_idle(self, sensor: int) -> float:
        """Return the DC at a sensor's ADC pin in V."""
        return self._read(self.rig.idle_v(sensor), METER_FRAC)

    async def read_output(self, amplifier: int, asked_v: float) -> float | None:
        """Return the peak of an amplifier's output, negative if against the DAC's pin; None without an oscilloscope."""
        return self._read(asked_v * self.rig.output_share(amplifier), SCOPE_FRAC) if self.has_scope else None

    async def touch(
        self, marks_mm: Sequence[tuple[float, float]]
    ) -> tuple[dict[str, object], list[tuple[float, float]]]:
        """Return what to write of the trackpad, nothing, and what it reports for a finger on each mark."""
        degrees, is_mirrored = self.rig.pad_turn()
        turn = np.deg2rad(degrees)
        matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        if is_mirrored:
            matrix = matrix @ np.diag((-1.0, 1.0))
        trembling = np.asarray(marks_mm) + self._random.normal(0.0, TREMBLE_MM, (len(marks_mm), 2))
        return {}, [(float(x_mm), float(y_mm)) for x_mm, y_mm in trembling @ matrix.T]

    async def pull_cable(self) -> None:
        self.link.pull()

    async def plug_cable(self) -> None:
        """Plug the cable in, after a while: the next conversation opens a new line."""
        for _ in range(round(AWAY_S / self.rig.step_s)):
            self.rig.run()

    async def push_stop(self, pushed: bool) -> None:
        self.rig.push_stop(pushed)

    async def touch_plate(self, touched: bool) -> None:
        self.rig.is_touched = touched

    async def mend(self, findings: Sequence[Diagnosis]) -> bool:
        """Look where the verdict points; return whether something was wrong there, and is mended."""
        return sum(self.rig.mend(finding.causes, finding.wires) for finding in findings) > 0

    def _read(self, value: float, error_frac: float) -> float:
        return value * (1.0 + float(self._random.normal(0.0, error_frac)))
