"""hapticd as a service on Debian's kernel and systemd: the unit as `service install` puts it, and devices' nodes.

One boot in QEMU (`machine.py`) runs `guest/service.py` with a virtual trackpad and touchscreen, a board on a virtual
USB and a client; each test judges what one of its steps found. What the unit says is in force to the letter, its time
limits too: the guest's clock counts instructions, so that a busy host delays nothing in it.
"""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent))

import machine
from machine import Boot

from hapticd.compiled import why_interpreted
from hapticd.tools.install_service import AFTER_REMOVAL, AFTERWARDS
from hapticd.wire.trackpad import PADS

pytestmark = [pytest.mark.long, pytest.mark.timeout(1300)]

FIFO_RESET_ON_FORK = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
ERROR, INFO = 3, 6  # syslog(3)
each_strike = pytest.mark.parametrize("step", ["killed", "hung"])


@pytest.fixture(scope="module")
def guest(tmp_path_factory: pytest.TempPathFactory) -> Boot:
    """What the guest's program found: it ran once, to its end."""
    if (reason := machine.missing()) is not None:
        pytest.skip(reason)
    return machine.boot(tmp_path_factory.mktemp("guest"))


def lines(boot: Boot, text: str) -> list[dict[str, Any]]:
    """The journal's lines with this in them."""
    return [entry for entry in boot.step("journal") if text in entry["text"]]


def expect_driven(fingers: list[dict[str, Any]]) -> None:
    left, right = sorted(fingers, key=lambda finger: finger["x_mm"])
    assert left["achieved_um"] == pytest.approx(1.0, abs=0.15)
    assert right["achieved_um"] < 0.6  # of what is not known of a plate


def test_the_commands_that_service_install_prints_start_the_unit_as_it_is_written(guest: Boot) -> None:
    found = guest.step("installed")
    assert found["commands"] == AFTERWARDS.splitlines()
    assert (found["ActiveState"], found["SubState"], found["UnitFileState"]) == ("active", "running", "enabled")
    assert (found["FragmentPath"], found["DropInPaths"]) == ("/etc/systemd/system/hapticd.service", "")
    assert [found[name] for name in ("WatchdogUSec", "RestartUSec", "TimeoutStopUSec")] == ["1s", "250ms", "2s"]


def test_it_is_ready_when_clients_are_served_and_says_where(guest: Boot) -> None:
    assert guest.step("ready")["StatusText"] == "serving clients in /run/hapticd"
    started, serving = (lines(guest, text)[0]["t_s"] for text in ("Started hapticd.service", "serving clients in"))
    assert serving <= started


def test_it_runs_compiled_as_a_user_of_its_own_without_capabilities_behind_a_filter(guest: Boot) -> None:
    found = guest.step("ready")
    (uid, gid), process = map(str, found["ids"]), found["process"]
    assert (set(process["Uid"]), set(process["Gid"])) == ({uid}, {gid})
    assert set(process["Groups"]) == {gid, str(found["devices_gid"])}
    assert [int(process[name][0], 16) for name in ("CapEff", "CapBnd")] == [0, 0]
    assert (process["NoNewPrivs"], process["Seccomp"]) == (["1"], ["2"])
    assert process["runs_compiled"] is (why_interpreted() == "")


def test_its_sockets_are_open_to_its_group_alone(guest: Boot) -> None:
    found = guest.step("ready")
    assert found["runtime"] == ["0750", *found["ids"]]
    open_to_members = {name for name, may in zip(found["sockets"], found["member_may"], strict=True) if may}
    assert open_to_members == {"control", "targets", "telemetry", "record"}  # ZeroMQ's own are the daemon's alone
    assert not any(found["others_may"])


def test_the_rules_give_it_trackpad_and_board_and_the_hardening_lets_it_open_them(guest: Boot) -> None:
    found = guest.step("ready")
    nodes = [node for node, mode, gid in found["nodes"] if (mode, gid) == ("0660", found["devices_gid"])]
    assert len(nodes) == len(found["nodes"]) == 2
    assert set(nodes) <= set(found["process"]["opened"])
    assert "ID_MM_DEVICE_IGNORE=1" in found["board"], "ModemManager leaves the board alone"


def test_its_loop_alone_has_the_real_time_it_asked_for(guest: Boot) -> None:
    process, real_time = guest.step("driven")["process"], guest.step("driven")["real_time"]
    assert (process["policies"]["true"], process["priority"]) == (FIFO_RESET_ON_FORK, 20)
    assert process["policies"]["false"] == 0
    assert process["locked_kb"] > 0
    assert (real_time["priority"], real_time["processors"], real_time["refused"]) == (20, [0], [])
    assert (real_time["memory_locked"], real_time["stays_awake"]) == (True, True)


@pytest.mark.parametrize("step", ["driven", "back", "killed", "hung", "reloaded"])
def test_the_plate_is_driven_as_the_client_asked(guest: Boot, step: str) -> None:
    found = guest.step(step).get("driven", guest.step(step))
    expect_driven(found["state"]["fingers"])
    assert found["plate_um"] > 0.3  # what the board measures
    assert found["real_time"]["refused"] == []


