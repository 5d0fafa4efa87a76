"""Encoder of the board's commands: a type byte and a packed little-endian payload in a frame of `framing`.

The contract is firmware/PROTOCOL.md. Values that a user may have typed are checked against the bounds that the board
applies; the daemon's own references were checked before, and every pass encodes one: its amplitudes are converted from
doubles to float32 by their bits, all at once.
"""

from __future__ import annotations

import dataclasses
import struct
from collections.abc import Sequence
from enum import Enum
from functools import cache
from typing import Any, Final, get_args, get_type_hints

from .. import board_protocol as protocol
from ..board_protocol import Bounds, PlainCommand
from ..board_values import BoardCommand, ReferenceFrame, SetController, SetModel, SetWiring, is_within
from ..values import SafeDrive
from .framing import encode_frame

ALL_COMMANDS = sum(1 << number for name, number in vars(protocol).items() if name.startswith("MSG_") and number < 32)

OFFSET_MAX_NS: Final = 0xFFFF * protocol.KNOT_UNIT_NS
_FLOAT24_MASK: Final = (1 << 64) - (1 << 29)  # the bits of a double that a float32's significand can hold


def kinds(message: Any) -> dict[str, Any]:
    """Return the types of a message's fields, in order: int, float, complex or an Enum."""
    hints = get_type_hints(message)
    return {field.name: hints[field.name] for field in dataclasses.fields(message)}


_KINDS: Final[dict[Any, dict[str, Any]]] = {command: kinds(command) for command in get_args(PlainCommand)}


def encode(command: BoardCommand) -> bytes:
    """Encode one command as a frame. Raises ValueError for values that no board accepts."""
    if isinstance(command, ReferenceFrame):
        return encode_reference(command.seq, command.drive, command.t_apply_us, command.has_pulse)
    if isinstance(command, SetController):
        payload = _set_controller(command)
    elif isinstance(command, SetModel):
        payload = _set_model(command)
    elif isinstance(command, SetWiring):
        payload = _set_wiring(command)
    else:
        payload = _plain(command)
    return encode_frame(bytes((command.kind,)) + payload)


def _plain(command: PlainCommand) -> bytes:
    """A command whose fields are those of its payload, phasors as d and q."""
    numbers: list[Any] = []
    for name, kind in _KINDS[type(command)].items():
        value = getattr(command, name)
        value = complex(value) if kind is complex else value.value if issubclass(kind, Enum) else value
        _check(name, value, command.bounds[name])
        numbers += [value.real, value.imag] if kind is complex else [value]
    return command.layout.pack(*numbers)


def _set_controller(command: SetController) -> bytes:
    if command.law not in protocol.LAWS:
        raise ValueError(f"There is no controller {command.law!r}: choose one of {', '.join(protocol.LAWS)}.")
    gains = {"bandwidth_1_s": command.bandwidth_1_s, "integral_time_s": command.integral_time_s}
    for name, gain in gains.items():
        if gain is not None:
            _check(name, gain, protocol.SET_CONTROLLER_BOUNDS[name])
    default = 0.0  # on the wire: the firmware's own
    numbers = [default if gain is None else gain for gain in gains.values()]
    return protocol.SET_CONTROLLER.pack(protocol.LAWS[command.law], *numbers)


def _set_model(command: SetModel) -> bytes:
    bounds: Bounds = protocol.SET_MODEL_BOUNDS
    model = command.model
    numbers = {name: getattr(model, name) for name in ("decay_1_s", "detuning_rad_s", "gain_um_per_v_s", "loop")}
    for name, value in {"mode": command.mode, **numbers}.items():
        _check(name, value, bounds[name])
    *reals, loop = numbers.values()
    return protocol.SET_MODEL.pack(command.mode, *reals, loop.real, loop.imag)


