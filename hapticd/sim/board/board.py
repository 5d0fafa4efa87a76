"""The simulated board: the firmware's C core with a plate behind its amplifiers, in virtual time.

It reads no clock and no global random generator: the same calls give the same bytes.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import numpy.typing as npt

from ...config.sections import MOST_MODES
from .firmware import Setup, doubles, load
from .trace import BoardTrace as BoardTrace
from .trace import TickBuffers

FLAG_SATURATED: Final = 0x01
FLAG_LIMITED: Final = 0x02
FLAG_LIVE: Final = 0x04
FLAG_DEADMAN: Final = 0x08
FLAG_SYNC: Final = 0x10  # the sync output is high

PLATE_MODES_MAX: Final = MOST_MODES + 2  # parasitic ones: HD_PLATE_MODES_MAX of firmware/boards/host/plate.h

CHUNK_S: Final = 50e-6  # from a tick to its voltage on the plate: HD_CHUNK of firmware/core/carrier.h
RESET_POWER: Final = 1
RESET_WATCHDOG: Final = 4

_LAWS: Final = {"pi": 0, "pi_ff": 1, "deadbeat": 2}
_TRANSMIT_BYTES: Final = 1024  # what does not fit stays pending: the longest message of eight modes has 271


@dataclass(frozen=True, slots=True)
class PlateModel:
    """Parameters of the true plate: P plate modes, M amplifiers and M sensors.

    `decay_1_s` (P,), `detuning_rad_s` (P,) of each mode from the drive, `gain_um_per_v_s` (P, M) of each amplifier
    on each mode, `sensor` (M, P) real or, without a carrier, complex, `noise_um` the standard deviation of each
    measured component per tick, `loop_phase_rad` (M,) the constant phase of each loop, 0 by default, `through_um_per_v`
    (M, M) what a volt of each amplifier adds to each sensor without moving the plate, complex, none by default.
    """

    decay_1_s: npt.NDArray[np.float64]
    detuning_rad_s: npt.NDArray[np.float64]
    gain_um_per_v_s: npt.NDArray[np.float64]
    sensor: npt.NDArray[np.float64] | npt.NDArray[np.complex128]
    noise_um: float
    amplifier_limit_v: float
    loop_phase_rad: tuple[float, ...] = ()
    through_um_per_v: npt.NDArray[np.complex128] | None = None

    def __post_init__(self) -> None:
        p, m = self.plate_modes, self.modes
        if not 1 <= p <= PLATE_MODES_MAX:
            raise ValueError(f"A plate model has 1 to {PLATE_MODES_MAX} modes, not {p}.")
        _check_finite(self, {"decay_1_s": (p,), "detuning_rad_s": (p,), "gain_um_per_v_s": (p, m), "sensor": (m, p)})
        _check_finite(self, {"noise_um": (), "amplifier_limit_v": (), "loop_phase_rad": (m,)})
        _check_finite(self, {"through_um_per_v": (m, m)})
        if not (np.all(self.decay_1_s > 0) and self.noise_um >= 0 and self.amplifier_limit_v > 0):
            raise ValueError("Decay rates and the amplifier limit are positive, the noise is not negative.")

    @property
    def plate_modes(self) -> int:
        return int(np.shape(self.decay_1_s)[0])

    @property
    def modes(self) -> int:
        return int(np.shape(self.gain_um_per_v_s)[1])


def _check_finite(of: object, shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Raise ValueError where numbers that are given have another shape or are not finite."""
    for name, shape in shapes.items():
        numbers = getattr(of, name)
        is_left_out = numbers is None or (isinstance(numbers, tuple) and not numbers)
        if not is_left_out and not (np.shape(numbers) == shape and np.all(np.isfinite(numbers))):
            raise ValueError(f"{name} is {numbers}: give finite numbers of shape {shape}.")


def reference_decay_1_s(quality: float = 500.0) -> tuple[float, float]:
    """Decay rate pi f / Q of the reference plate's two modes, 29 195 and 29 215 Hz."""
    return math.pi * 29195.0 / quality, math.pi * 29215.0 / quality


def reference_gain_um_per_v_s(quality: float = 500.0) -> float:
    """Gain of the reference plate: 150 V hold 4 um, 10 Hz off resonance."""
    return 4.0 / 150.0 * math.hypot(math.pi * 29205.0 / quality, 2.0 * math.pi * 10.0)


