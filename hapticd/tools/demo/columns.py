"""Columns of the demo's comparison: a scheme on a plate each, all on the same fingers; one of them is the live one.

The others run in virtual time, each in a process of its own that computes its plate's mode shapes while the rig starts.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection

from ...config.sections import SimConfig
from ...errors import HapticdError
from ...sim import lockstep
from ...sim.fingers.scenarios import REAL
from ...sim.plate.glasses import FINGERTIP, REFERENCE, WIDE
from ...sim.plate.ground_truth import GroundTruth, PlateSettings
from ...sim.plate.wirings import IDENTITY
from ...sim.plate.wirings import PAPER as SHARED
from ...sim.settings import Settings, paper_settings
from ..progress import Progress
from ..simulated_picture import Film

PAPER, HAPTICD = "the paper", "hapticd"
MOTION = REAL
PROGRESS_FRAC = 0.02  # of a run, between two messages of its process


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


class VirtualRun:
    """A column's process: it plays the scenario up to an instant that is known later."""

    def __init__(self, column: DemoColumn, scenario: str, seed: int) -> None:
        spawning = get_context("spawn")
        self._column = column
        self._pipe, theirs = spawning.Pipe()
        process = spawning.Process(target=_serve, args=(theirs, column, scenario, seed), daemon=True)
        with _no_interrupt():
            process.start()
        theirs.close()  # so that the end of either process is seen by the other

    def play(self, start_s: float, end_s: float) -> None:
        """Start the run; its film is of this window."""
        self._pipe.send((start_s, end_s))

    def film(self) -> Film:
        """Return what was played. Raises HapticdError if the process has ended."""
        with Progress(f"comparing with {self._column.title}") as progress:
            while True:
                try:
                    received: Film | float = self._pipe.recv()
                except (EOFError, ConnectionError):  # reset: it ended before it read what to play
                    sentence = f"The comparison with {self._column.title} ended: see its message above."
                    raise HapticdError(sentence) from None
                if isinstance(received, Film):
                    return received
                progress(received)


def _serve(pipe: Connection, column: DemoColumn, scenario: str, seed: int) -> None:
    plate = GroundTruth(column.plate)
    plate.measured_mode_map(seed)  # computed now and kept
    try:
        start_s, end_s = pipe.recv()
    except EOFError:  # the demo has ended
        return
    settings = Settings(plate=column.plate, motion=MOTION)
    if column.scheme == PAPER:
        settings = paper_settings(settings)
    shown_frac = 0.0

    def progress(done_frac: float) -> None:
        nonlocal shown_frac
        if done_frac >= shown_frac + PROGRESS_FRAC:
            shown_frac = done_frac
            pipe.send(done_frac)

    run = lockstep.run(scenario, settings=settings, seed=seed, seconds=end_s, progress=progress)
    pipe.send(Film.of(run, column.title).between(start_s, end_s))


@contextmanager
def _no_interrupt() -> Iterator[None]:
    """Context whose child processes get no Ctrl-C: the demo ends them."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
