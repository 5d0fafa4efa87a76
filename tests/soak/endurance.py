"""Endurance of the firmware: random plates, fingers and references in virtual time.

Runs of 30 s, numbered from 0, each with a new board and a plate within its tolerances. In one of six the modes are up
to 300 Hz from the drive. Run N is always the same: `play(N)` or `play(N, far=True)` repeats it. A board that faults,
leaves LIVE or passes a limit is a failure.

Not covered: the daemon (`tests/faults`), broken wires and sensors (`hapticd bench firmware`), and fault 10, which takes
100 s at the voltage limit.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from firmware_faults import fault
from soak.harness import Findings, judged
from soak.worlds import DAMPING, DRIFT_HZ, RUN_S, W_LIMIT_UM, Knots, World, draw

from hapticd.bench.tables import Table
from hapticd.board_protocol import FAULTS
from hapticd.design.campaign import TaskRunner, one_by_one
from hapticd.sim.board.board import FLAG_LIVE, Board, BoardTrace
from hapticd.sim.board.closed_loop import follow

FAR_SHARE = 1.0 / 6.0  # of the runs
V_ROUNDING, W_ROUNDING = 1e-6, 2e-6  # of the limits, by float32; the limiter lets references pass up to 1e-6 above
LIVE_AFTER_S = 0.02


class Run(NamedTuple):
    """A task of a campaign."""

    seed: int
    far: bool


def run(hours: float = 1.0, campaign: TaskRunner = one_by_one) -> Table:
    """Play runs 0, 1, ... for so many virtual hours. Raises HapticdError with the failures if there are any."""
    runs = max(1, round(hours * 3600.0 / RUN_S))
    far_runs = round(runs * FAR_SHARE)
    counts = ((False, runs - far_runs), (True, far_runs))
    tasks = [Run(seed, far) for far, count in counts for seed in range(count)]
    return judged(
        campaign("endurance", played, tasks),
        name="endurance",
        title="firmware on random plates, with fingers and textures, by modes, wiring and control rate",
        notes=(f"damping x{DAMPING[0]:g} to x{DAMPING[1]:g}, drift within {DRIFT_HZ:g} Hz; a fault ends its run",),
    )


def played(run: Run) -> Findings:
    """Play one run of a campaign."""
    return play(run.seed, far=run.far)


def play(seed: int, seconds: float = RUN_S, *, far: bool = False) -> Findings:
    """Return what this run finds, by the kind of its world."""
    return judge(draw(seed, seconds, far=far), seed)


def judge(world: World, seed: int) -> Findings:
    """Drive the world's board through its run and check every tick."""
    board = Board(world.plate, config=world.config, seed=seed)

    def knots(t_s: float) -> Knots:
        board.detune(world.detuning_at(t_s))
        return world.knots_at(t_s)

    ticks, control_hz = len(world.touch[0]), world.config.control_hz
    trace = follow(board, knots, ticks, round(world.frame_s * control_hz), world.touch)
    code = fault(board)
    figures = {
        "virtual_h": ticks / control_hz / 3600.0,
        "runs_count": 1.0,
        "faults_count": float(code > 0),
        "peak_voltage_frac": float(np.abs(trace.voltage_v).max()) / world.config.v_limit_v,
        "peak_reference_frac": float(np.abs(trace.reference_um).max()) / W_LIMIT_UM,
        "peak_measured_um": float(np.abs(trace.measured_um).max()),
    }
    violations = _violations(figures, trace, code, control_hz)
    return Findings({world.kind: figures}, [f"run {seed} ({world.kind}): {what}" for what in violations])


def _violations(figures: dict[str, float], trace: BoardTrace, code: int, control_hz: float) -> Iterator[str]:
    rested = np.flatnonzero(trace.flags & FLAG_LIVE == 0)
    rested = rested[rested >= LIVE_AFTER_S * control_hz]
    t_end_s = (rested[0] if len(rested) else len(trace)) / control_hz
    if code:
        yield f"fault {code} after {t_end_s:.3f} s, {FAULTS.get(code, 'of unknown code')}."
    elif len(rested):
        yield f"the board left LIVE after {t_end_s:.3f} s, without a fault."
    limits = {"voltage": V_ROUNDING, "reference": W_ROUNDING}
    for what, rounding in limits.items():
        peak_frac = figures[f"peak_{what}_frac"]
        if not peak_frac <= 1.0 + rounding:  # True for NaN
            yield f"a {what} was {peak_frac:.7f} of its limit."
    if not (np.isfinite(trace.measured_um).all() and np.isfinite(trace.plate_um).all()):
        yield "an amplitude was not finite."