def _set_wiring(command: SetWiring) -> bytes:
    """The board refuses amplifiers that cannot drive the modes independently."""
    bounds = protocol.SET_WIRING_BOUNDS
    numbers = [share for row in command.drive for share in row]
    for share in numbers:
        _check("drive", share, bounds["drive"])
    for name, matrix, within in (
        ("sense", command.sense, bounds["sense"]),
        ("feedthrough_um_per_v", command.feedthrough_um_per_v, bounds["feedthrough"]),
    ):
        for value in (complex(value) for row in matrix for value in row):
            _check(name, value, within)
            numbers += [value.real, value.imag]
    return struct.pack(f"<{len(numbers)}f", *numbers)


def _check(name: str, value: complex, bounds: tuple[float, float]) -> None:
    what, size = (f"the magnitude of {name}", abs(value)) if isinstance(value, complex) else (name, value)
    if not is_within(size, bounds):
        raise ValueError(f"{what} is {size:g}, not within {bounds[0]:g}..{bounds[1]:g}.")


def encode_reference(seq: int, drive: SafeDrive, t_apply_us: int, has_pulse: bool = False) -> bytes:
    """Encode a reference polyline that starts at `t_apply_us` on the board's clock (wrapped or not).

    Knot times are rounded to 4 us and kept in order; amplitudes are rounded towards zero to float32, so a magnitude
    never grows. With `has_pulse` the sync output rises as it takes effect. Raises ValueError for no knots or more than
    24, or a knot outside 0..262 ms.
    """
    knots = drive.knots
    if not 1 <= len(knots) <= protocol.KNOTS_MAX:
        raise ValueError(f"A reference frame has 1 to {protocol.KNOTS_MAX} knots, not {len(knots)}.")
    modes = len(knots[0].modal_um)
    offsets = _offsets([dt_ns for dt_ns, _ in knots])
    amplitudes: list[float] = []
    for _, modal_um in knots:
        for w_um in modal_um:
            amplitudes.append(w_um.real)
            amplitudes.append(w_um.imag)
    floats = _truncated_to_float24(amplitudes)
    width = 2 * modes
    values: list[float] = []
    for index, offset in enumerate(offsets):
        values.append(offset)
        values += floats[index * width : index * width + width]
    layout = _reference_layout(len(knots), modes)
    count = len(knots) | protocol.REFERENCE_PULSE if has_pulse else len(knots)
    return encode_frame(
        layout.pack(protocol.MSG_REFERENCE, seq & 0xFFFF, t_apply_us & 0xFFFFFFFF, count, modes, *values)
    )


@cache
def _reference_layout(knots: int, modes: int) -> struct.Struct:
    """Layout: type, header and `knots` times an offset with `modes` phasors."""
    return struct.Struct("<B" + protocol.REFERENCE.format[1:] + f"H{2 * modes}f" * knots)


@cache
def _doubles(count: int) -> struct.Struct:
    return struct.Struct(f"<{count}d")


@cache
def _float24_masks(count: int) -> int:
    return sum(_FLOAT24_MASK << (64 * i) for i in range(count))


def _truncated_to_float24(values: Sequence[float]) -> tuple[float, ...]:
    """Round each value towards zero to the 24 bits of a float32 significand, so that float32 packing is exact."""
    layout = _doubles(len(values))
    bits = int.from_bytes(layout.pack(*values), "little") & _float24_masks(len(values))
    return layout.unpack(bits.to_bytes(layout.size, "little"))


def _offsets(dt_ns: Sequence[int]) -> list[int]:
    """Round knot times to the frame's units; equal ones move one unit apart, as the board requires."""
    if not (dt_ns[0] >= 0 and dt_ns[-1] <= OFFSET_MAX_NS):
        raise ValueError(f"Knots must lie 0 to {OFFSET_MAX_NS // 1_000_000} ms after the start of their frame.")
    previous = -1
    offsets: list[int] = []
    for dt in dt_ns:
        offset = (dt + protocol.KNOT_UNIT_NS // 2) // protocol.KNOT_UNIT_NS
        previous = offset if offset > previous else previous + 1
        offsets.append(previous)
    return offsets
