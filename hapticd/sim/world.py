"""The physical half of the simulation: fingers on the plate, the plate, and the board with the firmware's C.

It is advanced tick by tick, in virtual time by `lockstep` and in real time by `rig`. What the fingers do is computed
a chunk ahead, vectorised, for they are pure functions of time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .board import Board, BoardConfig, BoardTrace, PlateModel
from .plate import PlateTruth
from .scenarios import Actor

CHUNK_TICKS = 500
CONTROL_HZ = 2000.0


@dataclass(frozen=True, slots=True)
class Recording:
    """What the plate did over T control ticks: t_s (T,), the fingers that touch it, references, all P plate modes."""

    t_s: npt.NDArray[np.float64]
    finger_mm: npt.NDArray[np.float64]
    reference_um: npt.NDArray[np.complex128]
    measured_um: npt.NDArray[np.complex128]
    plate_um: npt.NDArray[np.complex128]
    flags: npt.NDArray[np.uint8]


class World:
    """One plate with its fingers and its board; t = 0 is its start. With `keep` everything is recorded."""

    def __init__(
        self,
        actors: Sequence[Actor],
        plate: PlateTruth,
        *,
        w_limit_um: tuple[float, ...],
        seed: int,
        boot_id: int,
        board_start_us: int = 0,
        keep: bool = True,
    ) -> None:
        self.plate = plate
        self.board = Board(
            PlateModel(
                decay_1_s=plate.decay_1_s,
                detuning_rad_s=plate.detuning_rad_s,
                gain_um_per_v_s=plate.gain_um_per_v_s,
                sensor=plate.sensor,
                noise_um=plate.settings.sensor_noise_um,
                amplifier_limit_v=plate.settings.v_limit_v,
                loop_phase_rad=plate.loop_phase_rad,
            ),
            config=BoardConfig(
                w_limit_um=w_limit_um,
                v_limit_v=plate.settings.v_limit_v,
                control_hz=CONTROL_HZ,
                drive_hz=plate.settings.drive_hz,
                decay_1_s=tuple(plate.nominal_decay_1_s),
                detuning_rad_s=tuple(plate.nominal_detuning_rad_s),
                gain_um_per_v_s=tuple(plate.nominal_gain_um_per_v_s),
            ),
            seed=seed,
            boot_id=boot_id,
            t_start_us=board_start_us,
        )
        self.ticks = 0
        self._board_start_us = board_start_us
        self._paths = [actor.path for actor in actors if actor.path is not None]
        self._keep = keep
        self._kept: list[tuple[npt.NDArray[np.float64], BoardTrace]] = []
        self._start_chunk()

    @property
    def t_s(self) -> float:
        """The world's time: the end of the last control tick."""
        return self.ticks / CONTROL_HZ

    def advance(self, t_s: float) -> bytes:
        """Run up to `t_s`, or to the tick at which the board says something: its bytes, b"" at `t_s`."""
        due = int(t_s * CONTROL_HZ + 1e-6)
        while self.ticks < due:
            if self._done == CHUNK_TICKS:
                self._start_chunk()
            ticks = min(due - self.ticks, CHUNK_TICKS - self._done)
            part = slice(self._done, self._done + ticks)
            ran = self.board.run(
                ticks, self._phi[part], self._decay_1_s[part], self._trace, self._done, stop_on_transmit=True
            )
            self._done += ran
            self.ticks += ran
            said = self.board.transmit()
            if said:
                return said
        return b""

    def receive(self, data: bytes, t_s: float) -> None:
        """Bytes reach the board at `t_s`, after the last tick and before the next."""
        self.board.receive(data, self._board_start_us + round(t_s * 1e6))

    def reset_board(self, boot_id: int) -> None:
        """Its processor starts anew after the last tick, with its clock; the plate goes on."""
        self.board.reset(boot_id)
        self._board_start_us = self.board.unwrapped_us - round(self.t_s * 1e6)

    def recording(self) -> Recording:
        """Everything so far."""
        parts = [(fingers, trace, CHUNK_TICKS) for fingers, trace in self._kept[:-1]]
        parts.append((*self._kept[-1], self._done))
        return Recording(
            t_s=(np.arange(self.ticks) + 1) / CONTROL_HZ,
            finger_mm=np.concatenate([fingers[:count] for fingers, _, count in parts]),
            reference_um=np.concatenate([trace.reference_um[:count] for _, trace, count in parts]),
            measured_um=np.concatenate([trace.measured_um[:count] for _, trace, count in parts]),
            plate_um=np.concatenate([trace.plate_um[:count] for _, trace, count in parts]),
            flags=np.concatenate([trace.flags[:count] for _, trace, count in parts]),
        )

    def _start_chunk(self) -> None:
        t_s = (self.ticks + np.arange(CHUNK_TICKS) + 1) / CONTROL_HZ
        fingers_mm = np.full((CHUNK_TICKS, len(self._paths), 2), np.nan)
        for index, path in enumerate(self._paths):
            fingers_mm[:, index] = path.position_mm(t_s)
        self._phi = np.ascontiguousarray(self.plate.shapes(fingers_mm))
        self._decay_1_s = np.where(np.isfinite(fingers_mm[..., 0]), self.plate.settings.finger_decay_1_s, 0.0)
        self._trace = BoardTrace(CHUNK_TICKS, len(self.plate.sensor), len(self.plate.decay_1_s))
        self._done = 0
        if not self._keep:
            self._kept.clear()
        self._kept.append((fingers_mm, self._trace))
