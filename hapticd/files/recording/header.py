"""The header of a recording: what the machine was made of, so that another can be made that gets the same inputs."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
import numpy.typing as npt

from ...board_values import BoardCalibration, ModeCalibration
from ...config import loader as config
from ...config.sections import Config
from ...core.plate.mode_shapes import ModeShapes, ParasiticModes
from ...errors import ConfigError, HapticdError, RecordingError
from ...formats.toml_file import MAX_BYTES, parse
from ...values import AffineMap
from ...wire.trackpad import Pad, from_fields, to_fields
from .kinds import Fields

FORMAT = 2
UNITS = {
    "_ns": "nanoseconds; instants t_..._ns and MCAP's log_time on the recording host's monotonic clock",
    "_us": "microseconds of the board's wrapped 32-bit clock",
    "_mm": "millimetres on the plate, from its centre, x to the right, y away from the user",
    "_um": "micrometres peak to peak; d and q are the parts of W = d + j q",
    "_v": "volts",
}
_SCALARS = {
    "hapticd": str,
    "started_utc": str,
    "t_start_ns": int,
    "is_whole": bool,
    "instance": int,
}
_WIRES = ("drive", "sense", "feedthrough_um_per_v")  # of a calibration


@dataclass(frozen=True, slots=True)
class Header:
    """A machine as it was made. `t_start_ns` is the recording's begin on the host's monotonic clock, `started_utc`
    the same on the wall's, `hapticd` the version; `is_whole`: the machine had no input before."""

    hapticd: str
    started_utc: str
    t_start_ns: int
    is_whole: bool
    instance: int
    pad: Pad
    config: Config
    modes: ModeShapes
    calibration: BoardCalibration
    parasitic_modes: ParasiticModes | None = None


def utc_now() -> str:
    """The present date and time for people, such as 2026-11-21T16:40:00.123+00:00: nothing in the daemon is decided by
    the wall clock."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def texts_of(header: Header) -> dict[str, str]:
    """The header without maps and calibration, for people: metadata of the file and of what is exported."""
    return {
        "hapticd": header.hapticd,
        "started_utc": header.started_utc,
        "t_start_ns": str(header.t_start_ns),
        "trackpad_model": header.pad.model,
        "config_toml": config.render(header.config),
        "units": "\n".join(f"{suffix}: {meaning}" for suffix, meaning in UNITS.items()),
    }


def header_fields(header: Header) -> Fields:
    """The fields of the header's record."""
    modes = header.parasitic_modes
    return {
        "format": FORMAT,
        **{name: getattr(header, name) for name in _SCALARS},
        "pad": to_fields(header.pad),
        "config_toml": config.render(header.config),
        "modes_float64_le": _packed_modes(header.modes),
        "calibration": [_calibration_fields(measured) for measured in header.calibration.modes],
        "calibrated_drive_hz": header.calibration.drive_hz,
        "parasitic_modes": None if modes is None else _packed_parasitic_modes(modes),
    }


def header_from(fields: Fields) -> Header:
    """The inverse of `header_fields`. Raises RecordingError only."""
    try:
        if fields["format"] != FORMAT:
            raise RecordingError(
                f"The recording is not of format {FORMAT}, which this hapticd reads: take the hapticd that wrote it."
            )
        text = _typed(fields, "config_toml", str)
        if len(text) > MAX_BYTES:
            raise ValueError("no configuration is so long")
        settings = config.from_table(_known(parse(text, "configuration")), where="configuration", folder=None)
        modes = _modes(fields["modes_float64_le"])
        if len(settings.limits.w_limit_um) != modes.M:
            raise ValueError("limits and modes differ in number")
        drive_hz = fields.get("calibrated_drive_hz")  # None of a calibration without one, and in earlier recordings
        if not (drive_hz is None or (type(drive_hz) is float and math.isfinite(drive_hz))):
            raise ValueError("calibrated_drive_hz")
        return Header(
            **{name: _typed(fields, name, kind) for name, kind in _SCALARS.items()},
            # Of the pad, earlier recordings have the model alone.
            pad=from_fields(_typed({"pad": {"model": fields.get("trackpad_model")}} | fields, "pad", dict)),
            config=settings,
            modes=modes,
            calibration=BoardCalibration(
                tuple(_calibration(entry, modes.M) for entry in fields["calibration"]), drive_hz
            ),
            parasitic_modes=_parasitic_modes(fields["parasitic_modes"]),
        )
    except RecordingError:
        raise
    except ConfigError as error:
        raise RecordingError(f"The recording's header is not readable: {error}") from None
    except (HapticdError, ValueError, TypeError, LookupError, RecursionError):
        raise RecordingError("The recording's header is not readable: it is damaged, or not hapticd's.") from None


