"""Encoder of a reference polyline, written by every pass and compiled with the touch path.

The contract is firmware/PROTOCOL.md. Amplitudes are converted from doubles to float32 by their bits, all at once.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import cache
from typing import Final

from .. import board_protocol as protocol
from ..values import SafeDrive
from .framing import encode_frame

OFFSET_MAX_NS: Final = 0xFFFF * protocol.KNOT_UNIT_NS
_FLOAT24_MASK: Final = (1 << 64) - (1 << 29)  # the bits of a double that a float32's significand can hold


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
            w_d_um, w_q_um = (w_um, 0.0) if isinstance(w_um, float) else (w_um.real, w_um.imag)
            amplitudes.append(w_d_um)
            amplitudes.append(w_q_um)
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
