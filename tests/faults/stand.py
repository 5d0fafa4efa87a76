"""A plate in use, to which things happen: when it is quiet, when it is driven again, by its own truth and no report."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from faulty_simulation import FaultySimulation, LineFault

from hapticd.sim.fingers.scenarios import SCENARIOS, Actor
from hapticd.sim.lockstep import T_START_NS, Run
from hapticd.sim.settings import Settings

README = (Path(__file__).parents[2] / "hapticd" / "daemon" / "README.md").read_text(encoding="utf-8")

QUIET_UM = 0.01  # of the largest mode: a hundredth of what a slippery finger asks for
DRIVEN_UM = 0.3
W_LIM_UM = 4.0
OVERSHOOT = 1.1  # of the plate beyond its reference, when that steps
PHASES_S = (0.0, 0.0031, 0.0064, 0.0095)  # of the fault in the period of reports: the worst of them counts
T_FAULT_S = 1.5

DEADMAN_MS, RAMP_MS, LINK_MS = 50.0, 10.0, 5.0
RING_DOWN_MS = 35.0  # undriven from 4 to 0.01 um: six time constants of 5.45 ms
LED_DOWN_MS = 12.0  # with the control loop's help
HANDSHAKE_MS = 150.0  # greeting, four looks at its clock 20 ms apart, three zero frames, and the next report
PERIOD_MS = 11.25  # of reports
SILENCE_MS = 40.0  # of the trackpad, after which fingers count as lifted
TIMER_MS = 10.0
SILENT_MS = DEADMAN_MS + RAMP_MS + LED_DOWN_MS  # from the last frame that the board takes

SetUp = Callable[[FaultySimulation, float, float], None]  # called with the instants of the fault and of its end
Action = Callable[[FaultySimulation, int], None]


@dataclass(frozen=True)
class Aftermath:
    """Since the fault came the plate moved for `quiet_ms`, infinite: until the fault was over; `back_ms` after that it
    was driven again, infinite: never."""

    quiet_ms: float
    back_ms: float
    simulation: FaultySimulation

    @property
    def board(self) -> dict[str, Any]:
        status: Any = self.simulation.machine.report_status(self.simulation.t_ns)
        return dict(status["board"])

    def run(self) -> Run:
        return self.simulation.result("circles")


def simulate(set_up: SetUp, t_fault_s: float, t_over_s: float, after_s: float) -> Aftermath:
    """One run, from the start to `after_s` beyond the end of the fault."""
    return play(SCENARIOS["circles"].build(1, 100.0), set_up, t_fault_s, t_over_s, after_s)


def play(actors: tuple[Actor, ...], set_up: SetUp, t_fault_s: float, t_over_s: float, after_s: float) -> Aftermath:
    simulation = FaultySimulation(actors, Settings(), 1)
    set_up(simulation, t_fault_s, t_over_s)
    simulation.run(t_over_s + after_s)
    t_s, level_um = simulation.level_um()
    assert level_um.max() <= OVERSHOOT * W_LIM_UM
    moving = t_s[(t_s > t_fault_s) & (t_s < t_over_s) & (level_um > QUIET_UM)]
    driven = t_s[(t_s >= t_over_s) & (level_um > DRIVEN_UM)]
    quiet_ms = (moving[-1] - t_fault_s) * 1e3 if len(moving) else 0.0
    return Aftermath(
        math.inf if t_over_s - t_fault_s - quiet_ms * 1e-3 < 1.5e-3 else quiet_ms,
        (driven[0] - t_over_s) * 1e3 if len(driven) else math.inf,
        simulation,
    )


def worst(set_up: SetUp, lasts_s: float, *, after_s: float = 0.6, t_fault_s: float = T_FAULT_S) -> Aftermath:
    """The same fault at several phases of the report period: the longest times of all, and the last run."""
    runs = [simulate(set_up, t_fault_s + phase_s, t_fault_s + phase_s + lasts_s, after_s) for phase_s in PHASES_S]
    return Aftermath(max(run.quiet_ms for run in runs), max(run.back_ms for run in runs), runs[-1].simulation)


def cut(t_from_s: float, t_until_s: float) -> LineFault:
    """Nothing passes in between."""

    def fault(t_ns: int, data: bytes) -> list[tuple[int, bytes]]:
        return [] if t_from_s <= seconds(t_ns) < t_until_s else [(t_ns, data)]

    return fault


def passing(fault: Callable[[float, float], LineFault], *kinds: str) -> SetUp:
    """Events of these kinds suffer the fault that is made of the instants of the fault and of its end."""

    def set_up(simulation: FaultySimulation, t_fault_s: float, t_over_s: float) -> None:
        for kind in kinds:
            simulation.line_faults[kind] = fault(t_fault_s, t_over_s)

    return set_up


def doing(at_fault: Action, at_end: Action | None = None) -> SetUp:
    """Methods of the simulation that are called when the fault comes and when it is over."""

    def set_up(simulation: FaultySimulation, t_fault_s: float, t_over_s: float) -> None:
        simulation.at(t_fault_s, partial(at_fault, simulation))
        if at_end is not None:
            simulation.at(t_over_s, partial(at_end, simulation))

    return set_up


def seconds(t_ns: int) -> float:
    """Of the run."""
    return (t_ns - T_START_NS) * 1e-9


def nanoseconds(t_s: float) -> int:
    """On the host's clock."""
    return T_START_NS + round(t_s * 1e9)


def rms_um(run: Run, finger: int, t_from_s: float, t_until_s: float) -> float:
    """What a finger got meanwhile, at its true place."""
    part = (run.t_s > t_from_s) & (run.t_s < t_until_s)
    return float(np.sqrt(np.nanmean(np.abs(run.truth_um[part, finger]) ** 2)))


def lines(caplog: pytest.LogCaptureFixture) -> list[str]:
    """What the journal held, each line once, without the three of every start."""
    said = dict.fromkeys(f"{record.levelname} {record.getMessage()}" for record in caplog.records)
    return [line for line in said if not line.endswith((": simulated", "boot 00000002, 2 modes"))]


def agrees(fault: str, aftermath: Aftermath) -> None:
    """The times are those of the fault's row in the daemon's README."""
    print(f"\n| {fault} | {aftermath.quiet_ms:.0f} ms | {aftermath.back_ms:.0f} ms |", end="")
    (stated,) = [line.split(" | ") for line in README.splitlines() if line.startswith(f"| {fault} | ")]
    for measured_ms, cell in zip((aftermath.quiet_ms, aftermath.back_ms), stated[1:3], strict=True):
        stated_ms = math.inf if cell == "never" else float(cell.removesuffix(" ms"))
        assert math.isclose(measured_ms, stated_ms, rel_tol=0.1, abs_tol=5.0), f"the README says {cell}"
