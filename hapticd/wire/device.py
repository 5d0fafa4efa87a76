"""Bytes to and from the board. `firmware/core/protocol.h` is the layouts' source, `firmware/PROTOCOL.md` their text.

A message is a type byte and a packed little-endian payload in a frame of `framing`. Encoders take what has been
checked; the decoder takes anything, never raises, and counts what it refuses.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from functools import cache
from math import isfinite
from typing import Final

from ..errors import DeviceError
from ..values import BoardHello, BoardMessage, BoardState, BoardStatus, BoardTime, SafeDrive
from .framing import FrameSplitter, encode_frame

PROTOCOL_VERSION: Final = 2
PROTOCOL_HASH: Final = 0xD5F8FDF5

KNOTS_MAX: Final = 24
KNOT_UNIT_NS: Final = 4000
OFFSET_MAX_NS: Final = 0xFFFF * KNOT_UNIT_NS

MSG_HELLO_REQUEST: Final = 0x01
MSG_REFERENCE: Final = 0x02
MSG_KEEPALIVE: Final = 0x03
MSG_TIME_REQUEST: Final = 0x04
MSG_CLEAR_FAULT: Final = 0x05
MSG_SET_CONTROLLER: Final = 0x06
MSG_HELLO: Final = 0x81
MSG_STATUS: Final = 0x82
MSG_TIME: Final = 0x83

LAWS: Final = {"pi": 0, "pi_ff": 1, "deadbeat": 2}
BANDWIDTH_1_S: Final = (10.0, 20000.0)
INTEGRAL_TIME_S: Final = (0.0001, 1.0)

FAULTS: Final = {
    0: "none",
    1: "a measurement was not finite",
    2: "a control voltage was not finite",
    3: "the measured amplitude stayed far above its limit",
    4: "the sensors do not answer the drive",
    5: "the host fell silent three times within ten seconds",
    6: "the board's configuration makes no sense",
}

REFERENCE: Final = struct.Struct("<HIBB")
KEEPALIVE: Final = struct.Struct("<H")
TIME_REQUEST: Final = struct.Struct("<Q")
SET_CONTROLLER: Final = struct.Struct("<Bff")
HELLO: Final = struct.Struct("<HIB16sIffHf")  # and the amplitude limit of each mode
STATUS: Final = struct.Struct("<IBBBBHIIHII")  # and measured d, q and voltage d, q of each mode
TIME: Final = struct.Struct("<QII")

_FLOAT24_MASK: Final = (1 << 64) - (1 << 29)  # the bits of a double that a float32's significand can hold

# --- to the board -----------------------------------------------------------------------------------------------


def encode_hello_request() -> bytes:
    """Asks who is there. The board falls silent and forgets sequence numbers: a new session begins."""
    return encode_frame(_typed(MSG_HELLO_REQUEST))


def encode_reference(seq: int, drive: SafeDrive, t_apply_us: int) -> bytes:
    """A reference polyline that begins at `t_apply_us` on the board's clock (wrapped or not).

    Knot times are rounded to 4 us and kept in order; amplitudes are rounded towards zero to float32, so a magnitude
    never grows. Raises ValueError for no knots or more than 24, or a knot outside 0..262 ms.
    """
    knots = drive.knots
    if not 1 <= len(knots) <= KNOTS_MAX:
        raise ValueError(f"A reference frame has 1 to {KNOTS_MAX} knots, not {len(knots)}.")
    modes = len(knots[0].modal_um)
    offsets = _offsets([knot.dt_ns for knot in knots])
    parts = [part for knot in knots for w_um in knot.modal_um for part in (w_um.real, w_um.imag)]
    floats = _truncated_to_float24(parts)
    width = 2 * modes
    values: list[float] = []
    for row, offset in enumerate(offsets):
        values.append(offset)
        values += floats[row * width : row * width + width]
    layout = _reference_layout(len(knots), modes)
    return encode_frame(layout.pack(MSG_REFERENCE, seq & 0xFFFF, t_apply_us & 0xFFFFFFFF, len(knots), modes, *values))


def encode_keepalive(seq: int) -> bytes:
    """The reference `seq` should stand: the board's dead-man waits another 50 ms if that is the last it accepted."""
    return encode_frame(_typed(MSG_KEEPALIVE) + KEEPALIVE.pack(seq & 0xFFFF))


