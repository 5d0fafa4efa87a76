"""Columns of the demo's comparison: a scheme on a plate each, all on the same fingers; `LIVE` runs in real time, the
others in virtual time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from ...sim import lockstep
from ...sim.fingers.scenarios import REAL
from ...sim.plate.glasses import FINGERTIP, WIDE
from ...sim.plate.ground_truth import PlateSettings
from ...sim.settings import Settings, paper_settings
from ..progress import progress_bar
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
        """Name of the scheme, the plate, and its number of modes."""
        scheme = "the paper's scheme" if self.scheme == PAPER else self.scheme
        return f"{scheme}, {self.plate.plate} plate, {self.plate.driven_modes} modes"


LIVE = DemoColumn(HAPTICD, PlateSettings.of(FINGERTIP))
COLUMNS = (DemoColumn(PAPER, PlateSettings()), LIVE, DemoColumn(HAPTICD, PlateSettings.of(WIDE)))


def virtual_film(column: DemoColumn, scenario: str, seed: int, start_s: float, end_s: float) -> Film:
    """Play a column in virtual time, and return a window of it."""
    settings = Settings(plate=column.plate, motion=MOTION)
    if column.scheme == PAPER:
        settings = paper_settings(settings)
    with progress_bar(f"comparing with {column.title}") as progress:
        run = lockstep.run(scenario, settings=settings, seed=seed, seconds=end_s, progress=progress)
    return Film.between(column.title, column.plate, partial(getattr, run), start_s, end_s)
