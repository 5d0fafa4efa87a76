"""Debian's kernel with a virtual touchscreen (uinput, protocol B), read as the service reads it.

One boot in QEMU runs `guest/touchscreens.py`: ten contacts land, move and are lifted, the device is unplugged and
plugged in again with another range.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import machine
import pytest

pytestmark = [pytest.mark.long, pytest.mark.timeout(1300)]

UNITS_PER_MM = {"x": 10, "y": 20}


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Any:
    if (reason := machine.missing()) is not None:
        pytest.skip(reason)
    program = Path(__file__).parent / "guest/touchscreens.py"
    return machine.boot(program, tmp_path_factory.mktemp("touchscreen")).step("touchscreen")


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