def _known(table: dict[str, Any]) -> dict[str, Any]:
    """Return the keys that this hapticd has, of those that it has not the pad's rotation and scale as its matrix."""
    known, pad = config.known_keys(table), table.get("trackpad", {})
    if "rotation_deg" in pad and not pad["matrix"]:
        placed = AffineMap.from_placement((0.0, 0.0), pad["rotation_deg"], pad["scale"])
        known["trackpad"]["matrix"] = [placed.xx, placed.xy, placed.yx, placed.yy]
    return known


def _typed(table: Any, name: str, kind: type) -> Any:
    value = table[name]
    if type(value) is not kind or (isinstance(value, int) and not 0 <= value < 1 << 63):
        raise ValueError(name)
    return value


def _packed(array: npt.NDArray[np.float64]) -> bytes:
    return np.ascontiguousarray(array, dtype="<f8").tobytes()


def _packed_modes(modes: ModeShapes) -> dict[str, bytes]:
    return {"x_mm": _packed(modes.x_mm), "y_mm": _packed(modes.y_mm), "shapes_mode_y_x": _packed(modes.shapes)}


def _packed_parasitic_modes(parasitic_modes: ParasiticModes) -> dict[str, object]:
    figures = {name: getattr(parasitic_modes, name) for name in ("decay_1_s", "detuning_rad_s")}
    return {"modes_float64_le": _packed_modes(parasitic_modes.modes), **figures}


def _modes(table: Any) -> ModeShapes:
    names = ("x_mm", "y_mm", "shapes_mode_y_x")
    x_mm, y_mm, shapes = (np.frombuffer(_typed(table, name, bytes), dtype="<f8").astype(np.float64) for name in names)
    shapes = shapes.reshape(-1, y_mm.size, x_mm.size)
    return ModeShapes.from_grid(x_mm, y_mm, shapes)


def _parasitic_modes(table: Any) -> ParasiticModes | None:
    if table is None:
        return None
    decay_1_s, detuning_rad_s = ([float(value) for value in table[name]] for name in ("decay_1_s", "detuning_rad_s"))
    return ParasiticModes(_modes(table["modes_float64_le"]), decay_1_s, detuning_rad_s)


def _calibration(entry: Any, modes: int) -> ModeCalibration:
    wires = {name: entry.get(name, ()) for name in _WIRES}
    measured = ModeCalibration(
        **{name: value for name, value in entry.items() if name not in _WIRES},
        drive=tuple(map(float, wires["drive"])),
        sense=tuple(complex(d, q) for d, q in wires["sense"]),
        feedthrough_um_per_v=tuple(complex(d, q) for d, q in wires["feedthrough_um_per_v"]),
    )
    figures = [getattr(measured, name) for name in ModeCalibration.__slots__ if name not in _WIRES]
    figures += [part for name in _WIRES for wire in getattr(measured, name) for part in (wire.real, wire.imag)]
    if not (type(measured.mode) is int and 0 <= measured.mode < modes and all(map(math.isfinite, figures))):
        raise ValueError("calibration")
    if any(len(getattr(measured, name)) not in (0, modes) for name in _WIRES):
        raise ValueError("calibration")
    return measured


def _calibration_fields(measured: ModeCalibration) -> dict[str, object]:
    """Its fields, complex numbers as pairs."""
    fields = dataclasses.asdict(measured)
    for name in ("sense", "feedthrough_um_per_v"):
        fields[name] = [(value.real, value.imag) for value in fields[name]]
    return fields
