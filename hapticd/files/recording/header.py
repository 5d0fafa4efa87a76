"""The first record: what a recording is of. With it a machine can be made that hears the rest as the first one did."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import msgpack
import numpy as np
import numpy.typing as npt

from ... import __version__
from ...board_values import ModeCalibration
from ...config import loader as config
from ...config.sections import Config
from ...core.plate.mode_shapes import ModeShapes
from ...core.plate.parasitic_modes import ParasiticModes
from ...daemon.machine import Machine
from ...errors import ConfigError, HapticdError, RecordingError
from ..toml_file import MAX_BYTES, parse
from .records import described

FORMAT = 1
UNITS = {
    "_ns": "nanoseconds; instants t_..._ns on the recording host's monotonic clock",
    "_us": "microseconds of the board's wrapped 32-bit clock",
    "_mm": "millimetres on the plate, from its centre, x to the right, y away from the user",
    "_um": "micrometres peak to peak; a pair is (d, q) of W = d + j q",
    "_v": "volts",
}


@dataclass(frozen=True, slots=True)
class Header:
    """What the machine was made of. `t_start_ns` is the recording's begin on the host's monotonic clock, `started_utc`
    the same on the wall's; `is_whole` says that the machine had heard nothing before."""

    hapticd: str
    started_utc: str
    t_start_ns: int
    is_whole: bool
    instance: int
    trackpad_model: str
    config: Config
    modes: ModeShapes
    calibration: tuple[ModeCalibration, ...]
    parasitic_modes: ParasiticModes | None = None


def header_of(machine: Machine, modes: ModeShapes, *, t_ns: int, utc: str, is_whole: bool) -> Header:
    """The header for what this machine hears from `t_ns` on."""
    return Header(
        hapticd=__version__,
        started_utc=utc,
        t_start_ns=t_ns,
        is_whole=is_whole,
        instance=machine.instance,
        trackpad_model=machine.trackpad.model,
        config=machine.config,
        modes=modes,
        calibration=machine.calibration,
        parasitic_modes=machine.parasitic_modes,
    )


def encode_header(header: Header) -> bytes:
    """The body of the first record."""
    return bytes(
        msgpack.packb(
            {
                "format": FORMAT,
                "hapticd": header.hapticd,
                "started_utc": header.started_utc,
                "t_start_ns": header.t_start_ns,
                "is_whole": header.is_whole,
                "instance": header.instance,
                "trackpad_model": header.trackpad_model,
                "config_toml": config.render(header.config),
                "modes_float64_le": _packed_modes(header.modes),
                "calibration": [dataclasses.asdict(measured) for measured in header.calibration],
                "neighbours": None if header.parasitic_modes is None else _packed_neighbours(header.parasitic_modes),
                "records": described(),
                "units": UNITS,
            }
        )
    )


def decode_header(body: bytes) -> Header:
    """The header again. Raises RecordingError only."""
    try:
        table = msgpack.unpackb(body, raw=False, strict_map_key=True, max_ext_len=0)
        if table["format"] != FORMAT:
            raise RecordingError(
                f"The recording is not of format {FORMAT}, which this hapticd reads: take the hapticd that wrote it."
            )
        text = _typed(table, "config_toml", str)
        if len(text) > MAX_BYTES:
            raise ValueError("no configuration is so long")
        settings = config.from_table(parse(text, "configuration"), where="configuration", folder=None)
        modes = _modes(table["modes_float64_le"])
        if len(settings.limits.w_limit_um) != modes.M:
            raise ValueError("limits and modes differ in number")
        return Header(
            hapticd=_typed(table, "hapticd", str),
            started_utc=_typed(table, "started_utc", str),
            t_start_ns=_typed(table, "t_start_ns", int),
            is_whole=_typed(table, "is_whole", bool),
            instance=_typed(table, "instance", int),
            trackpad_model=_typed(table, "trackpad_model", str),
            config=settings,
            modes=modes,
            calibration=tuple(_calibration(entry, modes.M) for entry in table["calibration"]),
            parasitic_modes=_neighbours(table.get("neighbours")),  # which older recordings do not know
        )
    except RecordingError:
        raise
    except ConfigError as error:
        raise RecordingError(f"The recording's header is not readable: {error}") from None
    except (HapticdError, ValueError, TypeError, LookupError, RecursionError, msgpack.UnpackException):
        raise RecordingError("The recording's header is not readable: it is damaged, or not hapticd's.") from None


def _typed(table: Any, name: str, kind: type) -> Any:
    value = table[name]
    if type(value) is not kind or (isinstance(value, int) and not -(1 << 63) <= value < 1 << 63):
        raise ValueError(name)
    return value


def _packed(array: npt.NDArray[np.float64]) -> bytes:
    return np.ascontiguousarray(array, dtype="<f8").tobytes()


def _packed_modes(modes: ModeShapes) -> dict[str, bytes]:
    return {"x_mm": _packed(modes.x_mm), "y_mm": _packed(modes.y_mm), "shapes_mode_y_x": _packed(modes.shapes)}


def _packed_neighbours(parasitic_modes: ParasiticModes) -> dict[str, object]:
    return {
        "modes_float64_le": _packed_modes(parasitic_modes.modes),
        "decay_1_s": parasitic_modes.decay_1_s,
        "detuning_rad_s": parasitic_modes.detuning_rad_s,
        "finger_decay_1_s": parasitic_modes.finger_decay_1_s,
    }


def _modes(table: Any) -> ModeShapes:
    names = ("x_mm", "y_mm", "shapes_mode_y_x")
    x_mm, y_mm, shapes = (np.frombuffer(_typed(table, name, bytes), dtype="<f8").astype(np.float64) for name in names)
    shapes = shapes.reshape(-1, y_mm.size, x_mm.size)
    return ModeShapes.from_grid(x_mm, y_mm, shapes)


def _neighbours(table: Any) -> ParasiticModes | None:
    if table is None:
        return None
    decay_1_s, detuning_rad_s = ([float(value) for value in table[name]] for name in ("decay_1_s", "detuning_rad_s"))
    return ParasiticModes(
        _modes(table["modes_float64_le"]), decay_1_s, detuning_rad_s, float(_typed(table, "finger_decay_1_s", float))
    )


def _calibration(entry: Any, modes: int) -> ModeCalibration:
    measured = ModeCalibration(**entry)
    figures: list[float] = [getattr(measured, name) for name in ModeCalibration.__slots__]
    if not (type(measured.mode) is int and 0 <= measured.mode < modes and all(map(math.isfinite, figures))):
        raise ValueError("calibration")
    return measured
