"""Input events as the kernel writes them, for tests."""

from __future__ import annotations

from dataclasses import replace

from hapticd.wire.trackpad import Pad, PadGeometry, evdev
from hapticd.wire.trackpad.evdev import EV_ABS, EV_SYN, POSITION_X, POSITION_Y, SLOT, SYN_REPORT, TRACKING_ID

END = (EV_SYN, SYN_REPORT, 0)
# 4000 x 4000 units on 400 x 200 mm: x and y have different scales
SCREEN = Pad("evdev", "screen", "evdev", PadGeometry(0, 4000, -4000, 0, 400.0, 200.0, 255, 90), 8_333_333, "evdev")
BARE_SCREEN = replace(SCREEN, geometry=PadGeometry(0, 4000, -4000, 0, 400.0, 200.0))


def packed(t_ns: int, *events: tuple[int, int, int]) -> bytes:
    second_s, rest_ns = divmod(t_ns, 1_000_000_000)
    return b"".join(evdev.EVENT.pack(second_s, rest_ns // 1000, *event) for event in events)


def axis(code: int, value: int) -> tuple[int, int, int]:
    return EV_ABS, code, value


def placed(slot: int, x: int, y: int, tracking_id: int | None = None) -> list[tuple[int, int, int]]:
    """A contact's place; with an id, its landing."""
    begun = [] if tracking_id is None else [axis(TRACKING_ID, tracking_id)]
    return [axis(SLOT, slot), *begun, axis(POSITION_X, x), axis(POSITION_Y, y)]


def lifted(slot: int) -> list[tuple[int, int, int]]:
    return [axis(SLOT, slot), axis(TRACKING_ID, -1)]
