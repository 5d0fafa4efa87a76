"""What runs in the guest: steps in order, each with a file of what it found or of how it failed.

The steps only look; `test_real_hidraw.py` outside judges.
"""

from __future__ import annotations

import json
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from bluetooth import BluetoothPad
from cable import CablePad
from kernel import EventDevice, Hidraw, Node, touch_node, wait_for

from hapticd.io.trackpad import find_pads, load_hid

ROOT = Path(__file__).parents[3]
RESULTS = Path("/run/results")
GOLDEN = [json.loads(line) for line in (ROOT / "tests/data/trackpad-golden.jsonl").read_text().splitlines()]


def step(name: str, look: Callable[[], Any]) -> None:
    print(f"guest: {name}", flush=True)
    try:
        outcome = {"found": look(), "error": None}
    except Exception:
        outcome = {"found": None, "error": traceback.format_exc()}
    (RESULTS / f"{name}.json").write_text(json.dumps(outcome))


def main() -> None:
    step("bluetooth", lambda: bluetooth_pad(0x004C, 0x0265, "mt2-bt"))
    step("bluetooth-mt1", lambda: bluetooth_pad(0x05AC, 0x030E, "mt1-bt"))
    step("cable", cable_pad)


def bluetooth_pad(vendor_id: int, product_id: int, tag: str) -> dict[str, Any]:
    pad = BluetoothPad(vendor_id, product_id)
    try:
        node = touch_node(f"0005:{vendor_id:04X}:{product_id:04X}")
        wait_for("the driver's enable", lambda: pad.features)
        return {
            "features": [feature.hex() for feature in pad.features],
            "reports": reports(pad, node, tag),
            **seen(node),
        }
    finally:
        pad.unplug()


def cable_pad() -> dict[str, Any]:
    pad = CablePad(0x05AC, 0x0265)
    pad.plug()
    try:
        node = touch_node("0003:05AC:0265")
        wait_for("the driver's enable", pad.collect)
        return {
            "features": [feature.hex() for feature in pad.features],
            "reports": reports(pad, node, "mt2-usb"),
            **seen(node),
        }
    finally:
        pad.unplug()


def seen(node: Node) -> dict[str, Any]:
    """The kernel's driver and the ranges it declares, and which of the nodes hapticd would open."""
    pads = [(pad.model, path.decode()) for pad, path in find_pads(load_hid())]
    assert node.event is not None
    events = EventDevice(node.event)
    ranges = events.ranges()
    events.close()
    return {"driver": node.driver, "hidraw": str(node.hidraw), "pads": pads, "ranges": ranges}


def reports(pad: BluetoothPad | CablePad, node: Node, tag: str) -> list[dict[str, Any]]:
    """Every golden report of a pad: as hidraw gave it, and what the kernel's driver took from it."""
    assert node.event is not None
    hidraw, events = Hidraw(node.hidraw), EventDevice(node.event)
    events.without_fuzz()
    found = []
    for golden in GOLDEN:
        if golden["tag"] != tag or "report" not in golden:
            continue
        report = bytes.fromhex(golden["report"])
        pad.send(report)
        heard = hidraw.read()
        found.append(
            {"sent": report.hex(), "hidraw": heard.hex(), "contacts": events.contacts(), "button": events.button()}
        )
        for ending in endings(report):
            pad.send(ending)
            hidraw.read()
    hidraw.close()
    events.close()
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
