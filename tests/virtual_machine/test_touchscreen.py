"""Debian's kernel with virtual touchscreens, read as the service reads them, and the daemon on one and on a tracker.

One boot in QEMU runs `guest/touchscreens.py`: on a touchscreen of uinput (protocol B) and on one of uhid, which the
kernel's hid-multitouch drives, ten contacts land and move; each is unplugged and plugged in again. Then the daemon
drives the plate under two fingers of a touchscreen, and of a tracker that speaks TUIO.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import machine
import pytest

pytestmark = [pytest.mark.long, pytest.mark.timeout(1300)]

UNITS_PER_MM = {"x": 10, "y": 20}


@pytest.fixture(scope="module")
def booted(tmp_path_factory: pytest.TempPathFactory) -> machine.Boot:
    if (reason := machine.missing()) is not None:
        pytest.skip(reason)
    program = Path(__file__).parent / "guest/touchscreens.py"
    return machine.boot(program, tmp_path_factory.mktemp("touchscreen"))


@pytest.fixture
def found(booted: machine.Boot) -> Any:
    return booted.step("touchscreen")


def test_every_report_of_up_to_ten_contacts_means_what_it_means_to_the_kernel(found: Any) -> None:
    assert len(found["frames"]) == 160
    assert max(len(frame["seen"]) for frame in found["frames"]) == 10
    for frame in found["frames"]:
        seen = [(one["raw_x"], -one["raw_y"], round(255 * one["pressure_frac"])) for one in frame["seen"]]
        kernel = [(slot["x"], slot["y"], slot["pressure"]) for slot in frame["kernel"]]
        assert sorted(seen) == sorted(kernel)


def test_positions_are_millimetres_by_the_resolution_that_the_device_declares(found: Any) -> None:
    frame = found["frames"][0]
    one, slot = frame["seen"][0], frame["kernel"][0]
    assert one["x_mm"] == pytest.approx((slot["x"] - 1720) / UNITS_PER_MM["x"])
    assert one["y_mm"] == pytest.approx((970 - slot["y"]) / UNITS_PER_MM["y"])


def test_it_is_unplugged_and_found_again_with_what_it_declares_then(found: Any) -> None:
    name = "virtual touchscreen"
    sizes = [pad and pad["size_mm"] for pad, _ in found["links"]]
    assert sizes == [None, [344.0, 97.0], None, [688.0, 97.0], None]
    reasons = [reason for _, reason in found["links"]]
    assert reasons[0] == f"no multitouch device {name!r} is connected: plug one in, or see hapticd doctor"
    assert reasons[1].startswith(f"{name} at /dev/input/event")
    assert reasons[2].endswith("was lost (No such device): searching for it")


def test_a_finger_that_lies_still_stays(found: Any) -> None:
    assert found["is_kept"]


def test_a_stamp_is_the_kernels_and_on_the_hosts_axis(found: Any) -> None:
    earliest_ms, usual_ms = found["late_ms"]
    assert 0.0 <= earliest_ms <= usual_ms < 1000.0


# --- a touchscreen of HID, by the kernel's hid-multitouch ---


def test_the_kernels_own_driver_takes_a_touchscreen_of_hid_each_time_it_is_plugged_in(booted: machine.Boot) -> None:
    found = booted.step("multitouch")
    assert found["drivers"] == ["hid-multitouch"] * 2
    sizes = [pad and pad["size_mm"] for pad, _ in found["links"]]
    assert sizes == [None, [344.0, 194.0], None, [344.0, 194.0], None]


def test_its_ten_fingers_are_where_the_kernel_has_them_and_where_they_were_put(booted: machine.Boot) -> None:
    frames = booted.step("multitouch")["frames"]
    assert len(frames) == 60
    assert max(len(frame["sent"]) for frame in frames) == 10
    for frame in frames:
        sent = sorted((x, y) for x, y in frame["sent"])
        assert sorted((slot["x"], slot["y"]) for slot in frame["kernel"]) == sent
        assert sorted((one["raw_x"], -one["raw_y"]) for one in frame["seen"]) == sent


# --- the daemon: touch, target, frame to the board ---

QUIET = {"daemon-evdev": "IDLE", "daemon-tuio": "ARMED"}  # a tracker that is silent may speak again at any time
each_source = pytest.mark.parametrize("step", QUIET)
each_plug = pytest.mark.parametrize("plug", ["first", "second"])


@each_source
@each_plug
def test_fingers_get_what_the_client_asked_for_and_the_plate_moves(booted: machine.Boot, step: str, plug: str) -> None:
    found = booted.step(step)[plug]
    landed_mm = sorted((one["x_mm"], one["y_mm"]) for one in found["landed"]["fingers"])
    assert landed_mm == [pytest.approx((-20.0, 7.5), abs=0.1), pytest.approx((25.0, -7.5), abs=0.1)]
    left, right = sorted(found["driven"]["fingers"], key=lambda finger: finger["x_mm"])
    assert (left["target_um"], right["target_um"]) == (1.0, 0.0)
    assert left["achieved_um"] == pytest.approx(1.0, abs=0.15)
    assert right["achieved_um"] < 0.6  # of what is not known of a plate
    assert found["plate_um"] > 0.3  # what the board measures
    assert min(one["x_mm"] for one in found["slid"]["fingers"]) == pytest.approx(0.0, abs=0.2)


@each_source
@each_plug
def test_a_device_that_is_pulled_under_the_fingers_lifts_them(booted: machine.Boot, step: str, plug: str) -> None:
    found = booted.step(step)
    quiet = found[f"{plug} pulled"]
    assert (quiet["state"], quiet["fingers"]) == (QUIET[step], [])
    assert found["exit"] == 0
