"""What runs in the guest: steps in order, each with a file of what it found or of how it failed.

The steps only look; `test_real_hidraw.py` outside judges.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import rules
import steps
from bluetooth import BluetoothPad
from cable import CableBoard, CablePad
from daemon import LOG
from kernel import EventDevice, Hidraw, Node, touch_node, wait_for
from story import Story

from hapticd.io.devices.hid_trackpad import find_pads, load_hid

ROOT = Path(__file__).parents[3]
PORT = Path("/dev/ttyACM0")
GOLDEN = [
    golden
    for line in (ROOT / "tests/data/trackpad-golden.jsonl").read_text(encoding="utf-8").splitlines()
    if "report" in (golden := json.loads(line))
]


def step(name: str, look: Callable[[], Any]) -> Any:
    return steps.step(name, look, lambda: LOG.read_text(encoding="utf-8") if LOG.exists() else "nothing yet")


def main() -> None:
    step("rules", rules.start)
    step("bluetooth", lambda: bluetooth_pad(0x004C, 0x0265, "mt2-bt"))
    step("bluetooth-mt1", lambda: bluetooth_pad(0x05AC, 0x030E, "mt1-bt"))
    step("mouse", another_mouse)
    step("board", board)
    cable = CablePad(0x05AC, 0x0265)
    step("cable", lambda: cable_pad(cable))
    tell(cable)


def tell(cable: CablePad) -> None:
    """The daemon's story; where one step fails, those after it make no sense."""
    story: list[Story] = []
    if step("daemon", lambda: story.append(Story(cable)) or "it serves"):
        for name, look in story[0].steps():
            if step(name, look) is None:
                return


def bluetooth_pad(vendor_id: int, product_id: int, tag: str) -> dict[str, Any]:
    pad = BluetoothPad(vendor_id, product_id)
    with plugged(pad, f"0005:{vendor_id:04X}:{product_id:04X}") as node:
        wait_for("the driver's enable", lambda: pad.features)
        return {"features": [feature.hex() for feature in pad.features], **taken(pad, node, tag)}


def cable_pad(pad: CablePad) -> dict[str, Any]:
    pad.plug()
    with plugged(pad, "0003:05AC:0265") as node:
        wait_for("the driver's enable", pad.collect)
        return {"features": [feature.hex() for feature in pad.features], **taken(pad, node, "mt2-usb")}


def another_mouse() -> dict[str, Any]:
    """A device on Bluetooth that is no trackpad, with the very descriptor of ours."""
    with plugged(BluetoothPad(0x046D, 0xB00C), "0005:046D:B00C") as node:
        return seen(node)


def board() -> dict[str, Any]:
    plug = CableBoard(0x0483, 0x5740)
    try:
        wait_for("the board's port", PORT.exists)
        return {"access": rules.outcome(PORT)}
    finally:
        plug.unplug()


@contextmanager
def plugged(pad: BluetoothPad | CablePad, hid_id: str) -> Iterator[Node]:
    """Its node, until udevd too has taken leave of it: the next pad's node may have the same name and number."""
    node = touch_node(hid_id)
    record = rules.record(node.hidraw)
    try:
        yield node
    finally:
        pad.unplug()
    wait_for(f"udev's farewell to {node.hidraw}", lambda: not record.exists())


def taken(pad: BluetoothPad | CablePad, node: Node, tag: str) -> dict[str, Any]:
    """What the kernel's driver makes of a pad and of its reports."""
    assert node.event is not None
    hidraw, events = Hidraw(node.hidraw), EventDevice(node.event)
    ranges = events.ranges()
    events.without_fuzz()
    found = reports(pad, hidraw, events, tag)
    hidraw.close()
    events.close()
    return {"ranges": ranges, "reports": found, **seen(node)}


def seen(node: Node) -> dict[str, Any]:
    """The kernel's driver, the nodes that hapticd would open, and what the rules give."""
    pads = [(pad.model, path.decode()) for pad, path in find_pads(load_hid())]
    return {"driver": node.driver, "hidraw": str(node.hidraw), "pads": pads, "access": rules.outcome(node.hidraw)}


def reports(pad: BluetoothPad | CablePad, hidraw: Hidraw, events: EventDevice, tag: str) -> list[dict[str, Any]]:
    """Every golden report of a pad: as hidraw gave it, and what the kernel's driver took from it."""
    found = []
    for report in (bytes.fromhex(golden["report"]) for golden in GOLDEN if golden["tag"] == tag):
        pad.send(report)
        heard = hidraw.read()
        kernel = {"contacts": events.contacts(), "button": events.button()}
        found.append({"sent": report.hex(), "hidraw": heard.hex(), **kernel})
        for ending in endings(report):
            pad.send(ending)
            hidraw.read()
    return found


def endings(report: bytes) -> list[bytes]:
    """Reports after which nothing is down: on the Magic Trackpad 1 each contact's end, on the others no contact."""
    if report[0] == 0x31:
        return [report[:4]]
    if report[0] == 0x02:
        return [report[:12]]
    frames = [report[2 : 2 + report[1]], report[2 + report[1] :]] if report[0] == 0xF7 else [report]
    ended = [bytearray(frame) for frame in frames]
    for frame in ended:
        frame[12::9] = bytes(len(frame[12::9]))  # the last byte of each record holds its state
    return [bytes(frame) for frame in ended]


if __name__ == "__main__":
    main()
