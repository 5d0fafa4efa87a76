"""Simulated boards with the carrier: 1 MHz samples through `firmware/core/carrier.c` and a plate of real resonators,
instead of envelopes; and sensors that read what a test wants."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from hapticd.sim.board.board import Board, PlateModel
from hapticd.sim.board.firmware import Setup

SAMPLE_HZ: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class Converters:
    """12-bit converters, the same for every mode; the defaults span 181 V and 8 um, as on the STM32 board.

    `offset_lsb` is the ADC's reading at rest, from mid-rail, `noise_lsb` the standard deviation of its samples, and
    `amplifier_lag_us` the time constant of the amplifiers, 0 or at least 0.1.
    """

    volts_per_lsb: float = 0.0886
    um_per_lsb: float = 0.0039
    offset_lsb: float = 0.0
    noise_lsb: float = 1.0
    amplifier_lag_us: float = 0.0

    def loop_phase_rad(self, drive_hz: float) -> float:
        """Return the constant phase of this loop: half a sample of the DAC's hold, and the amplifier's lag."""
        lag_rad = math.atan(2.0 * math.pi * drive_hz * self.amplifier_lag_us * 1e-6)
        return -math.pi * drive_hz / SAMPLE_HZ - lag_rad


@dataclass(frozen=True, slots=True)
class Lead:
    """What stands between a sensor and its converter; the defaults are a sound lead.

    `hum_lsb` is the amplitude of the mains, `clip_lsb` the preamplifier's range to either side of its middle, 0 for the
    converter's own, `pickup_lsb_per_v` what it picks up of all amplifiers' voltages together.
    """

    offset_lsb: float = 0.0
    noise_lsb: float = 1.0
    hum_lsb: float = 0.0
    hum_hz: float = 50.0
    clip_lsb: float = 0.0
    pickup_lsb_per_v: float = 0.0


class CarrierBoard(Board):
    """A board with `converters`, which replace the model's `noise_um` and `loop_phase_rad`; None: envelopes."""

    def __init__(self, model: PlateModel, *, converters: Converters | None, **others: Any) -> None:
        self._converters = None if converters is None else _numbers(converters)
        super().__init__(model, **others)

    def _setup(self, seed: int, boot_id: int, t_start_us: int) -> Setup:
        setup = super()._setup(seed, boot_id, t_start_us)
        setup.converters = None if self._converters is None else ctypes.addressof(self._converters)
        return setup

    def connect(self, leads: Sequence[Lead]) -> None:
        """Put these leads (M,) between sensors and converters."""
        assert len(leads) == self.model.modes
        assert self._library.hd_board_leads(self._board, (ctypes.c_double * 6 * len(leads))(*map(_numbers, leads)))


def _numbers(one: Converters | Lead) -> ctypes.Array[ctypes.c_double]:
    """Return `hd_converter_setup_t` or `hd_lead_t` of firmware/boards/host/lockstep.h."""
    values = astuple(one)
    return (ctypes.c_double * len(values))(*values)


def fake_measurement(board: Board, measured_um: npt.NDArray[np.complex128] | None) -> None:
    """Override the sensors with `measured_um` (M,), which may be NaN; None restores them."""
    values = None if measured_um is None else np.ascontiguousarray(measured_um, dtype=np.complex128)
    board._library.hd_board_fake_measurement(board._board, None if values is None else values.ctypes.data)
