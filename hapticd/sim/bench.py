"""A bare simulated rig in the event loop's time: its board, meters, cable and stop, and a finger on its plate.

Nothing is wrong with it; tests make it so. Its board and plate are those of the simulated service.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from ..design.commissioning.findings import Diagnosis
from ..design.commissioning.rest import EMERGENCY_STOP
from .board.board import Board, BoardTrace
from .board.virtual_link import VirtualLink
from .plate.ground_truth import GroundTruth, PlateSettings
from .world import board_config, plate_model

STEP_TICKS = 4
SUPPLIES_V = (3.3, 24.0, -24.0)
FINGER_SHARE = 1.0  # of an antinode's square, under the finger
AWAY_S = 0.5  # of a pulled cable


class RigLink(VirtualLink):
    """The line to a rig's board."""

    def __init__(self, rig: SimulatedBench) -> None:
        self._rig = rig
        self.step_s = rig.step_s

    def receive(self, data: bytes) -> None:
        self._rig.board.receive(data)

    def advance(self) -> Iterator[bytes]:
        self._rig.run()
        while said := self._rig.board.transmit():
            yield said


class SimulatedBench:
    """A rig, and the person at its bench, as `hapticd calibrate` asks one. Time passes with `run`."""

    def __init__(self, settings: PlateSettings, seed: int = 1) -> None:
        self.plate = GroundTruth(settings)
        self.modes, self.plate_modes = len(self.plate.w_limit_um), len(self.plate.decay_1_s)
        self.is_stop_pushed = self.is_touched = False
        self._seed, self._boots = seed, 0
        self._trace = BoardTrace(STEP_TICKS, self.modes, self.plate_modes)
        self._phi = np.full((STEP_TICKS, 1, self.plate_modes), math.sqrt(FINGER_SHARE))
        self._decay_1_s = np.zeros((STEP_TICKS, 1))
        self.boot()

    def boot(self) -> None:
        """Switch the board off and on."""
        self._boots += 1
        self.board = self.new_board(self._boots)
        self.board.interlock(self.interlock())

    def new_board(self, boot_id: int) -> Board:
        config = board_config(self.plate, self.plate.w_limit_um)
        return Board(plate_model(self.plate), config=config, seed=self._seed, boot_id=boot_id)

    def interlock(self) -> int:
        """Return the event of an open circuit, 0 if all are closed."""
        return EMERGENCY_STOP if self.is_stop_pushed else 0

    def run(self) -> BoardTrace:
        """Let STEP_TICKS control ticks pass."""
        self._decay_1_s[:] = self.plate.finger_decay_1_s if self.is_touched else 0.0
        self.board.run(STEP_TICKS, self._phi, self._decay_1_s, self._trace)
        return self._trace

    @property
    def step_s(self) -> float:
        return STEP_TICKS / self.board.config.control_hz

    def new_link(self) -> RigLink:
        """Return the board's line, as after the cable was plugged in."""
        self.link = RigLink(self)
        return self.link

    async def read_supply(self, place: int) -> float | None:
        """Return VDDA (0), the plus (1) or the minus rail (2) in V."""
        return SUPPLIES_V[place]

    async def read_idle(self, sensor: int) -> float | None:
        """Return the DC at a sensor's ADC pin in V."""
        del sensor
        return SUPPLIES_V[0] / 2.0

    async def read_output(self, amplifier: int, asked_v: float) -> float | None:
        """Return the peak of an amplifier's output, negative if against the DAC's pin."""
        del amplifier
        return asked_v

    async def pull_cable(self) -> None:
        self.link.pull()

    async def plug_cable(self) -> None:
        """Plug the cable in, after a while: the next conversation opens a new line."""
        for _ in range(round(AWAY_S / self.step_s)):
            self.run()

    async def push_stop(self, pushed: bool) -> None:
        self.is_stop_pushed = pushed
        self.board.interlock(self.interlock())

    async def touch_plate(self, touched: bool) -> None:
        self.is_touched = touched

    def mend(self, findings: Sequence[Diagnosis]) -> bool:
        """Return whether something was wrong where the findings point, and is mended."""
        del findings
        return False
