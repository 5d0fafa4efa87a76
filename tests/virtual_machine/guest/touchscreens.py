"""What runs in the guest of `test_touchscreen.py`: virtual touchscreens and a tracker, read as the service reads them.

The steps only look; the test outside judges.
"""

from __future__ import annotations

import asyncio
import random
import struct
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(1, str(Path(__file__).parents[2]))

import steps
from bluetooth import BUS_USB, BluetoothPad
from daemon import LOG
from descriptors import touchscreen as touchscreen_descriptor
from devices_story import screen_story, tracker_story
from kernel import PATIENCE_S, EventDevice, touch_node
from touchscreen import RANGES, Touchscreen

from hapticd.io.devices.evdev_trackpad import EvdevTrackpad
from hapticd.io.devices.input_nodes import find_nodes
from hapticd.values import RawReport
from hapticd.wire.trackpad import Decoder, Pad, from_fields, to_fields

NAME, HID_NAME = "virtual touchscreen", "virtual HID touchscreen"
MOST = 10
FRAMES = 60
EVENT_BYTES = 24


class Reader:
    """The device as the service sees it: its links, and the last frame."""

    def __init__(self) -> None:
        self.links: list[tuple[dict[str, object] | None, str]] = []
        self.reports = self.repeated = 0
        self.contacts: dict[int, dict[str, float]] = {}
        self.late_ns: list[int] = []
        self.news = asyncio.Event()
        self._decoder: Decoder | None = None

    def linked(self, pad: Pad | None, reason: str) -> None:
        self.links.append((None if pad is None else to_fields(pad), reason))
        self._decoder = None if pad is None else Decoder(from_fields(to_fields(pad)))
        self.news.set()

    def reported(self, batch: Sequence[RawReport]) -> None:
        assert self._decoder is not None
        for report in batch:
            for frame in self._decoder.decode(report.data, report.t_host_ns):
                self.contacts = {one.contact_id: one._asdict() for one in frame.contacts}
                self.late_ns.append(report.t_host_ns - frame.t_ns)
        said = sum(len(report.data) > EVENT_BYTES for report in batch)
        self.reports += said
        self.repeated += len(batch) - said  # of a finger that lies still: a SYN_REPORT alone
        self.news.set()

    async def until(self, condition: Callable[[], bool]) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while not condition():
                self.news.clear()
                await self.news.wait()


def main() -> None:
    steps.step("touchscreen", lambda: asyncio.run(touchscreen()), lambda: "no daemon")
    steps.step("multitouch", lambda: asyncio.run(multitouch()), lambda: "no daemon")
    steps.step("daemon-evdev", screen_story, LOG.read_text)
    steps.step("daemon-tuio", tracker_story, LOG.read_text)


async def touchscreen() -> dict[str, Any]:
    reader, source = Reader(), EvdevTrackpad(NAME)
    source.start(asyncio.get_running_loop(), reader.reported, reader.linked)
    await reader.until(lambda: len(reader.links) == 1)
    frames = []
    for x_high in (RANGES["x"][1], 2 * RANGES["x"][1]):
        screen = Touchscreen(NAME, x_high)
        links = len(reader.links)
        await reader.until(lambda links=links: len(reader.links) > links and reader.links[-1][0] is not None)
        node = next(find_nodes(NAME))
        kernel = EventDevice(node.path)
        node.close()
        for sent in strokes(random.Random(x_high)):
            ids = {slot: axes for slot, axes in sent.items() if axes is not None}
            before = reader.reports
            screen.send(sent)
            await reader.until(lambda before=before: reader.reports > before)
            slots = kernel.contacts()
            await reader.until(lambda slots=slots: len(reader.contacts) == len(slots))
            frames.append({"sent": len(ids), "kernel": list(slots.values()), "seen": list(reader.contacts.values())})
        kernel.close()
        screen.send({0: {"id": 60000, "x": 5, "y": 5}})
        await reader.until(lambda: 60000 in reader.contacts)
        repeated = reader.repeated
        await reader.until(lambda repeated=repeated: reader.repeated >= repeated + 3)  # it lies still
        is_kept = 60000 in reader.contacts
        links = len(reader.links)
        screen.unplug()
        await reader.until(lambda links=links: len(reader.links) > links)
    await source.close()
    late_ns = sorted(reader.late_ns)
    return {
        "links": reader.links,
        "frames": frames,
        "is_kept": is_kept,
        "late_ms": [late_ns[0] * 1e-6, late_ns[len(late_ns) // 2] * 1e-6],
    }


async def multitouch() -> dict[str, Any]:
    """Ten fingers on a HID touchscreen, whose driver is the kernel's hid-multitouch; pulled under them, and back."""
    reader, source = Reader(), EvdevTrackpad(HID_NAME)
    source.start(asyncio.get_running_loop(), reader.reported, reader.linked)
    await reader.until(lambda: len(reader.links) == 1)
    frames, drivers, chance = [], [], random.Random(1)
    for _ in range(2):
        links = len(reader.links)
        screen = BluetoothPad(0x1234, 0x5679, touchscreen_descriptor(MOST), BUS_USB, HID_NAME)
        await reader.until(lambda links=links: len(reader.links) > links and reader.links[-1][0] is not None)
        node = touch_node("0003:1234:5679")
        drivers.append(node.driver)
        assert node.event is not None
        kernel = EventDevice(node.event)
        for count in (*range(1, MOST + 1), *[MOST] * 20):
            places = [(chance.randint(0, 3440), chance.randint(0, 1940)) for _ in range(count)]
            before = reader.reports
            screen.send(hid_report(places))
            await reader.until(lambda before=before: reader.reports > before)
            slots = list(kernel.contacts(("x", "y")).values())
            frames.append({"sent": places, "kernel": slots, "seen": list(reader.contacts.values())})
        kernel.close()
        links = len(reader.links)
        screen.unplug()
        await reader.until(lambda links=links: len(reader.links) > links)
    await source.close()
    return {"links": reader.links, "frames": frames, "drivers": drivers}


def hid_report(places: Sequence[tuple[int, int]]) -> bytes:
    """All fingers at once, in the form of `descriptors.touchscreen`."""
    fingers = b"".join(struct.pack("<BBHH", 1, number, x, y) for number, (x, y) in enumerate(places))
    return b"\1" + fingers + bytes(6 * (MOST - len(places))) + bytes((len(places),))


def strokes(chance: random.Random) -> list[dict[int, dict[str, int] | None]]:
    """Ten contacts land one after the other, move, and are lifted in another order."""

    def somewhere() -> dict[str, int]:
        return {name: chance.randint(low, high) for name, (low, high, _) in RANGES.items()}

    landing: list[dict[int, dict[str, int] | None]] = [{slot: {"id": 100 + slot} | somewhere()} for slot in range(10)]
    moves: list[dict[int, dict[str, int] | None]] = [
        {slot: somewhere() for slot in chance.sample(range(10), 1 + index % 10)} for index in range(FRAMES)
    ]
    order = chance.sample(range(10), 10)
    return [*landing, *moves, *[{slot: None} for slot in order]]


if __name__ == "__main__":
    main()