def encode_time_request(t_host_ns: int) -> bytes:
    """Asks for the board's clock; the stamp comes back in the answer."""
    return encode_frame(_typed(MSG_TIME_REQUEST) + TIME_REQUEST.pack(t_host_ns))


def encode_clear_fault() -> bytes:
    """Lets a board that latched a fault go back to quiet."""
    return encode_frame(_typed(MSG_CLEAR_FAULT))


def encode_set_controller(
    law: str, *, bandwidth_1_s: float | None = None, integral_time_s: float | None = None
) -> bytes:
    """Selects "pi", the founding paper's four PI, or "pi_ff"; gains left out are the firmware's own.

    Raises ValueError for another name or a gain outside 10..2000 1/s, 0.5 ms..1 s.
    """
    if law not in LAWS:
        raise ValueError(f"There is no controller {law!r}: choose one of {', '.join(LAWS)}.")
    gains = (
        _checked_gain("bandwidth_1_s", bandwidth_1_s, BANDWIDTH_1_S),
        _checked_gain("integral_time_s", integral_time_s, INTEGRAL_TIME_S),
    )
    return encode_frame(_typed(MSG_SET_CONTROLLER) + SET_CONTROLLER.pack(LAWS[law], *gains))


def check_hello(hello: BoardHello, *, modes: int, w_limit_um: Sequence[float], v_limit_v: float | None = None) -> None:
    """Raises DeviceError, in one sentence, if this board must not be driven with these settings.

    A board that allows more than the settings is fine: each side holds its own limit.
    """
    if hello.protocol_version != PROTOCOL_VERSION:
        raise DeviceError(
            f"The board speaks protocol version {hello.protocol_version}, this hapticd {PROTOCOL_VERSION}: "
            f"flash the firmware that came with this hapticd."
        )
    if hello.protocol_hash != PROTOCOL_HASH:
        raise DeviceError(
            f"The board's protocol hash is {hello.protocol_hash:08x}, this hapticd's {PROTOCOL_HASH:08x}: "
            f"flash the firmware that came with this hapticd."
        )
    if hello.modes != modes:
        raise DeviceError(
            f"The board drives {hello.modes} modes, the mode shapes have {modes}: use shapes and firmware that fit."
        )
    for k, (allowed_um, wanted_um) in enumerate(zip(hello.w_limit_um, w_limit_um, strict=True)):
        if not wanted_um <= allowed_um * (1.0 + 1e-6):
            raise DeviceError(
                f"The amplitude limit of mode {k} is set to {wanted_um:g} um but the board allows {allowed_um:g} um: "
                f"set it to {allowed_um:g} or less."
            )
    if v_limit_v is not None and not v_limit_v >= hello.v_limit_v * (1.0 - 1e-6):
        raise DeviceError(
            f"The board drives up to {hello.v_limit_v:g} V but the amplifiers are set to take {v_limit_v:g} V: "
            f"flash a firmware for these amplifiers."
        )


@cache
def _typed(message: int) -> bytes:
    return bytes((message,))


def _checked_gain(name: str, value: float | None, bounds: tuple[float, float]) -> float:
    if value is None:
        return 0.0  # on the wire: the firmware's own
    if not bounds[0] <= value <= bounds[1]:
        raise ValueError(f"{name} is {value:g}, not within {bounds[0]:g}..{bounds[1]:g}.")
    return value


@cache
def _reference_layout(knots: int, modes: int) -> struct.Struct:
    """Type, head and `knots` times an offset with `modes` phasors."""
    return struct.Struct("<B" + REFERENCE.format[1:] + f"H{2 * modes}f" * knots)


@cache
def _doubles(count: int) -> struct.Struct:
    return struct.Struct(f"<{count}d")


@cache
def _float24_masks(count: int) -> int:
    return sum(_FLOAT24_MASK << (64 * i) for i in range(count))


def _truncated_to_float24(values: Sequence[float]) -> tuple[float, ...]:
    """Each value rounded towards zero to the 24 bits of a float32 significand: packing as float32 is then exact."""
    layout = _doubles(len(values))
    bits = int.from_bytes(layout.pack(*values), "little") & _float24_masks(len(values))
    return layout.unpack(bits.to_bytes(layout.size, "little"))


