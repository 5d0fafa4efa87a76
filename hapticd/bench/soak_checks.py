"""What a soak checks of a run, and what it found: limits, the effect of each fault, and the recovery from it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ..sim.faulty import FaultySimulation
from .soak_faults import KINDS, Kind, Watch

FloatArray = npt.NDArray[np.float64]

FIRST_FAULT_S, RECOVERY_S = 1.5, 0.9  # a board with a wrapped clock is detected after half a second
QUIET_UM, DRIVEN_UM = 0.01, 0.3


@dataclass
class Findings:
    """Figures of the soak so far, and a sentence in `failures` for each violation."""

    virtual_s: float = 0.0
    frames: int = 0
    peak_reference_um: float = 0.0
    peak_plate_um: float = 0.0
    peak_step_um: float = 0.0  # of a reference from one control tick to the next, far from faults
    peak_adopting_step_um: float = 0.0  # the same while something is adopted
    adopted: Counter[str] = field(default_factory=Counter)
    leaks_um: list[float] = field(default_factory=list)  # of the still finger far from faults, in each span
    faults: Counter[str] = field(default_factory=Counter)
    latest_quiet_ms: dict[str, float] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Fault:
    """One fault; instants in seconds of the run."""

    kind: Kind
    t_from_s: float
    t_until_s: float


def drawn(rng: np.random.Generator, t_from_s: float, t_until_s: float, pause_s: float = 0.0) -> Iterator[Fault]:
    """Draw faults one after another; each kind once per round, in random order."""
    t_s = t_from_s + FIRST_FAULT_S
    while True:
        for index in rng.permutation(len(KINDS)):
            kind = KINDS[index]
            start_s = t_s + float(rng.uniform(0.0, 0.05))
            end_s = start_s + float(rng.uniform(*kind.lasts_s))
            t_s = end_s + RECOVERY_S + pause_s
            if end_s + RECOVERY_S > t_until_s:
                return
            yield Fault(kind, start_s, end_s)


def check(
    findings: Findings,
    simulation: FaultySimulation,
    watch: Watch,
    faults: Sequence[Fault],
    level: tuple[FloatArray, FloatArray],
    where: str,
) -> None:
    """Note what references and plate reached, and each fault's effect; `level` has times and amplitudes (T,)."""
    t_s, level_um = level
    plate_um = float(level_um.max())
    findings.frames += watch.references.frames
    findings.peak_plate_um = max(findings.peak_plate_um, plate_um)
    findings.peak_reference_um = max(findings.peak_reference_um, watch.references.peak_um)
    w_limit_um = max(simulation.settings.config.limits.w_limit_um)
    for what, peak_um in (("a frame requested", watch.references.peak_um), ("the plate moved by", plate_um)):
        if peak_um > w_limit_um:
            findings.failures.append(f"{where}: {what} {peak_um:g} um, the limit is {w_limit_um:g}.")
    for fault in faults:
        _check_fault(findings, fault, t_s, level_um, simulation.settings.plate.world.link_jitter_ms, where)
    findings.failures += [f"{where}, {sentence}" for sentence in watch.undetected]


def check_rest(
    findings: Findings, simulation: FaultySimulation, level: tuple[FloatArray, FloatArray], rest_s: float, where: str
) -> None:
    """Check that nothing moves from `rest_s` on."""
    t_s, level_um = level
    if level_um[t_s > rest_s].max() > QUIET_UM or simulation.machine.pipeline.fingers:
        findings.failures.append(f"{where}: motion or fingers remain after both fingers were lifted.")


def _check_fault(
    findings: Findings, fault: Fault, t_s: FloatArray, level_um: FloatArray, jitter_ms: float, where: str
) -> None:
    """Check one fault; a link that jitters delivers the last frame that much later."""
    name, quiet_within_ms = fault.kind.name, fault.kind.quiet_within_ms
    findings.faults[name] += 1
    which = f"{where}, {name} from {fault.t_from_s:.3f} to {fault.t_until_s:.3f} s"
    if quiet_within_ms is not None:
        moving = t_s[(t_s > fault.t_from_s) & (t_s < fault.t_until_s) & (level_um > QUIET_UM)]
        quiet_ms = 1e3 * (float(moving[-1]) - fault.t_from_s) if len(moving) else 0.0
        findings.latest_quiet_ms[name] = max(findings.latest_quiet_ms.get(name, 0.0), quiet_ms)
        if quiet_ms > quiet_within_ms + jitter_ms:
            findings.failures.append(f"{which}: the plate still moved after {quiet_ms:.0f} ms.")
    end_s = fault.t_until_s + RECOVERY_S
    if level_um[(t_s > end_s - 0.25) & (t_s <= end_s)].max() < DRIVEN_UM:
        findings.failures.append(f"{which}: the fingers are not driven again.")
