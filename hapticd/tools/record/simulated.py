"""A lock-step run with its recording: the machine's records, and the plate's ground truth at each control tick."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ...core.plate.mode_shapes import ModeShapes
from ...daemon.machine import Machine
from ...daemon.observer import Observer
from ...daemon.recorder import header_of
from ...files.recording.kinds import Fields, amplitudes
from ...files.recording.mcap_writer import DirectRecording
from ...sim import lockstep
from ...sim.fingers.scenarios import Scenario
from ...sim.fingers.scripted import virtual_name
from ...sim.lockstep import T_START_NS, Run
from ...sim.settings import Settings

UTC = "1970-01-01T00:00:00Z"  # virtual time has no date, and the same run gives the same bytes


def run(
    scenario: str | Scenario,
    path: Path,
    *,
    settings: Settings,
    seed: int,
    seconds: float | None,
    progress: Callable[[float], None] = lambda _: None,
) -> Run:
    """`lockstep.run`, recorded to `path`. Raises RecordingError, SimulationError."""
    recording: list[DirectRecording] = []

    def observer(machine: Machine, _: ModeShapes) -> Observer:
        header = header_of(machine, t_ns=T_START_NS, utc=UTC, is_whole=True)
        recording.append(DirectRecording(path, header))
        return recording[0].put

    played = lockstep.run(scenario, settings=settings, seed=seed, seconds=seconds, observer=observer, progress=progress)
    _put_truth(recording[0], played)
    recording[0].close(T_START_NS + round(played.t_s[-1] * 1e9), "the scenario ended")
    return played


def _put_truth(recording: DirectRecording, played: Run) -> None:
    """The fingers' places, their targets, and their amplitudes on the plate."""
    for index, t_ns in enumerate((T_START_NS + np.round(played.t_s * 1e9)).astype(np.int64).tolist()):
        fingers = []
        for actor, (x_mm, y_mm) in enumerate(played.finger_true_mm[index].tolist()):
            if x_mm != x_mm:  # absent
                continue
            got_um, target_um = complex(played.truth_um[index, actor]), float(played.target_um[index, actor])
            finger: Fields = {"path": actor + 1, "x_mm": x_mm, "y_mm": y_mm}
            finger |= {"plate_d_um": got_um.real, "plate_q_um": got_um.imag} | _named(played, index, actor)
            fingers.append(finger if target_um != target_um else finger | {"target_um": target_um})
        recording.put("truth", t_ns, fingers, amplitudes(played.modal_um[index].tolist()))


def _named(played: Run, index: int, actor: int) -> Fields:
    """The finger's id, or its name if it is virtual; empty while the daemon does not have it."""
    if played.is_virtual[actor]:
        return {"virtual": virtual_name(actor)}
    finger_id = int(played.finger_id[index, actor])
    return {"finger_id": finger_id} if finger_id else {}
