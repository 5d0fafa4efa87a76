"""What a step works with: the board's line, the person at the bench, and what earlier steps found."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from ...board_protocol import ClearFault, ControllerRequest
from ...board_values import BoardController, BoardStatus
from ...config.sections import SimConfig
from ...design.commissioning.findings import Diagnosis, Judgement, PlateDesign
from ...design.wiring import AmplifierSweep, MeasuredWiring
from ..calibrate.verdict import FoundSettings, Outcome, Verdict
from ..firmware.conversation import Conversation, Link


class Person(Protocol):
    """A person at the bench, or a simulated one. A reading is None where it was not taken."""

    async def read_supply(self, place: int) -> float | None: ...

    async def read_idle(self, sensor: int) -> float | None: ...

    async def read_output(self, amplifier: int, asked_v: float) -> float | None: ...

    async def pull_cable(self) -> None: ...

    async def plug_cable(self) -> None: ...

    async def push_stop(self, pushed: bool) -> None: ...

    async def touch_plate(self, touched: bool) -> None: ...

    async def touch(
        self, marks_mm: Sequence[tuple[float, float]]
    ) -> tuple[dict[str, object], list[tuple[float, float]]]: ...

    async def mend(self, findings: Sequence[Diagnosis]) -> bool: ...


@dataclass(slots=True)
class Bench:
    """A rig under commissioning. `outputs_v` are the amplifiers' outputs as they were read at `ASKED_V`, `sweeps` and
    `found` the last sweeps and their fit, until something is mended; a stop has `press_s` to be pressed, a finger
    `touch_s` to land and rest."""

    person: Person
    new_link: Callable[[], Link]
    where: str
    out: Path
    is_simulated: bool
    outputs_v: tuple[float | None, ...] = ()
    device: dict[str, str | int] = field(default_factory=dict)
    sweeps: list[AmplifierSweep] | None = None
    found: MeasuredWiring | None = None
    press_s: float = 1.0
    touch_s: float = 0.5
    plate: SimConfig = field(default_factory=SimConfig)
    scan: Path | None = None
    size: str | None = None

    def forget(self) -> None:
        """Discard what was swept: a wire was touched since."""
        self.sweeps = self.found = None

    def verdict(self, step: str, outcome: Outcome, judgement: Judgement, settings: FoundSettings) -> Verdict:
        """Return a step's result as `hapticd calibrate` keeps it, with the same names: its settings are merged."""
        return Verdict(step, outcome, judgement.sentence, (), settings, self.is_simulated)

    @asynccontextmanager
    async def board(self) -> AsyncIterator[Conversation]:
        """Context of a conversation with the board, whose fault is cleared: a step begins with a quiet plate."""
        async with Conversation(self.new_link(), self.where) as board:
            await board.ask(ClearFault(), BoardStatus)
            yield board


async def design_of(board: Conversation) -> PlateDesign:
    """Return what the board's firmware expects of its plate."""
    return PlateDesign.of(board.hello, await board.ask(ControllerRequest(), BoardController))
