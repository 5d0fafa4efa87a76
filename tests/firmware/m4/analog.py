"""The independent plate of firmware/bench/analog.c behind the emulated converters: 1 us, filters, cross-talk, broken
leads."""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
from ctypes import Structure, c_double, c_int
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np
import numpy.typing as npt

from .image import FIRMWARE
from .plate import DRIVE_HZ, STEP_V, Plate

FLOATING: Final = 1
CHUNK: Final = 50
_ALIGNED: Final = 128
_BYTES: Final = 1 << 16  # more than an_plate_t has


class _Lead(Structure):
    _fields_: ClassVar = [("fault", c_int), ("other", c_int)] + [
        (name, c_double)
        for name in ("kept", "clip_lsb", "noise_lsb", "hum_lsb", "offset_lsb", "heard", "heard_lsb_per_v")
    ]


@cache
def _library(modes: int) -> ctypes.CDLL:
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "analog.so"
        source = FIRMWARE / "bench/analog.c"
        flags = ["-O2", "-shared", "-fPIC", "-Wno-psabi", f"-DHD_MODES={modes}", f"-I{FIRMWARE / 'core'}"]
        subprocess.run(["cc", *flags, "-o", target, source, "-lm"], check=True)
        library = ctypes.CDLL(str(target))
    library.an_loop_phase_rad.restype = c_double
    return library


@cache
def _parameters(modes: int) -> type[Structure]:
    """The first fields of an_plate_t; the vectors of the motion follow."""
    all_modes = modes + 3
    numbers = ("v_per_lsb", "um_per_lsb", "v_limit_v", "amplifier_hz", "preamplifier_hz")

    class Parameters(Structure):
        _fields_: ClassVar = [
            ("modes", c_int),
            ("drive_hz", c_double),
            ("hz", c_double * all_modes),
            ("decay_1_s", c_double * all_modes),
            ("gain_um_per_v_s", c_double * modes * all_modes),
            ("sees", c_double * all_modes * modes),
            *((name, c_double) for name in numbers),
            ("lead", _Lead * modes),
            ("t_fault_us", c_double),
            ("finger_1_s", c_double),
            ("finger", c_double * all_modes),
        ]

    return Parameters


@dataclass(slots=True)
class IndependentPlate(Plate):
    """Of the modes that are driven. `motion` is looked at once in a chunk. Change what is in `at`, then `prepare`."""

    filters_hz: float = 150e3
    cross_talk: float = 0.01
    at: Any = field(init=False)
    _memory: Any = field(init=False)
    _motion: npt.NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        modes, parameters = len(self.mode_hz), _parameters(len(self.mode_hz))
        self._memory = ctypes.create_string_buffer(_BYTES + _ALIGNED)
        begin = -(-ctypes.addressof(self._memory) // _ALIGNED) * _ALIGNED
        self.at = at = parameters.from_address(begin)
        lanes = 16 if modes > 5 else 8
        behind = -(-ctypes.sizeof(parameters) // (8 * lanes)) * 8 * lanes
        self._motion = np.frombuffer((c_double * (2 * lanes)).from_address(begin + behind)).reshape(2, lanes)[:, :modes]
        at.modes, at.drive_hz = modes, DRIVE_HZ
        at.v_per_lsb, at.um_per_lsb = STEP_V * self.amplifier_v_per_v, STEP_V * self.sensor_um_per_v
        at.amplifier_hz = at.preamplifier_hz = self.filters_hz
        for k in range(modes):
            at.hz[k], at.decay_1_s[k] = self.mode_hz[k], self.decay_1_s(k)
            at.gain_um_per_v_s[k][k] = self.gain_um_per_v_s(k)
            for other in range(modes):
                at.sees[k][other] = 1.0 if other == k else self.cross_talk
        self.prepare()

    def prepare(self) -> None:
        _library(len(self.mode_hz)).an_prepare(ctypes.byref(self.at))

    @property
    def loop_phase_rad(self) -> float:
        return float(_library(len(self.mode_hz)).an_loop_phase_rad(ctypes.byref(self.at)))

    def advance(
        self, words: npt.NDArray[np.uint16], *, connected: bool, delay_frac: object
    ) -> tuple[npt.NDArray[np.uint16], npt.NDArray[np.complex128]]:
        """As `Plate`'s; a sample lies half-way between two movements of the DACs."""
        assert len(words) == CHUNK
        assert np.all(np.asarray(delay_frac) == 0.5)
        played, sampled = np.ascontiguousarray(words), np.empty_like(words)
        self.at.v_limit_v = self.amplifier_limit_v if connected else 0.0
        play = _library(len(self.mode_hz)).an_play
        play(ctypes.byref(self.at), played.ctypes.data_as(ctypes.c_void_p), sampled.ctypes.data_as(ctypes.c_void_p))
        x_um, v_um_s = self._motion
        return sampled, (x_um - 1j * v_um_s / (2 * np.pi * DRIVE_HZ))[np.newaxis]
