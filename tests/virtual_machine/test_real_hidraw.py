"""Debian's kernel with its own drivers, virtual trackpads on Bluetooth and on USB, and hapticd reading real hidraw.

One boot in QEMU (`machine.py`) runs `guest/program.py`; each test judges what one of its steps found.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from machine import Boot

from hapticd.io.trackpad import PADS
from hapticd.values import Contact
from hapticd.wire.trackpad import GEOMETRY, Decoder

pytestmark = [pytest.mark.virtual_machine, pytest.mark.timeout(600)]

STEPS = {"bluetooth": "mt2-bt", "bluetooth-mt1": "mt1", "cable": "mt2-usb"}
ORIENTATIONS = {"mt1": 64, "mt2-bt": 8, "mt2-usb": 8}
GOLDEN_FILE = Path(__file__).parents[1] / "data/trackpad-golden.jsonl"
GOLDEN = {
    record["report"]: record
    for line in GOLDEN_FILE.read_text(encoding="utf-8").splitlines()
    if "report" in (record := json.loads(line))
}

GOLDEN_KEYS = {
    "x": "x",
    "y": "y",
    "major": "major4",
    "minor": "minor4",
    "orientation": "orient",
    "pressure": "pressure",
}

each_pad = pytest.mark.parametrize("step", STEPS)


@each_pad
def test_the_kernels_own_driver_takes_the_pad_and_enables_multitouch(guest: Boot, step: str) -> None:
    found = guest.step(step)
    (pad,) = [pad for pad in PADS if pad.model == STEPS[step]]
    assert found["driver"] == "magicmouse"
    assert found["features"][0] == pad.enable.hex()  # what hapticd sends is what the driver sends


@each_pad
def test_hapticd_finds_the_one_interface_that_speaks_of_touches(guest: Boot, step: str) -> None:
    found = guest.step(step)
    assert found["pads"] == [[STEPS[step], found["hidraw"]]]


@each_pad
def test_hidraw_gives_every_byte_that_the_pad_sent(guest: Boot, step: str) -> None:
    reports = guest.step(step)["reports"]
    assert len(reports) >= 30
    assert [report["hidraw"] for report in reports] == [report["sent"] for report in reports]


@each_pad
def test_a_report_means_to_hapticd_what_it_means_to_the_kernel(guest: Boot, step: str) -> None:
    model = STEPS[step]
    for report in guest.step(step)["reports"]:
        frame = Decoder(model).decode(bytes.fromhex(report["hidraw"]), 0)[-1]
        contacts = {str(contact.contact_id): axes(contact, model) for contact in frame.contacts if contact.touching}
        expected = {slot: kernel_axes(values) for slot, values in report["contacts"].items()}
        assert (contacts, frame.button) == (expected, report["button"]), report["sent"]


@each_pad
def test_the_golden_file_holds_what_this_kernel_says(guest: Boot, step: str) -> None:
    for report in guest.step(step)["reports"]:
        golden = GOLDEN[report["sent"]]
        expected = {
            slot: {name: values[key] for name, key in GOLDEN_KEYS.items()} for slot, values in golden["slots"].items()
        }
        assert (report["contacts"], report["button"]) == (expected, bool(golden["button"])), report["sent"]


@each_pad
def test_the_pad_has_the_ranges_that_the_kernel_declares(guest: Boot, step: str) -> None:
    pad = GEOMETRY[STEPS[step]]
    ranges = guest.step(step)["ranges"]
    units_x, units_y = pad.units_per_mm
    assert ranges["x"] == [pad.x_min_raw, pad.x_max_raw, math.floor(units_x)]
    assert ranges["y"] == [-pad.y_max_raw, -pad.y_min_raw, math.floor(units_y)]  # evdev's y points to the user


def axes(contact: Contact, model: str) -> dict[str, int]:
    """A decoded contact in evdev's units: y towards the user, the angle clockwise from +y in the pad's steps."""
    mm_per_unit = 2 / sum(GEOMETRY[model].units_per_mm)
    return {
        "x": contact.raw_x,
        "y": -contact.raw_y,
        "major": round(contact.major_mm / mm_per_unit),
        "minor": round(contact.minor_mm / mm_per_unit),
        "orientation": round((math.pi / 2 - contact.angle_rad) / math.pi * ORIENTATIONS[model]),
        "pressure": 0 if model == "mt1" else round(contact.pressure_frac * 253),  # evdev knows none for the first pad
    }


def kernel_axes(values: dict[str, Any]) -> dict[str, int]:
    return values | {"pressure": min(values["pressure"], 253)}
