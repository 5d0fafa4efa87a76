"""The service's self-calibration in virtual time: its process's part is done between two events of a simulation.

What is fed, judged and adopted is the service's. A fit takes no time of the simulation, but counts as a usual one does:
the next waits until all took their share of it.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from faulty_simulation import FaultySimulation

from hapticd.daemon.machine import Machine
from hapticd.daemon.observer import Observer
from hapticd.daemon.recorder import header_of
from hapticd.daemon.self_calibration import KINDS, SelfCalibration
from hapticd.files.recording.kinds import record_of
from hapticd.sim.fingers.paths import Touch, Touches
from hapticd.sim.fingers.scenarios import SCENARIOS, Actor
from hapticd.sim.lockstep import T_START_NS
from hapticd.sim.settings import Measured, Settings
from hapticd.tools.touch_process import DUTY, Accumulator

FIT_FRAC = 0.2  # of the touching that is fitted, of the processor's time: on four modes
EVIDENCE_S = 0.5  # of the processor's time


def lifting(settings: Settings, until_s: float) -> tuple[Actor, ...]:
    """Return strokes whose fingers are lifted every ten seconds."""
    starts_s = np.arange(0.3, until_s, 10.0).tolist()
    return tuple(
        replace(actor, path=Touches(tuple(Touch(actor.path, t_s, t_s + 9.7) for t_s in starts_s)))
        for actor in SCENARIOS["strokes"].build(1, settings.speed_mm_s)
        if actor.path is not None
    )


class InStep:
    """The self-calibration of one machine. `also` observes the machine too."""

    def __init__(self, machine: Machine, t_ns: int, also: Observer | None = None) -> None:
        self.machine = machine
        self.task = SelfCalibration(machine.config, machine.modes, machine.parasitic_modes)
        self.verdicts: list[dict[str, Any]] = []
        self.t_stepped_ns: list[int] = []
        self._t_begin_ns = t_ns
        self._spent_s = 0.0
        self._accumulator = Accumulator(header_of(machine, t_ns=t_ns, utc="", is_whole=True))
        self._also = also
        machine.observer, machine.observer_perceives = self._observe, also is not None

    def _observe(self, kind: str, t_ns: int, *values: Any) -> None:
        if self._also is not None:
            self._also(kind, t_ns, *values)
        if kind in KINDS:
            self._accumulator.take(record_of(kind, 0, t_ns, values))

    def look(self, t_ns: int) -> None:
        """Fit if there is enough, and take the step that is due."""
        if self._accumulator.is_enough:
            self._judge(is_time=self._spent_s <= DUTY * 1e-9 * (t_ns - self._t_begin_ns))
        if self.task.step(self.machine, t_ns):
            self.t_stepped_ns.append(t_ns)

    def _judge(self, *, is_time: bool) -> None:
        if not (is_time or self._accumulator.is_full):
            return
        verdict = self._accumulator.verdict() if is_time else self._accumulator.evidence()
        self._spent_s += FIT_FRAC * (verdict or {}).get("touched_s", 0.0) if is_time else EVIDENCE_S
        if verdict is not None:
            self.verdicts.append(verdict)
            self.task.take_verdict(json.dumps(verdict).encode())


class CalibratingSimulation(FaultySimulation):
    """A lock-step run, with faults or without, whose daemon calibrates itself. A new one has learned nothing."""

    def __init__(
        self,
        actors: tuple[Actor, ...],
        settings: Settings,
        seed: int,
        measured: Measured | None = None,
        observer: Callable[[Machine], Observer] | None = None,
    ) -> None:
        super().__init__(actors, settings, seed, measured)
        self._make_observer = observer
        self.calibrations: list[InStep] = []
        self._begin(T_START_NS)

    def _begin(self, t_ns: int) -> None:
        also = None if self._make_observer is None else self._make_observer(self.machine)
        self.calibrations.append(InStep(self.machine, t_ns, also))

    def _handle(self, kind: str, data: bytes, t_ns: int) -> None:
        if self.calibrations[-1].machine is not self.machine:
            self._begin(t_ns)
        super()._handle(kind, data, t_ns)
        if self.daemon_runs:
            self.calibrations[-1].look(self.t_ns)
