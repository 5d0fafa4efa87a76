"""A lock-step run with its recording: all that the machine heard and did, and beside it the plate's own truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...core.plate.mode_shapes import ModeShapes
from ...daemon.machine import Machine
from ...daemon.observer import Observer
from ...files.recording.files import DirectRecording
from ...files.recording.header import header_of
from ...files.recording.records import pairs
from ...sim import lockstep
from ...sim.lockstep import T_START_NS, Run, Settings

UTC = "1970-01-01T00:00:00Z"  # virtual time has no date, and the same run gives the same bytes


def run(scenario: str, path: Path, *, settings: Settings, seed: int, seconds: float | None) -> Run:
    """`lockstep.run`, recorded to `path`. Raises RecordingError, SimulationError."""
    recording: list[DirectRecording] = []

    def observer(machine: Machine, modes: ModeShapes) -> Observer:
        header = header_of(machine, modes, t_ns=T_START_NS, utc=UTC, is_whole=True)
        recording.append(DirectRecording(path, header))
        return recording[0].put

    played = lockstep.run(scenario, settings=settings, seed=seed, seconds=seconds, observer=observer)
    _put_truth(recording[0], played)
    recording[0].close(T_START_NS + round(played.t_s[-1] * 1e9), "the scenario ended")
    return played


def _put_truth(recording: DirectRecording, played: Run) -> None:
    """Each control tick: where the fingers really were, what they should have got, and what the plate gave."""
    for index, t_ns in enumerate((T_START_NS + np.round(played.t_s * 1e9)).astype(np.int64).tolist()):
        recording.put(
            "truth",
            t_ns,
            [None if x != x else [x, y] for x, y in played.finger_true_mm[index].tolist()],
            [None if target != target else target for target in played.target_um[index].tolist()],
            pairs(played.modal_um[index].tolist()),
            [None if w != w else [w.real, w.imag] for w in played.truth_um[index].tolist()],
        )
