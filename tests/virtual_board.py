"""A board at the other end of a link, in virtual time: the loop's clock jumps to whatever is due next."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterator
from typing import Any, TypeVar

import numpy as np

from hapticd.sim.board.board import Board, BoardConfig, BoardTrace, PlateModel
from hapticd.sim.board.virtual_link import VirtualLink
from hapticd.sim.plate.ground_truth import GroundTruth
from hapticd.sim.virtual_time import VirtualTimeLoop
from hapticd.sim.world import World

STEP_TICKS = 4  # 2 ms
_Result = TypeVar("_Result")


def in_virtual_time(what: Coroutine[Any, Any, _Result]) -> _Result:
    """Run a coroutine to its end."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(what)


class BoardLink(VirtualLink):
    """The line to the firmware's C."""

    def __init__(self, *, mute: bool = False, refuses: str = "", config: BoardConfig | None = None) -> None:
        config = BoardConfig() if config is None else config
        gain = np.diag(config.gain_um_per_v_s)
        model = PlateModel(
            np.array(config.decay_1_s), np.array(config.detuning_rad_s), gain, np.eye(len(gain)), 0.0, config.v_limit_v
        )
        self.board = Board(model, config=config, boot_id=7)
        self.mute, self.refuses = mute, refuses
        self.peak_v = 0.0
        self.voltage_v = np.zeros(len(gain), dtype=np.complex128)
        self.says: Callable[[bytes], bytes] = lambda data: data

    def start(
        self,
        loop: asyncio.AbstractEventLoop,
        on_bytes: Callable[[bytes], None],
        on_link: Callable[[bool, str], None],
    ) -> None:
        super().start(loop, on_bytes, lambda up, reason: on_link(up and not self.refuses, reason or self.refuses))

    def receive(self, data: bytes) -> None:
        self.board.receive(data)

    def advance(self) -> Iterator[bytes]:
        modes = len(self.voltage_v)
        trace = BoardTrace(STEP_TICKS, modes, modes)
        self.board.run(STEP_TICKS, np.zeros((STEP_TICKS, 0, modes)), np.zeros((STEP_TICKS, 0)), trace)
        self.voltage_v = trace.voltage_v[-1]
        self.peak_v = max(self.peak_v, float(np.abs(trace.voltage_v).max()))
        while (said := self.board.transmit()) and not self.mute:
            yield self.says(said)


class PlateLink(VirtualLink):
    """The same before the simulated plate's whole truth: neighbouring modes, crosstalk, noise."""

    def __init__(self, plate: GroundTruth) -> None:
        self.world = World((), plate, w_limit_um=plate.w_limit_um, seed=1, boot_id=7, keep=False)

    def receive(self, data: bytes) -> None:
        self.world.receive(data, self.world.t_s)

    def advance(self) -> Iterator[bytes]:
        t_end_s = self.world.t_s + self.step_s
        while said := self.world.advance(t_end_s):
            yield said