@dataclass(frozen=True, slots=True)
class BoardConfig:
    """The board's plate model and limits; the defaults are those of the reference plate, Q = 500.

    `controller` "pi" is the paper's four PI, "pi_ff" adds coupling compensation and feed-forward, "deadbeat"
    uses an observer; gains of None are the firmware's defaults. `loop_phase_rad` is the calibration of the loops, 0 by
    default; `drive`, `sense` and `feedthrough_um_per_v` that of the wires, each mode its own by default.
    """

    w_limit_um: tuple[float, ...] = (4.0, 4.0)
    v_limit_v: float = 150.0
    control_hz: float = 2000.0
    drive_hz: float = 29205.0
    decay_1_s: tuple[float, ...] = field(default_factory=reference_decay_1_s)
    detuning_rad_s: tuple[float, ...] = (-20.0 * math.pi, 20.0 * math.pi)
    gain_um_per_v_s: tuple[float, ...] = field(default_factory=lambda: (reference_gain_um_per_v_s(),) * 2)
    loop_phase_rad: tuple[float, ...] = ()
    drive: npt.NDArray[np.float64] | None = None
    sense: npt.NDArray[np.complex128] | npt.NDArray[np.float64] | None = None
    feedthrough_um_per_v: npt.NDArray[np.complex128] | None = None
    controller: str = "deadbeat"
    bandwidth_1_s: float | None = None
    integral_time_s: float | None = None
    latch_repeated_trips: bool = False
    has_sync: bool = True
    baud_max: int = 0
    image_crc: int = 0

    def __post_init__(self) -> None:
        m = len(self.w_limit_um)
        each = ("decay_1_s", "detuning_rad_s", "gain_um_per_v_s", "loop_phase_rad")
        _check_finite(self, dict.fromkeys(each, (m,)))
        _check_finite(self, dict.fromkeys(("drive", "sense", "feedthrough_um_per_v"), (m, m)))
        if self.controller not in _LAWS:
            raise ValueError(f"controller is {self.controller!r}, not one of {', '.join(_LAWS)}.")