def test_a_pad_that_is_pulled_under_the_fingers_lifts_them_and_brings_new_ones_later(guest: Boot) -> None:
    """The daemon enables multitouch as the kernel's driver does."""
    assert (guest.step("pulled")["quiet"]["state"], guest.step("pulled")["quiet"]["fingers"]) == ("IDLE", [])
    assert set(guest.step("back")["features"]) == {PADS["mt2-bt"].enable.hex()}
    ids = [{finger["id"] for finger in guest.step(step)["state"]["fingers"]} for step in ("driven", "back")]
    assert not ids[0] & ids[1]
    pad = "trackpad: Magic Trackpad 2 on Bluetooth"
    said = [entry["text"] for entry in lines(guest, pad) if "cannot be opened" not in entry["text"]]
    assert said[:3:2] == [f"{pad} at /dev/hidraw0"] * 2
    assert "was lost" in said[1]


def test_a_touchscreen_drives_the_plate_is_pulled_under_the_fingers_and_found_again(guest: Boot) -> None:
    found = guest.step("touchscreen")
    for plug in found["plugs"]:
        places_mm = sorted((one["x_mm"], one["y_mm"]) for one in plug["state"]["fingers"])
        assert places_mm == [pytest.approx((-20.0, 7.5), abs=0.2), pytest.approx((25.0, -7.5), abs=0.2)]
        expect_driven(plug["state"]["fingers"])
        assert (plug["quiet"]["state"], plug["quiet"]["fingers"]) == ("IDLE", [])
    assert found["exit"] == 0


def test_service_remove_leaves_the_configuration_alone(guest: Boot) -> None:
    found = guest.step("uninstalled")
    assert found["commands"] == AFTER_REMOVAL.splitlines()
    assert found["left"] == ["/etc/hapticd/hapticd.toml"]
    assert found["ActiveState"] != "active"


@each_strike
def test_systemd_starts_it_again_after_the_units_pause(guest: Boot, step: str) -> None:
    before, after = guest.step(step)["before"], guest.step(step)["after"]
    assert int(after["NRestarts"]) == int(before["NRestarts"]) + 1
    assert after["MainPID"] != before["MainPID"]
    (again,) = lines(guest, f"Scheduled restart job, restart counter is at {after['NRestarts']}.")
    ended = [entry for entry in lines(guest, "Main process exited") if entry["t_s"] < again["t_s"]][-1]
    assert 0.25 <= again["t_s"] - ended["t_s"] < 0.75
    assert {"killed": "code=killed, status=9/KILL", "hung": "status=6/ABRT"}[step] in ended["text"]
    assert step == "killed" or lines(guest, "Watchdog timeout (limit 1s)!")[0]["t_s"] < ended["t_s"]


@each_strike
def test_the_board_silences_the_plate_by_itself_until_the_next_daemon_drives_it(guest: Boot, step: str) -> None:
    found = guest.step(step)
    assert 25.0 < found["quiet_after_ms"] < 100.0  # 50 ms after the last frame, 10 ms of ramp, the plate's own decay
    assert found["driven_after_ms"] > found["quiet_after_ms"]
    assert found["driven"]["board"]["deadman_trips"] > guest.step("driven")["board"]["deadman_trips"]


def test_a_reload_refuses_a_wrong_configuration_and_takes_a_sound_one(guest: Boot) -> None:
    found = guest.step("reloaded")
    (line,) = lines(guest, "The present configuration stays.")
    assert "limits.w_limit" in line["text"]
    assert line["priority"] == ERROR
    assert found["after"]["MainPID"] == found["before"]["MainPID"]
    assert found["driven"]["w_limit_um"] == [3.0, 3.0]


def test_it_stops_within_its_time_and_leaves_a_quiet_plate_and_nothing_else(guest: Boot) -> None:
    found = guest.step("stopped")
    assert (found["ActiveState"], found["Result"]) == ("inactive", "success")
    assert found["took_s"] < 2.0
    assert found["quiet_after_ms"] is not None
    assert found["driven_after_ms"] is None
    assert (found["processes"], found["runtime"]) == ([], False)
    (stopping,) = lines(guest, "SIGTERM: stopping")
    assert not [entry for entry in lines(guest, "kill") if entry["t_s"] > stopping["t_s"]]


def test_a_start_on_a_wrong_configuration_fails_once_with_an_error_that_names_the_key(guest: Boot) -> None:
    found = guest.step("misconfigured")
    assert found["exit"] != 0
    assert (found["ActiveState"], found["Result"], found["NRestarts"]) == ("failed", "exit-code", "0")
    (line,) = [entry for entry in lines(guest, "limits.w_limit") if "SIGHUP" not in entry["text"]]
    assert line["priority"] == ERROR


def test_every_line_of_its_own_has_a_priority_and_no_prefix_left(guest: Boot) -> None:
    own = [entry for entry in guest.step("journal") if not entry["by_systemd"]]
    assert {INFO, ERROR} <= {entry["priority"] for entry in own}
    assert not [entry["text"] for entry in own if re.match(r"<\d>|\d\d:\d\d:\d\d", entry["text"])]
