"""The last gate on the host: a `Drive` becomes a `SafeDrive`, or silence. Nothing else makes a `SafeDrive`.

Held for every knot of what leaves: |W_k| <= limit, in float64, for every mode k. The board's float32 keeps it, because
the encoder rounds towards zero. A knot above a limit is scaled as a whole, all modes by one real factor: the spatial
pattern survives, and with it the zero under a still finger. Between knots the board interpolates, and a chord of a disc
stays in the disc. The firmware holds the same limits again, on its own.

Comparisons are written so that NaN fails them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from ...values import Drive, Knot, LimitReason, SafeDrive

UNTOUCHED: Final = LimitReason.NONE  # here and in all that passes do: a member looked up in its class takes 0.15 us
SHORTEST_NS: Final = 500_000  # the board's control tick: a finer polyline is never seen
GRAIN_NS: Final = 4_000  # the wire's unit of time
MAX_SPAN_NS: Final = 262_000_000  # a polyline longer than this does not fit the wire's 16-bit offsets of 4 us
MAX_LIMIT_UM: Final = 1e3  # a limit beyond is a mistake; the plate breaks long before


def gate(drive: Drive, limit_um: tuple[float, ...], max_knots: int = 24) -> SafeDrive:
    """The drive with every |W_k| within `limit_um` (M,), and why it was changed; idempotent.

    Silence where something is not finite, or malformed: no knots or more than `max_knots`, a wrong number of modes,
    times that are not integers, negative, not increasing or beyond `MAX_SPAN_NS`, a limit that is none.
    """
    if not _is_well_formed(drive, limit_um, max_knots):
        t_apply_ns = _whole_ns(drive)
        return silence(0 if t_apply_ns is None else t_apply_ns, max(len(limit_um), 1), LimitReason.MALFORMED)
    reasons = UNTOUCHED
    knots = drive.knots
    for index, (dt_ns, modal_um) in enumerate(knots):
        if _is_within(modal_um, limit_um):
            continue
        if not all(math.isfinite(w_um.real) and math.isfinite(w_um.imag) for w_um in modal_um):
            return silence(drive.t_apply_ns, len(limit_um), LimitReason.NOT_FINITE)
        knots = (*knots[:index], Knot(dt_ns, _scaled(modal_um, limit_um)), *knots[index + 1 :])
        reasons = LimitReason.AMPLITUDE
    return SafeDrive(drive.t_apply_ns, knots, reasons)


def silence(t_apply_ns: int, modes: int, reasons: LimitReason = UNTOUCHED) -> SafeDrive:
    """One knot of zero amplitude in all modes."""
    return SafeDrive(t_apply_ns, (Knot(0, (0j,) * modes),), reasons)


def _is_well_formed(drive: Drive, limit_um: tuple[float, ...], max_knots: int) -> bool:
    modes = len(limit_um)
    if not (modes >= 1 and _whole_ns(drive) is not None and 1 <= len(drive.knots) <= max_knots):
        return False
    for limit in limit_um:
        if not 0.0 <= limit <= MAX_LIMIT_UM:
            return False
    earliest_ns = 0
    for knot in drive.knots:
        dt_ns = _whole_ns(knot)
        if not (dt_ns is not None and earliest_ns <= dt_ns <= MAX_SPAN_NS and len(knot.modal_um) == modes):
            return False
        earliest_ns = dt_ns + 1
    return True


def _whole_ns(timed: Sequence[object]) -> int | None:
    """The time that a drive or a knot begins with; None where it is no whole number, whatever its type promises."""
    t_ns = timed[0]
    return t_ns if isinstance(t_ns, int) else None


def _is_within(modal_um: tuple[complex, ...], limit_um: tuple[float, ...]) -> bool:
    try:
        for mode in range(len(limit_um)):
            if not abs(modal_um[mode]) <= limit_um[mode]:
                return False
    except OverflowError:  # an absolute value beyond the range of floats
        return False
    return True


def _scaled(modal_um: tuple[complex, ...], limit_um: tuple[float, ...]) -> tuple[complex, ...]:
    """All modes by the largest common factor that brings each within its limit, to the last bit.

    Two steps: dividing by the largest component first keeps the magnitudes in the range of floats.
    """
    largest = max([max(abs(w_um.real), abs(w_um.imag)) for w_um in modal_um])
    unit = [complex(w_um.real / largest, w_um.imag / largest) for w_um in modal_um]
    factor = largest
    for u, limit in zip(unit, limit_um, strict=True):
        magnitude = math.hypot(u.real, u.imag)
        if magnitude * factor > limit:
            factor = limit / magnitude
    shave = 2.0**-53
    while True:
        scaled = tuple([complex(u.real * factor, u.imag * factor) for u in unit])
        if _is_within(scaled, limit_um):
            return scaled
        factor *= 1.0 - shave  # rounding left a last bit too many; at the latest a factor of 0 is within
        shave *= 2.0