class Board:
    """A running board at the instant of its last tick; `run` advances it.

    `t_start_us` is the instant of its boot on a clock that does not wrap, one tick before its first tick; the board's
    own clock is that modulo 2^32.
    """

    def __init__(
        self,
        model: PlateModel,
        *,
        config: BoardConfig | None = None,
        seed: int = 0,
        boot_id: int = 1,
        t_start_us: int = 0,
    ) -> None:
        config = BoardConfig() if config is None else config
        if len(config.w_limit_um) != model.modes:
            raise ValueError(
                f"The board is configured for {len(config.w_limit_um)} modes, its plate has {model.modes}."
            )
        self.model = model
        self.config = config
        self._library = load(model.modes)
        self._board = self._library.hd_board_new(ctypes.byref(self._setup(seed, boot_id, t_start_us)))
        if not self._board:
            raise ValueError(
                "The firmware refuses its configuration: rates, limits and gains must be positive and bounded."
            )
        self._out = ctypes.create_string_buffer(_TRANSMIT_BYTES)
        self._buffers: TickBuffers | None = None

    def __del__(self) -> None:
        if getattr(self, "_board", None):
            self._library.hd_board_free(self._board)

    @property
    def unwrapped_us(self) -> int:
        """The instant of the last tick on a clock that never wraps."""
        return int(self._library.hd_board_t_us(self._board))

    @property
    def t_us(self) -> int:
        """The same on the board's own 32-bit clock."""
        return self.unwrapped_us & 0xFFFFFFFF

    @property
    def baud(self) -> int:
        """The line's speed that the host has set; 0 for the one that the board started with."""
        return int(self._library.hd_board_baud(self._board))

    def reset(self, boot_id: int, cause: int = RESET_WATCHDOG) -> None:
        """Reset the processor: a new boot id, a clock from 0, no voltage. The plate rings down freely."""
        self._library.hd_board_reset(self._board, boot_id, cause)

    def skip(self, ticks: int) -> None:
        """Advance the clock by `ticks` that are not performed: plate and firmware stand still meanwhile."""
        self._library.hd_board_skip(self._board, ticks)

    def receive(self, data: bytes, at_us: int | None = None) -> None:
        """Deliver bytes now, or at an instant `at_us` before the next tick."""
        self._library.hd_board_receive(self._board, data, len(data), self.unwrapped_us if at_us is None else at_us)

    def transmit(self, at_us: int | None = None) -> bytes:
        """Take the board's pending output, now or at `at_us`, the time in its messages."""
        t_us = self.unwrapped_us if at_us is None else at_us
        n = self._library.hd_board_transmit(self._board, self._out, _TRANSMIT_BYTES, t_us)
        return ctypes.string_at(self._out, n) if n > 0 else b""

    def run(
        self,
        ticks: int,
        phi: npt.NDArray[np.float64],
        contact_decay_1_s: npt.NDArray[np.float64],
        out: BoardTrace,
        offset: int = 0,
        *,
        contact_detuning_rad_s: npt.NDArray[np.float64] | None = None,
        stop_on_transmit: bool = False,
    ) -> int:
        """Run up to `ticks` ticks and write their rows from `offset` on; returns the number of ticks run.

        Row i of `phi` (T, F, P) and `contact_decay_1_s` (T, F) applies to the tick that ends with row i of `out`; a
        lifted finger has decay 0. `contact_detuning_rad_s` (T, F) is what a finger adds to a mode's detuning per square
        of its shape; None, and with a carrier: nothing. With `stop_on_transmit` the run ends after the first tick with
        output.
        """
        buffers = self._buffers
        if buffers is None or not (
            buffers.phi is phi
            and buffers.contact_decay_1_s is contact_decay_1_s
            and buffers.contact_detuning_rad_s is contact_detuning_rad_s
            and buffers.out is out
        ):
            buffers = self._buffers = TickBuffers.of(
                phi, contact_decay_1_s, contact_detuning_rad_s, out, self.model.modes, self.model.plate_modes
            )
        if not 0 <= offset <= offset + ticks <= buffers.length:
            raise ValueError(f"Rows {offset} to {offset + ticks} do not fit arrays of {buffers.length} rows.")
        return int(
            self._library.hd_board_run(
                self._board,
                ticks,
                buffers.fingers,
                buffers.phi_at + offset * phi.strides[0],
                buffers.contact_decay_at + offset * contact_decay_1_s.strides[0],
                None
                if contact_detuning_rad_s is None
                else buffers.contact_detuning_at + offset * contact_detuning_rad_s.strides[0],
                buffers.trace,
                offset,
                stop_on_transmit,
            )
        )

    def estimate(self) -> npt.NDArray[np.float64]:
        """Return decay (1/s) and detuning (rad/s) of each mode (M, 2) as estimated by the board's observer."""
        estimate = np.zeros((self.model.modes, 2))
        self._library.hd_board_estimate(self._board, estimate.ctypes.data)
        return estimate

    def detune(self, detuning_rad_s: npt.NDArray[np.float64]) -> None:
        """Let the plate's modes drift to `detuning_rad_s` (P,) from the configured drive; not with a carrier."""
        values = np.ascontiguousarray(detuning_rad_s, dtype=np.float64)
        if values.shape != (self.model.plate_modes,) or not np.isfinite(values).all():
            raise ValueError(f"detuning_rad_s is {detuning_rad_s}: give {self.model.plate_modes} finite numbers.")
        self._library.hd_board_detune(self._board, values.ctypes.data)

    def interlock(self, event: int) -> None:
        """Open a circuit that forbids to drive, by its event of the board's log, or with 0 close all."""
        self._library.hd_board_interlock(self._board, event)

    def _setup(self, seed: int, boot_id: int, t_start_us: int) -> Setup:
        model, config = self.model, self.config
        own = {name: getattr(model, name) for name in ("decay_1_s", "detuning_rad_s", "gain_um_per_v_s")}
        nominal = {f"nominal_{name}": getattr(config, name) for name in own}
        phases = {"loop_phase_rad": model.loop_phase_rad, "nominal_loop_phase_rad": config.loop_phase_rad}
        same = ("control_hz", "drive_hz", "v_limit_v", "latch_repeated_trips", "has_sync", "baud_max", "image_crc")
        return Setup(
            plate_modes=model.plate_modes,
            **{name: doubles(values) for name, values in {**own, **nominal}.items()},
            **{name: doubles(values or (0.0,) * model.modes) for name, values in phases.items()},
            **{name: getattr(config, name) for name in same},
            sensor=doubles(np.real(model.sensor)),
            sensor_imaginary=doubles(np.imag(model.sensor)) if np.iscomplexobj(model.sensor) else None,
            through_um_per_v=_pairs(model.through_um_per_v),
            noise_um=model.noise_um,
            amplifier_limit_v=model.amplifier_limit_v,
            seed=seed,
            t_start_us=t_start_us,
            boot_id=boot_id,
            w_limit_um=doubles(config.w_limit_um),
            drive=None if config.drive is None else doubles(config.drive),
            sense=_pairs(config.sense),
            feedthrough_um_per_v=_pairs(config.feedthrough_um_per_v),
            law=_LAWS[config.controller],
            bandwidth_1_s=config.bandwidth_1_s or 0.0,
            integral_time_s=config.integral_time_s or 0.0,
            reset_cause=RESET_POWER,
        )


def _pairs(matrix: npt.ArrayLike | None) -> ctypes.Array[ctypes.c_double] | None:
    """A complex matrix as (real, imaginary) pairs."""
    return None if matrix is None else doubles(np.ascontiguousarray(matrix, np.complex128).view(np.float64))