def _offsets(dt_ns: Sequence[int]) -> list[int]:
    """Knot times in the frame's units. Two that fall together are put one unit apart: the board wants them in order."""
    if not (dt_ns[0] >= 0 and dt_ns[-1] <= OFFSET_MAX_NS):
        raise ValueError(f"Knots lie 0 to {OFFSET_MAX_NS // 1_000_000} ms after the start of their frame.")
    previous = -1
    offsets: list[int] = []
    for dt in dt_ns:
        previous = max((dt + KNOT_UNIT_NS // 2) // KNOT_UNIT_NS, previous + 1)
        offsets.append(previous)
    return offsets


# --- from the board ---------------------------------------------------------------------------------------------

FRAME_MAX: Final = 512  # encoded; the longest message of eight modes has 160 bytes


class Decoder:
    """Bytes in pieces of any size in, messages out. Hostile bytes are counted by reason and never raise."""

    def __init__(self) -> None:
        self._splitter = FrameSplitter(FRAME_MAX)
        self._refused = {"type": 0, "length": 0, "value": 0}

    @property
    def counters(self) -> dict[str, int]:
        """Frames refused so far, by reason: oversize, cobs, crc, type, length, value."""
        return self._splitter.counters | self._refused

    def feed(self, data: bytes) -> tuple[BoardMessage, ...]:
        """The messages completed by `data`, in order."""
        messages = map(self._message, self._splitter.feed(data))
        return tuple(message for message in messages if message is not None)

    def _message(self, frame: bytes) -> BoardMessage | None:
        read = _READERS.get(frame[0])
        if read is None:
            self._refused["type"] += 1
            return None
        try:
            message = read(frame[1:])
        except struct.error:
            self._refused["length"] += 1
            return None
        if message is None:
            self._refused["value"] += 1
        return message


def _read_hello(payload: bytes) -> BoardHello | None:
    version, protocol_hash, modes, name, boot_id, control_hz, drive_hz, deadman_ms, v_limit_v = HELLO.unpack_from(
        payload
    )
    # Bytes after the limits are a later version's: HELLO only grows, so that its version can be read and refused.
    w_limit_um = struct.unpack_from(f"<{modes}f", payload, HELLO.size)
    text = name.rstrip(b"\0").decode("ascii", "replace")
    figures = (control_hz, drive_hz, v_limit_v, *w_limit_um)
    if not (modes >= 1 and text.isprintable() and all(0.0 < figure < 1e9 for figure in figures)):
        return None
    return BoardHello(
        protocol_version=version,
        protocol_hash=protocol_hash,
        firmware_version=text,
        boot_id=boot_id,
        modes=modes,
        control_hz=control_hz,
        drive_hz=drive_hz,
        deadman_ms=deadman_ms,
        w_limit_um=w_limit_um,
        v_limit_v=v_limit_v,
    )


def _read_status(payload: bytes) -> BoardStatus | None:
    t_us, state, flags, fault, modes, seq, received_us, applied_us, trips, bad, late = STATUS.unpack_from(payload)
    parts = struct.unpack(f"<{4 * modes}f", payload[STATUS.size :])
    if not (0 <= state <= 3 and flags <= 7 and modes >= 1 and all(map(isfinite, parts))):
        return None
    phasors = [complex(d, q) for d, q in zip(parts[::2], parts[1::2], strict=True)]
    return BoardStatus(
        t_board_us=t_us,
        state=BoardState(state),
        seq=seq,
        t_received_us=received_us,
        t_applied_us=applied_us,
        applied=bool(flags & 1),
        saturated=bool(flags & 2),
        limited=bool(flags & 4),
        fault_code=fault,
        deadman_trips=trips,
        bad_frames=bad,
        late_frames=late,
        measured_um=tuple(phasors[::2]),
        voltage_v=tuple(phasors[1::2]),
    )


def _read_time(payload: bytes) -> BoardTime | None:
    return BoardTime(*TIME.unpack(payload))


_READERS: Final[dict[int, Callable[[bytes], BoardMessage | None]]] = {
    MSG_HELLO: _read_hello,
    MSG_STATUS: _read_status,
    MSG_TIME: _read_time,
}
