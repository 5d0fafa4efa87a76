"""Input events of a touchscreen: any bytes give sound frames or none, and nothing grows."""

from __future__ import annotations

import math

from fuzz.target import Cost, Target
from hapticd.wire.trackpad import Decoder, Pad, PadGeometry, evdev
from hapticd.wire.trackpad.evdev import EV_ABS, EV_SYN, POSITION_X, POSITION_Y, SLOT, TRACKING_ID

SCREEN = Pad("evdev", "screen", "evdev", PadGeometry(0, 4000, -4000, 0, 400.0, 200.0, 255, 90), 8_333_333, "evdev")
EVENT_BYTES = 8  # type, code and value, in the seeds' short form
KINDS = (0, 1, 3, 4)


def check(data: bytes) -> None:
    """A first byte below 128: events of eight bytes each, a report per 16; else reports as they are, each after its
    length."""
    decoder = Decoder(SCREEN)
    is_short = bool(data) and data[0] < 128
    for number, report in enumerate(_short(data[1:]) if is_short else _raw(data[1:])):
        t_host_ns = number * 8_000_000
        for frame in decoder.decode(report, t_host_ns):
            assert len({one.contact_id for one in frame.contacts}) == len(frame.contacts) <= evdev.MAX_CONTACTS
            assert abs(frame.t_ns - t_host_ns) <= 1 << 33
            for contact in frame.contacts:
                assert all(math.isfinite(value) for value in contact)
                assert 0 <= contact.angle_rad < math.pi
                assert 0 <= contact.pressure_frac <= 1
                assert 0 <= contact.minor_mm <= contact.major_mm * 2.1  # of a screen with two scales


def _short(data: bytes) -> list[bytes]:
    events = [data[at : at + EVENT_BYTES] for at in range(0, len(data) - EVENT_BYTES + 1, EVENT_BYTES)]
    packed = [
        evdev.EVENT.pack(
            *(number // 100, number % 100 * 10_000, KINDS[event[0] % 4], int.from_bytes(event[1:4], "little") & 0x1FF),
            int.from_bytes(event[4:], "little", signed=True),
        )
        for number, event in enumerate(events)
    ]
    return [b"".join(packed[at : at + 16]) for at in range(0, len(packed), 16)]


def _raw(data: bytes) -> list[bytes]:
    reports, at = [], 0
    while at < len(data):
        reports.append(data[at + 1 : at + 1 + data[at]])
        at += 1 + data[at]
    return reports


def said(*events: tuple[int, int, int]) -> bytes:
    return b"\0" + b"".join(
        bytes((KINDS.index(kind),)) + code.to_bytes(3, "little") + value.to_bytes(4, "little", signed=True)
        for kind, code, value in events
    )


def seeds() -> dict[str, bytes]:
    end, place = (EV_SYN, 0, 0), [(EV_ABS, POSITION_X, 2000), (EV_ABS, POSITION_Y, 2000)]
    slots = [(EV_ABS, SLOT, 1), (EV_ABS, TRACKING_ID, 7), *place, (EV_ABS, 0x30, 90), (EV_ABS, 0x34, 40), end]
    anonymous = [*place, (EV_SYN, 2, 0), *place, (EV_SYN, 2, 0), end]
    raw = evdev.EVENT.pack(1, 2, EV_ABS, TRACKING_ID, 3) + evdev.EVENT.pack(1, 2, EV_SYN, 0, 0)
    return {
        "slots": said(*slots, (EV_ABS, TRACKING_ID, -1), end),
        "anonymous": said(*anonymous, (EV_SYN, 2, 0), end),
        "dropped": said(*slots, (EV_SYN, 3, 0), *slots),
        "raw": b"\xff" + bytes((len(raw),)) + raw,
    }


TARGET = Target(name="touchscreen", check=check, seeds=seeds, fixed=Cost(3000, 100_000), per_byte=Cost(60, 500))
