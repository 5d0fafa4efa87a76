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

from hapticd.values import Contact
from hapticd.wire.trackpad import PADS, Decoder

pytestmark = [pytest.mark.long, pytest.mark.timeout(1300)]

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

PLUGS = ("daemon-bluetooth", "daemon-replugged", "daemon-cable", "daemon-cable-back")
LEFT, RIGHT, SLID = (-824, 275), (1317, -386), (700, 600)  # raw; the left one slides

each_pad = pytest.mark.parametrize("step", STEPS)
each_plug = pytest.mark.parametrize("step", PLUGS)


@each_pad
def test_the_kernels_own_driver_takes_the_pad_and_enables_multitouch(guest: Boot, step: str) -> None:
    found = guest.step(step)
    pad = PADS[STEPS[step]]
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
    pad = PADS[STEPS[step]].geometry
    ranges = guest.step(step)["ranges"]
    units_x, units_y = pad.units_per_mm
    assert ranges["x"] == [pad.x_min_raw, pad.x_max_raw, math.floor(units_x)]
    assert ranges["y"] == [-pad.y_max_raw, -pad.y_min_raw, math.floor(units_y)]  # evdev's y points to the user


@each_pad
def test_the_rules_give_the_pad_to_the_services_group_and_to_who_sits_at_the_screen(guest: Boot, step: str) -> None:
    guest.step("rules")
    access = guest.step(step)["access"]
    assert (access["mode"], access["group"]) == ("0660", "ours")
    assert "uaccess" in access["tags"].split(":")


def test_the_rules_give_the_board_to_the_services_group_and_keep_modem_manager_away(guest: Boot) -> None:
    access = guest.step("board")["access"]
    assert (access["mode"], access["group"], access["modem_manager"]) == ("0660", "ours", "ignores it")
    assert "uaccess" in access["tags"].split(":")


def test_a_mouse_is_left_alone_by_the_rules_and_by_hapticd(guest: Boot) -> None:
    found = guest.step("mouse")
    assert found["driver"] == "hid-generic"
    assert (found["access"]["mode"], found["access"]["group"], found["access"]["tags"]) == ("0600", "0", "")
    assert found["pads"] == []


# --- the daemon, as a user who is in that group and has no other right ---


@each_plug
def test_the_daemon_sends_the_same_enable_as_the_driver(guest: Boot, step: str) -> None:
    features = guest.step(step)["features"]
    assert len(features) >= 2
    assert set(features) == {"0201" if "cable" in step else "f10201"}


@each_plug
def test_a_client_sees_the_fingers_where_they_are(guest: Boot, step: str) -> None:
    found = guest.step(step)
    assert sorted(positions(found["landed"])) == [pytest.approx(plate_mm(point)) for point in (LEFT, RIGHT)]
    assert sorted(positions(found["slid"])) == [pytest.approx(plate_mm(point)) for point in (SLID, RIGHT)]


@each_plug
def test_each_finger_gets_what_the_client_asked_for_and_the_plate_moves(guest: Boot, step: str) -> None:
    found = guest.step(step)
    left, right = sorted(found["driven"]["fingers"], key=lambda finger: finger["x_mm"])
    assert (left["target_um"], right["target_um"]) == (1.0, 0.0)
    assert left["achieved_um"] == pytest.approx(1.0, abs=0.15)
    assert right["achieved_um"] < 0.6  # of what is not known of a plate
    assert found["plate_um"] > 0.3  # what the board measures


def test_fingers_of_another_plug_are_new_fingers(guest: Boot) -> None:
    landings = [*PLUGS, "daemon-mouse-mode"]
    ids = [finger["id"] for step in landings for finger in guest.step(step)["landed"]["fingers"]]
    assert len(ids) == len(set(ids)) == 2 * len(landings)


@pytest.mark.parametrize("step", ["daemon-unplugged", "daemon-cable-pulled"])
def test_a_pad_that_is_pulled_under_the_fingers_lifts_them_and_the_plate_comes_to_rest(guest: Boot, step: str) -> None:
    found = guest.step(step)  # it waited for the board to measure that
    assert (found["quiet"]["state"], found["quiet"]["fingers"]) == ("IDLE", [])


def test_a_pad_that_speaks_as_a_mouse_is_enabled_again(guest: Boot) -> None:
    assert "f10201" in guest.step("daemon-mouse-mode")["features"]


def test_every_plug_and_every_pull_is_one_line(guest: Boot) -> None:
    ended = guest.step("daemon-ended")
    assert ended["exit"] == 0
    lines = [
        line for line in ended["log"] if "trackpad: " in line and "cannot be opened" not in line
    ]  # udev may be slow
    bluetooth, cable = "Magic Trackpad 2 on Bluetooth", "Magic Trackpad 2 on USB"
    assert lines == [
        "WARNING trackpad: no trackpad is connected: plug one in or pair it",
        f"INFO trackpad: {bluetooth} at /dev/hidraw0",
        f"WARNING trackpad: {bluetooth} was lost (read error): searching for it",
        f"INFO trackpad: {bluetooth} at /dev/hidraw0",
        f"WARNING trackpad: {bluetooth} was lost (read error): searching for it",
        f"INFO trackpad: {cable} at /dev/hidraw1",  # hidraw0 is its other interface
        f"WARNING trackpad: {cable} was lost (read error): searching for it",
        f"INFO trackpad: {cable} at /dev/hidraw1",
    ]


def positions(state: dict[str, Any]) -> list[tuple[float, float]]:
    return [(finger["x_mm"], finger["y_mm"]) for finger in state["fingers"]]


def plate_mm(raw: tuple[int, int]) -> tuple[float, float]:
    """The kernel's ranges and sizes: 160 mm are -3678 to 3934, 114.9 mm are -2587 to 2478, upwards."""
    return (raw[0] + 3678) / 7612 * 160 - 80, (raw[1] + 2587) / 5065 * 114.9 - 57.45


def axes(contact: Contact, model: str) -> dict[str, int]:
    """A decoded contact in evdev's units: y towards the user, the angle clockwise from +y in the pad's steps."""
    mm_per_unit = 2 / sum(PADS[model].geometry.units_per_mm)
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
