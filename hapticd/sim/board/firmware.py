"""Binding of the firmware's shared library, declared in `firmware/boards/host/lockstep.h`.

It is built from `firmware/core` and `firmware/boards/host` when the package is installed, once per number of modes.
"""

from __future__ import annotations

import ctypes
import importlib.util
from functools import cache

import numpy as np
import numpy.typing as npt

from ...errors import DeviceError, rebuild

_DOUBLES = ctypes.POINTER(ctypes.c_double)


class Setup(ctypes.Structure):
    """`hd_board_setup_t` of firmware/boards/host/lockstep.h."""

    _fields_ = [
        ("plate_modes", ctypes.c_int32),
        ("decay_1_s", _DOUBLES),
        ("detuning_rad_s", _DOUBLES),
        ("gain_um_per_v_s", _DOUBLES),
        ("sensor", _DOUBLES),
        ("sensor_imaginary", _DOUBLES),
        ("loop_phase_rad", _DOUBLES),
        ("through_um_per_v", _DOUBLES),
        ("noise_um", ctypes.c_double),
        ("amplifier_limit_v", ctypes.c_double),
        ("seed", ctypes.c_uint64),
        ("converters", ctypes.c_void_p),
        ("t_start_us", ctypes.c_uint64),
        ("boot_id", ctypes.c_uint32),
        ("control_hz", ctypes.c_double),
        ("drive_hz", ctypes.c_double),
        ("v_limit_v", ctypes.c_double),
        ("w_limit_um", _DOUBLES),
        ("nominal_decay_1_s", _DOUBLES),
        ("nominal_detuning_rad_s", _DOUBLES),
        ("nominal_gain_um_per_v_s", _DOUBLES),
        ("nominal_loop_phase_rad", _DOUBLES),
        ("drive", _DOUBLES),
        ("sense", _DOUBLES),
        ("feedthrough_um_per_v", _DOUBLES),
        ("law", ctypes.c_int32),
        ("bandwidth_1_s", ctypes.c_double),
        ("integral_time_s", ctypes.c_double),
        ("latch_repeated_trips", ctypes.c_int32),
        ("reset_cause", ctypes.c_int32),
        ("has_sync", ctypes.c_int32),
        ("baud_max", ctypes.c_uint32),
        ("image_crc", ctypes.c_uint32),
    ]


class TraceBuffer(ctypes.Structure):
    """`hd_board_trace_t` of firmware/boards/host/lockstep.h."""

    _fields_ = [(name, ctypes.c_void_p) for name in ("reference_um", "measured_um", "plate_um", "voltage_v", "flags")]


@cache
def load(modes: int) -> ctypes.CDLL:
    """Load the host build of the firmware for this number of modes. Raises DeviceError if it was not built."""
    name = "hapticd.sim.board._firmware" if modes == 2 else f"hapticd.sim.board._firmware_{modes}modes"
    spec = importlib.util.find_spec(name)
    if spec is None or spec.origin is None:
        raise DeviceError(
            f"The simulated board's firmware for {modes} modes ({name}) is not built: "
            f"install a C compiler, then run `{rebuild()}`."
        )
    library = ctypes.CDLL(spec.origin)
    board, size = ctypes.c_void_p, ctypes.c_size_t
    signatures: dict[str, tuple[type | None, list[type]]] = {
        "hd_board_modes": (ctypes.c_int32, []),
        "hd_board_setup_size": (size, []),
        "hd_board_new": (board, [ctypes.POINTER(Setup)]),
        "hd_board_free": (None, [board]),
        "hd_board_reset": (None, [board, ctypes.c_uint32, ctypes.c_int32]),
        "hd_board_baud": (ctypes.c_uint32, [board]),
        "hd_board_t_us": (ctypes.c_uint64, [board]),
        "hd_board_skip": (None, [board, ctypes.c_uint64]),
        "hd_board_receive": (None, [board, ctypes.c_char_p, size, ctypes.c_uint64]),
        "hd_board_transmit": (size, [board, ctypes.c_char_p, size, ctypes.c_uint64]),
        "hd_board_run": (
            size,
            [board, size, ctypes.c_int32, board, board, board, ctypes.POINTER(TraceBuffer), size, ctypes.c_int32],
        ),
        "hd_board_estimate": (None, [board, ctypes.c_void_p]),
        "hd_board_detune": (None, [board, ctypes.c_void_p]),
        "hd_board_fake_measurement": (None, [board, ctypes.c_void_p]),
        "hd_board_leads": (ctypes.c_bool, [board, ctypes.c_void_p]),
        "hd_board_interlock": (None, [board, ctypes.c_uint8]),
        "hd_carrier_init": (ctypes.c_bool, [ctypes.c_void_p, ctypes.c_void_p]),
        "hd_carrier_listen": (ctypes.c_bool, [ctypes.c_void_p, ctypes.c_void_p]),
    }
    for function, (result, arguments) in signatures.items():
        getattr(library, function).restype = result
        getattr(library, function).argtypes = arguments
    if library.hd_board_modes() != modes or library.hd_board_setup_size() != ctypes.sizeof(Setup):
        raise DeviceError(f"{spec.origin} was built from other sources: run `{rebuild()}`.")
    return library


def doubles(values: npt.ArrayLike) -> ctypes.Array[ctypes.c_double]:
    flat = np.ravel(np.asarray(values, dtype=np.float64))
    return (ctypes.c_double * len(flat))(*flat)
