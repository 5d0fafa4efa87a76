"""Endurance of the firmware, `hapticd bench endurance`: random plates, fingers and references in virtual time.

Runs of 30 s, numbered from 0, each with a new board and a plate within its tolerances. In one of six the modes are up
to 300 Hz from the drive. Run N is always the same: `play(N)` or `play(N, far=True)` repeats it. A board that faults,
leaves LIVE or passes a limit is a failure.

Not covered: the daemon (`soak`), broken wires and sensors (`firmware`), and fault 10, which takes 100 s at the
voltage limit.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from ..errors import HapticdError
from ..sim.board.board import FLAG_LIVE, Board, BoardTrace
from ..wire.protocol import FAULTS
from .closed_loop import follow
from .endurance_worlds import DAMPING, DRIFT_HZ, RUN_S, W_LIMIT_UM, Knots, World, draw
from .firmware_faults import fault
from .tables import Table, finite_rows, render

MOST_HOURS = 1000.0
MOST_SENTENCES = 20
FAR_SHARE = 1.0 / 6.0  # of the runs
V_ROUNDING, W_ROUNDING = 1e-6, 2e-6  # of the limits, by float32; the limiter lets references pass up to 1e-6 above
LIVE_AFTER_S = 0.02


@dataclass
class Findings:
    """Figures of runs, and a sentence in `failures` for each violation."""

    runs: int = 0
    virtual_s: float = 0.0
    elapsed_s: float = 0.0
    faults: Counter[int] = field(default_factory=Counter)
    peak_voltage_frac: float = 0.0
    peak_reference_frac: float = 0.0
    peak_measured_um: float = 0.0
    failures: list[str] = field(default_factory=list)


def run(hours: float = 1.0) -> Table:
    """Play runs 0, 1, ... for so many virtual hours. Raises HapticdError with all failures if there are any."""
    if not 0.0 < hours <= MOST_HOURS:  # False for NaN
        raise HapticdError(f"--hours: {hours:g} is out of bounds, it must be above 0 and at most {MOST_HOURS:g}.")
    by_kind: dict[str, list[Findings]] = {}
    runs = max(1, round(hours * 3600.0 / RUN_S))
    far_runs = round(runs * FAR_SHARE)
    for far, count in ((False, runs - far_runs), (True, far_runs)):
        for seed in range(count):
            kind, found = play(seed, far=far)
            by_kind.setdefault(kind, []).append(found)
    made = {kind: total(found) for kind, found in by_kind.items()}
    made["all"] = total(made.values())
    table, failures = _table(made), made["all"].failures
    if failures:
        faults = dict(sorted(made["all"].faults.items()))
        title = f"endurance: {len(failures)} failures, faults by code {faults}; the first {MOST_SENTENCES}:"
        raise HapticdError("\n".join([title, *failures[:MOST_SENTENCES], render(table)]))
    return table


def play(seed: int, seconds: float = RUN_S, *, far: bool = False) -> tuple[str, Findings]:
    """Return the kind of this run's world, and what a run of it finds."""
    t_start_s = time.perf_counter()
    world = draw(seed, seconds, far=far)
    found = judge(world, seed)
    found.elapsed_s = time.perf_counter() - t_start_s
    return world.kind, found


def total(found: Iterable[Findings]) -> Findings:
    """Return the sums, and the largest of each peak."""
    every = list(found)
    return Findings(
        runs=sum(one.runs for one in every),
        virtual_s=sum(one.virtual_s for one in every),
        elapsed_s=sum(one.elapsed_s for one in every),
        faults=sum((one.faults for one in every), Counter()),
        peak_voltage_frac=max(one.peak_voltage_frac for one in every),
        peak_reference_frac=max(one.peak_reference_frac for one in every),
        peak_measured_um=max(one.peak_measured_um for one in every),
        failures=[sentence for one in every for sentence in one.failures],
    )


def judge(world: World, seed: int) -> Findings:
    """Drive the world's board through its run and check every tick."""
    board = Board(world.plate, config=world.config, seed=seed)

    def knots(t_s: float) -> Knots:
        board.detune(world.detuning_at(t_s))
        return world.knots_at(t_s)

    ticks, control_hz = len(world.touch[0]), world.config.control_hz
    trace = follow(board, knots, ticks, round(world.frame_s * control_hz), world.touch)
    code = fault(board)
    found = Findings(
        runs=1,
        virtual_s=ticks / control_hz,
        faults=Counter({code: 1} if code else {}),
        peak_voltage_frac=float(np.abs(trace.voltage_v).max()) / world.config.v_limit_v,
        peak_reference_frac=float(np.abs(trace.reference_um).max()) / W_LIMIT_UM,
        peak_measured_um=float(np.abs(trace.measured_um).max()),
    )
    found.failures += [f"run {seed} ({world.kind}): {what}" for what in _violations(found, trace, code, control_hz)]
    return found


def _violations(found: Findings, trace: BoardTrace, code: int, control_hz: float) -> Iterator[str]:
    rested = np.flatnonzero(trace.flags & FLAG_LIVE == 0)
    rested = rested[rested >= LIVE_AFTER_S * control_hz]
    t_end_s = (rested[0] if len(rested) else len(trace)) / control_hz
    if code:
        yield f"fault {code} after {t_end_s:.3f} s, {FAULTS.get(code, 'of unknown code')}."
    elif len(rested):
        yield f"the board left LIVE after {t_end_s:.3f} s, without a fault."
    if not found.peak_voltage_frac <= 1.0 + V_ROUNDING:  # True for NaN
        yield f"a voltage was {found.peak_voltage_frac:.7f} of its limit."
    if not found.peak_reference_frac <= 1.0 + W_ROUNDING:
        yield f"a reference was {found.peak_reference_frac:.7f} of its limit."
    if not (np.isfinite(trace.measured_um).all() and np.isfinite(trace.plate_um).all()):
        yield "an amplitude was not finite."


def _figures(found: Findings) -> dict[str, float]:
    return {
        "virtual_h": found.virtual_s / 3600.0,
        "runs_count": found.runs,
        "faults_count": found.faults.total(),
        "peak_voltage_frac": found.peak_voltage_frac,
        "peak_reference_frac": found.peak_reference_frac,
        "peak_measured_um": found.peak_measured_um,
        "real_time_ratio": found.virtual_s / found.elapsed_s,
    }


def _table(made: dict[str, Findings]) -> Table:
    return Table(
        name="endurance",
        title="endurance: firmware on random plates, with fingers and textures, by modes, wiring and control rate",
        default="all",
        rows=finite_rows([(kind, _figures(found)) for kind, found in made.items()]),
        compared=(),
        notes=(
            "peaks: largest of any amplifier and mode over its limit; real time: virtual time over the time it took",
            f"damping x{DAMPING[0]:g} to x{DAMPING[1]:g}, drift within {DRIFT_HZ:g} Hz either way; a fault ends the "
            "drive of its run",
        ),
    )
