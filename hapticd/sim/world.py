"""The physical half of the simulation: fingers, plate, and the board with the firmware's C.

It is advanced tick by tick, in virtual time by `lockstep` and in real time by `rig`. Finger positions are computed one
chunk ahead, vectorised: they are pure functions of time, or a user's, whose chunks are short.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..core.plate.contact import disc_points
from ..values import FloatArray
from .board.board import Board, BoardConfig, BoardTrace, PlateModel
from .fingers.paths import Path
from .fingers.pressing import Tip
from .plate.ground_truth import GroundTruth

CHUNK_TICKS = 500
CONTROL_HZ = 2000.0


@dataclass(frozen=True, slots=True)
class WorldRecording:
    """History of T control ticks, skipped ones left out: t_s (T,), positions of touching fingers, references, modes."""

    t_s: npt.NDArray[np.float64]
    finger_mm: npt.NDArray[np.float64]
    reference_um: npt.NDArray[np.complex128]
    plate_um: npt.NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class PlateInstant:
    """The plate at one instant: all fingers (F, 2), NaN where lifted, and its modes (P,) in the rotating frame."""

    finger_mm: npt.NDArray[np.float64]
    plate_um: npt.NDArray[np.complex128]


def plate_model(plate: GroundTruth) -> PlateModel:
    """Return the plate as the board model has it."""
    return PlateModel(
        decay_1_s=plate.decay_1_s,
        detuning_rad_s=plate.detuning_rad_s,
        gain_um_per_v_s=plate.gain_um_per_v_s,
        sensor=plate.sensor,
        noise_um=plate.settings.sensor_noise_um,
        amplifier_limit_v=plate.settings.v_limit_v,
        loop_phase_rad=plate.loop_phase_rad,
    )


def board_config(plate: GroundTruth, w_limit_um: tuple[float, ...]) -> BoardConfig:
    """Return the configuration of a board that knows the plate's nominal rates and its wires."""
    return BoardConfig(
        w_limit_um=w_limit_um,
        v_limit_v=plate.settings.v_limit_v,
        control_hz=CONTROL_HZ,
        drive_hz=plate.settings.drive_hz,
        decay_1_s=tuple(plate.nominal_decay_1_s),
        detuning_rad_s=tuple(plate.nominal_detuning_rad_s),
        gain_um_per_v_s=tuple(plate.nominal_gain_um_per_v_s),
        drive=plate.drive,
        sense=plate.sense,
    )


