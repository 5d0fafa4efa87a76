"""Columns of the demo's comparison: a scheme on a plate each, all on the same fingers; one of them is the live one, the
others run in virtual time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from ...config.sections import SimConfig
from ...sim import lockstep
from ...sim.fingers.scenarios import REAL
from ...sim.plate.glasses import FINGERTIP, REFERENCE, WIDE
from ...sim.plate.ground_truth import PlateSettings
from ...sim.plate.wirings import IDENTITY
from ...sim.plate.wirings import PAPER as SHARED
from ...sim.settings import Settings, paper_settings
from ..progress import Progress
from .film import Film

PAPER, HAPTICD = "the paper", "hapticd"
MOTION = REAL


@dataclass(frozen=True, slots=True)
class DemoColumn:
    """A scheme on a plate."""

    scheme: str
    plate: PlateSettings

    @property
    def title(self) -> str:
        """Name of the scheme, the plate, its number of modes, and its wiring where that is shared or wrong."""
        scheme = "the paper's scheme" if self.scheme == PAPER else self.scheme
        wires = "" if self.wires == IDENTITY else f", {self.wires} wires"
        return f"{scheme}, {self.plate.plate} plate, {self.plate.driven_modes} modes{wires}"

    @property
    def wires(self) -> str:
        """How amplifiers and sensors belong to the modes."""
        return "the paper's" if self.plate.wiring == SHARED else self.plate.wiring


def live_column(sim: SimConfig) -> DemoColumn:
    """Return hapticd on the chosen plate."""
    return DemoColumn(HAPTICD, PlateSettings.of(sim.plate, sim.modes or None, sim.wiring))


def columns(live: DemoColumn) -> list[DemoColumn]:
    """Return the paper's scheme on its plate, and hapticd on four and eight modes, `live` in the place of its plate.

    On the paper's wires the paper's scheme runs too; wrong ones are the live column's alone.
    """
    wires = live.plate.wiring if live.plate.wiring == SHARED and live.plate.plate == REFERENCE else IDENTITY
    paper = DemoColumn(PAPER, PlateSettings.of(REFERENCE, None, wires))
    ours = [DemoColumn(HAPTICD, PlateSettings.of(name, None, IDENTITY)) for name in (FINGERTIP, WIDE)]
    if all(column.plate.plate != live.plate.plate for column in ours):
        return [paper, live, ours[-1]]
    return [paper, *[live if column.plate.plate == live.plate.plate else column for column in ours]]


def virtual_film(column: DemoColumn, scenario: str, seed: int, start_s: float, end_s: float) -> Film:
    """Play a column in virtual time, and return a window of it."""
    settings = Settings(plate=column.plate, motion=MOTION)
    if column.scheme == PAPER:
        settings = paper_settings(settings)
    with Progress(f"comparing with {column.title}") as progress:
        run = lockstep.run(scenario, settings=settings, seed=seed, seconds=end_s, progress=progress)
    return Film.between(column.title, column.plate, partial(getattr, run), start_s, end_s)
