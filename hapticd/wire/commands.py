"""Encoder of the board's commands: a type byte and a packed little-endian payload in a frame of `framing`.

The contract is firmware/PROTOCOL.md. Values that a user may have typed are checked against the bounds that the board
applies; the daemon's own references were checked before.
"""

from __future__ import annotations

import dataclasses
import struct
from enum import Enum
from typing import Any, Final, get_args, get_type_hints

from .. import board_protocol as protocol
from ..board_protocol import Bounds, PlainCommand
from ..board_values import BoardCommand, ReferenceFrame, SetController, SetModel, SetWiring, is_within
from .framing import encode_frame
from .reference import encode_reference

ALL_COMMANDS = sum(1 << number for name, number in vars(protocol).items() if name.startswith("MSG_") and number < 32)


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
        if name in command.bounds:
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