class World:
    """One plate with its fingers and board; t = 0 is its start. With `keep` everything is recorded.

    `paths` are its F fingers, whose positions are computed `chunk_ticks` ahead. Where the world spreads
    their load, it is over the contacts of their `fingertips`.
    """

    def __init__(
        self,
        paths: Sequence[Path],
        plate: GroundTruth,
        *,
        w_limit_um: tuple[float, ...],
        seed: int,
        boot_id: int,
        board_start_us: int = 0,
        keep: bool = True,
        chunk_ticks: int = CHUNK_TICKS,
        fingertips: Sequence[Tip] = (),
    ) -> None:
        self.plate = plate
        self.board = Board(
            plate_model(plate),
            config=board_config(plate, w_limit_um),
            seed=seed,
            boot_id=boot_id,
            t_start_us=board_start_us,
        )
        self.ticks = 0
        self._board_start_us = board_start_us
        self._paths = paths
        self._fingertips = fingertips
        self._keep = keep
        self._chunk_ticks = chunk_ticks
        self._kept: list[tuple[FloatArray, npt.NDArray[np.float64], BoardTrace]] = []
        self._previous = PlateInstant(np.empty((0, 2)), np.zeros(len(plate.decay_1_s), dtype=np.complex128))
        self._start_chunk()

    @property
    def t_s(self) -> float:
        """Simulated time: the end of the last control tick."""
        return self.ticks / CONTROL_HZ

    @property
    def t_ahead_s(self) -> float:
        """Time up to which finger positions are already computed; later ones can still change."""
        return (self.ticks - self._done + self._chunk_ticks) / CONTROL_HZ

    def now(self) -> PlateInstant:
        """Return the state at the last tick; before the first, a plate at rest."""
        return self._previous if self._done == 0 else self._state_at(self._done - 1)

    def advance(self, t_s: float) -> bytes:
        """Run up to `t_s`, or to the first tick with board output; returns that output, b"" at `t_s`."""
        due = int(t_s * CONTROL_HZ + 1e-6)
        while self.ticks < due:
            if self._done == self._chunk_ticks:
                self._previous = self._state_at(self._done - 1)
                self._start_chunk()
            ticks = min(due - self.ticks, self._chunk_ticks - self._done)
            ran = self.board.run(
                *(ticks, self._phi, self._decay_1_s, self._trace, self._done),
                contact_detuning_rad_s=self._detuning_rad_s,
                stop_on_transmit=True,
            )
            self._done += ran
            self.ticks += ran
            output = self.board.transmit()
            if output:
                return output
        return b""

    def skip(self, t_s: float) -> None:
        """Let the time up to `t_s` pass without simulating it: the board's clock and the fingers go on, the plate and
        the firmware stand still."""
        due = int(t_s * CONTROL_HZ)
        self._previous = self.now()
        self._kept[-1][0][self._done :] = np.nan  # never performed
        self.board.skip(due - self.ticks)
        self.ticks = due
        self._start_chunk()

    def receive(self, data: bytes, t_s: float) -> None:
        """Deliver bytes to the board at `t_s`, after the last tick and before the next."""
        self.board.receive(data, self._board_start_us + round(max(t_s, self.t_s) * 1e6))

    def recording(self) -> WorldRecording:
        """Return the history so far."""
        t_s = np.concatenate([t_s for t_s, _, _ in self._kept])
        done = t_s <= self.t_s  # of the chunk that runs, only some ticks
        return WorldRecording(
            t_s=t_s[done],
            finger_mm=np.concatenate([fingers_mm for _, fingers_mm, _ in self._kept])[done],
            reference_um=np.concatenate([trace.reference_um for _, _, trace in self._kept])[done],
            plate_um=np.concatenate([trace.plate_um for _, _, trace in self._kept])[done],
        )

    def _state_at(self, tick: int) -> PlateInstant:
        """Return the state at a tick of this chunk."""
        _, fingers_mm, trace = self._kept[-1]
        return PlateInstant(fingers_mm[tick], trace.plate_um[tick])

    def _loaded(
        self, t_s: FloatArray, fingers_mm: FloatArray, fingers: npt.NDArray[np.intp]
    ) -> tuple[FloatArray, FloatArray]:
        """Return the points (T, F Q, 2) where these F fingers load the plate, and the share of each (Q,)."""
        places_mm = fingers_mm[:, fingers]
        spread_frac = self.plate.settings.world.finger_load.spread_frac
        if not (spread_frac and self._fingertips and len(fingers)):
            return places_mm, np.ones(1)
        dx, dy, shares = np.array(disc_points(spread_frac)).T
        ellipses_mm = np.stack([self._fingertips[finger].ellipses_mm(t_s) for finger in fingers.tolist()], axis=1)
        away_mm = np.einsum("tfij,qj->tfqi", ellipses_mm, np.stack((dx, dy), axis=1))
        return (places_mm[:, :, None] + away_mm).reshape(len(t_s), -1, 2), shares

    def _finger_loads(
        self, t_s: npt.NDArray[np.float64], fingers: npt.NDArray[np.intp], touching: npt.NDArray[np.bool_]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64] | None]:
        """Return decay rate and detuning (T, F) that these fingers add; no array if none detunes."""
        loads = np.zeros((2, len(t_s), len(fingers)))
        for column, finger in enumerate(fingers.tolist()):
            loads[:, :, column] = self.plate.finger_load(t_s, finger)
        decay_1_s, detuning_rad_s = np.where(touching[:, fingers], loads, 0.0)
        return decay_1_s, detuning_rad_s if self.plate.finger_detuning_rad_s else None

    def _start_chunk(self) -> None:
        ticks = self._chunk_ticks
        t_s = (self.ticks + np.arange(ticks) + 1) / CONTROL_HZ
        fingers_mm = np.full((ticks, len(self._paths), 2), np.nan)
        for index, path in enumerate(self._paths):
            fingers_mm[:, index] = path.position_mm(t_s)
        touching = np.isfinite(fingers_mm[..., 0])
        kept = np.flatnonzero(touching.any(axis=0))  # lifted fingers have no effect
        points_mm, shares = self._loaded(t_s, fingers_mm, kept)
        self._phi = np.ascontiguousarray(self.plate.shapes(points_mm))
        decay_1_s, detuning_rad_s = self._finger_loads(t_s, kept, touching)
        self._decay_1_s = _shared(decay_1_s, shares)
        self._detuning_rad_s = None if detuning_rad_s is None else _shared(detuning_rad_s, shares)
        if self.plate.drifts:
            self.board.detune(self.plate.drifted_rad_s(self.t_s))
        self._trace = BoardTrace(ticks, len(self.plate.sensor), len(self.plate.decay_1_s))
        self._done = 0
        if not self._keep:
            self._kept.clear()
        self._kept.append((t_s, fingers_mm, self._trace))


def _shared(loads: FloatArray, shares: FloatArray) -> FloatArray:
    """Divide loads (T, F) by shares (Q,): (T, F Q)."""
    return np.ascontiguousarray((loads[..., None] * shares).reshape(len(loads), -1), np.float64)
