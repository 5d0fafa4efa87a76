"""The core on a Cortex-M4 with the STM32G474's way through its samples and no board, for any number of modes.

The calls are those of main.c for a chunk, in its order; the plate is `plate.Plate`, sample by sample. What a board adds
is left out: its interrupt's own work, its interlock and outputs, the follower's retuning, the main loop's round.
"""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from hapticd.sim.board.board import BoardConfig, _setup
from hapticd.sim.board.firmware import load
from hapticd.values import Knot, LimitReason, SafeDrive
from hapticd.wire import device

from ..bench import nominal_plate
from .boards import G474
from .cpu import SCRATCH, Cpu
from .image import build_core
from .plate import DRIVE_HZ, STEP_V, Plate
from .timing import Count, Meter

CHUNK, CHUNK_US = 50, 50
CARRIER, CORE, IN, OUT, SENSED = (SCRATCH + 0x10000 * i for i in range(5))
CONVERTER_LAG_RAD = 2 * np.pi * DRIVE_HZ * 1e-6


class _Room(ctypes.Structure):
    """For an `hd_config_t` of any number of modes, whose layout is the same on both machines."""

    _fields_ = [("bytes", ctypes.c_uint8 * 8192)]


class CoreBench:
    """A core that was just initialised, its plate, and the host's side of its line."""

    def __init__(self, mode_hz: Sequence[float], control_hz: int) -> None:
        self.modes = len(mode_hz)
        self.plate = Plate(mode_hz=tuple(mode_hz))
        self.cpu = Cpu(G474, build_core(self.modes))
        self.now_us, self.seq = 0, 0
        converters = [DRIVE_HZ, control_hz]
        converters += [STEP_V * self.plate.amplifier_v_per_v] * self.modes
        converters += [STEP_V * self.plate.sensor_um_per_v] * self.modes
        self.cpu.write(IN, struct.pack(f"<{len(converters)}f", *converters))
        assert self.cpu.call("hd_carrier_init", CARRIER, IN) & 0xFF
        self.cpu.write(IN, self._config(control_hz))
        assert self.cpu.call("hd_init", CORE, IN, 0) & 0xFF
        self._meter = Meter(self.cpu)
        self._is_due = False
        self._to_play = [np.full((CHUNK, self.modes), 0x800, dtype="<u2")] * 2

    def _config(self, control_hz: int) -> bytes:
        """As `describe_board` of boards/stm32/board.c has it."""
        modes, plate = range(self.modes), self.plate
        config = BoardConfig(
            w_limit_um=(4.0,) * self.modes,
            control_hz=control_hz,
            decay_1_s=tuple(plate.decay_1_s(k) for k in modes),
            detuning_rad_s=tuple(2 * np.pi * (hz - DRIVE_HZ) for hz in plate.mode_hz),
            gain_um_per_v_s=tuple(plate.gain_um_per_v_s(k) for k in modes),
            loop_phase_rad=(-CONVERTER_LAG_RAD,) * self.modes,
        )
        describe = load(self.modes).hd_board_config
        describe.restype = _Room
        return bytes(describe(ctypes.byref(_setup(nominal_plate(config), config, 0, 1, 0, None))).bytes)

    def hold(self, w_um: Sequence[complex]) -> None:
        """The host's next frame, from now on."""
        self.seq += 1
        drive = SafeDrive(0, (Knot(0, tuple(w_um)),), LimitReason.NONE)
        line = device.encode_reference(self.seq, drive, self.now_us)
        self.cpu.write(IN, line)
        self.cpu.call("hd_receive", CORE, IN, len(line), self.now_us)

    def obeyed(self, line: bytes) -> Count:
        """What the main loop does with a frame while it keeps the interrupt out."""
        for byte in line:
            if self.cpu.call("hd_hear", CORE, byte) & 0xFF:
                return self._meter.measure(lambda: self.cpu.call("hd_obey", CORE, self.now_us))
        raise AssertionError("the core did not take the frame")

    def chunk(self) -> tuple[Count, Count | None]:
        """The next 50 us, and what is done at their end: by the chunk, and by a tick if one was due."""
        sampled, _ = self.plate.advance(self._to_play.pop(0), connected=True, delay_frac=0.5)
        self.now_us += CHUNK_US
        planes = np.zeros((self.modes, 2, CHUNK), dtype="<u2")
        planes[:, 0] = sampled.T
        self.cpu.write(IN, planes.tobytes())
        measure = self._meter.measure
        count, tick = measure(self._listen), None
        if self._is_due:
            tick = measure(lambda: self.cpu.call("hd_tick", CORE, self.now_us, SENSED, IN))
            count = count + measure(self._drive)
        count = count + measure(lambda: self.cpu.call("planar_speak", CARRIER, OUT))
        spoken = np.frombuffer(self.cpu.read(OUT, planes.nbytes), "<u2").reshape(planes.shape)
        self._to_play.append(spoken[:, 0].T.copy())
        return count, tick

    def _listen(self) -> None:
        self._is_due = bool(self.cpu.call("planar_listen", CARRIER, IN) & 0xFF)
        if self._is_due:
            self.cpu.call("hd_carrier_measure", CARRIER, SENSED)

    def _drive(self) -> None:
        self.cpu.set_float(0, DRIVE_HZ)
        self.cpu.call("hd_carrier_tune", CARRIER)
        self.cpu.call("hd_carrier_drive", CARRIER, IN)

    def measured_um(self) -> npt.NDArray[np.complex64]:
        """(modes,), over the last tick."""
        return np.frombuffer(self.cpu.read(SENSED, 8 * self.modes), "<c8")
