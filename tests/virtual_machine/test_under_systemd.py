"""hapticd as a service: Debian's systemd is the first process, and runs the unit as `hapticd install-service` puts it.

One boot in QEMU (`machine.py`) runs `guest/service.py` with a virtual trackpad, a board on a virtual USB and a client;
each test judges what one of its steps found. What the unit says is in force to the letter, its time limits too: the
guest's clock counts instructions, so that a busy host delays nothing in it.
"""

from __future__ import annotations

import os
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from machine import Boot

from hapticd.compiled import why_interpreted
from hapticd.tools.install_service import AFTERWARDS

pytestmark = [pytest.mark.long, pytest.mark.timeout(1300)]

UNIT = (Path(__file__).parents[2] / "systemd/hapticd.service").read_text(encoding="utf-8")
FIFO_RESET_ON_FORK = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
SECCOMP_FILTER = ["2"]
ERROR, INFO = 3, 6  # syslog(3)

each_strike = pytest.mark.parametrize("step", ["killed", "hung"])
each_drive = pytest.mark.parametrize("step", ["driven", "killed", "hung", "refused", "reloaded", "flooded"])
each_flood = pytest.mark.parametrize("kind", ["slipping", "crowded"])

MAX_GAP_MS = 250.0  # between two states, in the guest's own time; a flood had 64 ms
MIN_STATES = 25  # of a flood of 2.5 s, in which its reader has the little that the loop leaves of one processor


def seconds(directive: str) -> float:
    """A time span of the unit."""
    found = re.search(rf"^{directive}=(\d+)(ms)?$", UNIT, re.MULTILINE)
    assert found is not None
    return int(found[1]) * (1e-3 if found[2] else 1.0)


def driven(boot: Boot, step: str) -> dict[str, Any]:
    found: dict[str, Any] = boot.step(step)
    return found if step == "driven" else found["driven"]


def lines(boot: Boot, text: str) -> list[dict[str, Any]]:
    """The journal's lines with this in them."""
    return [entry for entry in boot.step("journal") if text in entry["text"]]


def test_what_install_service_says_is_all_that_is_to_be_done(service: Boot) -> None:
    found = service.step("installed")
    assert found["commands"] == AFTERWARDS.splitlines()
    assert (found["ActiveState"], found["SubState"], found["UnitFileState"]) == ("active", "running", "enabled")


def test_the_unit_runs_as_it_is_written_with_nothing_of_the_guests_own(service: Boot) -> None:
    found = service.step("installed")
    assert (found["FragmentPath"], found["DropInPaths"]) == ("/etc/systemd/system/hapticd.service", "")
    assert [found[name] for name in ("WatchdogUSec", "RestartUSec", "TimeoutStopUSec")] == ["1s", "250ms", "2s"]


def test_it_is_ready_when_clients_are_served_and_says_where(service: Boot) -> None:
    assert service.step("ready")["StatusText"] == "serving clients in /run/hapticd"
    (started,) = lines(service, "Started hapticd.service")[:1]
    (serving,) = lines(service, "serving clients in /run/hapticd")[:1]
    assert serving["t_s"] <= started["t_s"]


def test_it_runs_as_a_user_of_its_own_without_any_capability_and_behind_a_filter(service: Boot) -> None:
    found = service.step("ready")
    (uid, gid), process = map(str, found["ids"]), found["process"]
    assert (set(process["Uid"]), set(process["Gid"])) == ({uid}, {gid})
    assert set(process["Groups"]) == {gid, str(found["devices_gid"])}
    assert [int(process[name][0], 16) for name in ("CapEff", "CapBnd")] == [0, 0]
    assert (process["NoNewPrivs"], process["Seccomp"]) == (["1"], SECCOMP_FILTER)


def test_its_compiled_core_runs_where_no_memory_may_be_made_executable(service: Boot) -> None:
    assert service.step("ready")["process"]["runs_compiled"] is (why_interpreted() == "")


def test_clients_in_its_group_reach_its_sockets_and_nobody_else_does(service: Boot) -> None:
    found = service.step("ready")
    assert found["runtime"] == ["0750", *found["ids"]]
    open_to_members = {name for name, may in zip(found["sockets"], found["member_may"], strict=True) if may}
    assert open_to_members == {
        "control",
        "targets",
        "telemetry",
        "record",
    }  # behind them ZeroMQ's own, the daemon's alone
    assert not any(found["stranger_may"])


def test_the_rules_give_it_the_trackpad_and_the_board_and_the_hardening_lets_it_open_them(service: Boot) -> None:
    found = service.step("ready")
    nodes = [node for node, mode, gid in found["nodes"] if (mode, gid) == ("0660", found["devices_gid"])]
    assert len(nodes) == len(found["nodes"]) == 2
    assert set(nodes) <= set(found["process"]["opened"])


def test_its_loop_has_the_real_time_it_asked_for_and_its_other_threads_have_not(service: Boot) -> None:
    process, real_time = driven(service, "driven")["process"], driven(service, "driven")["real_time"]
    assert (process["policies"]["true"], process["priority"]) == (FIFO_RESET_ON_FORK, 20)
    assert process["policies"]["false"] == 0
    assert process["locked_kb"] > 0
    assert (real_time["priority"], real_time["processors"], real_time["refused"]) == (20, [0], [])
    assert (real_time["memory_locked"], real_time["stays_awake"]) == (True, True)


@each_drive
def test_the_plate_is_driven_as_the_client_asked(service: Boot, step: str) -> None:
    found = driven(service, step)
    left, right = sorted(found["state"]["fingers"], key=lambda finger: finger["x_mm"])
    assert left["achieved_um"] == pytest.approx(1.0, abs=0.15)
    assert right["achieved_um"] < 0.6  # of what is not known of a plate
    assert found["plate_um"] > 0.3  # what the board measures
    assert found["real_time"]["refused"] == []


@each_strike
def test_systemd_starts_it_again_after_the_units_pause(service: Boot, step: str) -> None:
    found = service.step(step)
    assert int(found["after"]["NRestarts"]) == int(found["before"]["NRestarts"]) + 1
    assert found["after"]["MainPID"] != found["before"]["MainPID"]
    number = found["after"]["NRestarts"]
    (again,) = lines(service, f"Scheduled restart job, restart counter is at {number}.")
    ended = [entry["t_s"] for entry in lines(service, "Main process exited") if entry["t_s"] < again["t_s"]][-1]
    assert seconds("RestartSec") <= again["t_s"] - ended < seconds("RestartSec") + 0.5


@each_strike
def test_the_board_quiets_the_plate_by_itself_until_the_next_daemon_drives_it(service: Boot, step: str) -> None:
    found = service.step(step)
    assert 25.0 < found["quiet_after_ms"] < 100.0  # 50 ms after the last frame, 10 ms of ramp, the plate's own decay
    assert found["driven_after_ms"] > found["quiet_after_ms"]
    assert found["driven"]["board"]["deadman_trips"] > driven(service, "driven")["board"]["deadman_trips"]


def test_a_daemon_that_was_killed_is_named_in_the_journal(service: Boot) -> None:
    service.step("killed")
    assert lines(service, "Main process exited, code=killed, status=9/KILL")


def test_a_daemon_that_hangs_is_ended_by_the_watchdog(service: Boot) -> None:
    service.step("hung")
    (bitten,) = lines(service, "Watchdog timeout (limit 1s)!")
    ended = next(entry for entry in lines(service, "Main process exited") if entry["t_s"] > bitten["t_s"])
    assert "status=6/ABRT" in ended["text"]


def test_a_configuration_that_is_wrong_is_refused_in_one_line_and_the_old_one_stays(service: Boot) -> None:
    found = service.step("refused")
    (line,) = lines(service, "The present configuration stays.")
    assert "limits.w_limit" in line["text"]
    assert line["priority"] == ERROR
    assert found["after"]["MainPID"] == found["before"]["MainPID"]
    assert found["driven"]["w_limit_um"] == [4.0, 4.0]


def test_a_configuration_that_is_sound_is_taken_by_the_same_process(service: Boot) -> None:
    found = service.step("reloaded")
    assert found["after"]["MainPID"] == found["before"]["MainPID"]
    assert found["driven"]["w_limit_um"] == [3.0, 3.0]


def test_the_dearest_scenes_of_two_users_do_not_end_it(service: Boot) -> None:
    """Without a budget for a pass the kernel kills it at LimitRTTIME, as it never sleeps."""
    found = service.step("flooded")
    assert [found["after"][name] for name in ("MainPID", "NRestarts", "ActiveState")] == [
        found["before"][name] for name in ("MainPID", "NRestarts", "ActiveState")
    ]
    process = found["driven"]["process"]
    demoted = lines(service, "it continues with ordinary priority")
    assert process["policies"]["true"] == (os.SCHED_OTHER if demoted else FIFO_RESET_ON_FORK)


@each_flood
def test_while_two_users_publish_the_dearest_scenes_states_come_and_less_is_computed(service: Boot, kind: str) -> None:
    found = service.step("flooded")[kind]
    instants_ns = found.pop("instants_ns")
    assert len(instants_ns) >= MIN_STATES
    gap_ms = max(after_ns - before_ns for before_ns, after_ns in pairwise(instants_ns)) * 1e-6
    print(f"\n{kind:8}  {len(instants_ns)} states, gap {gap_ms:.1f} ms, {found}")
    assert gap_ms < MAX_GAP_MS
    assert found["left_out_knots"] + found["left_out_fingers"] > 0


def test_a_loop_that_messages_keep_busy_takes_breaths(service: Boot) -> None:
    assert service.step("flooded")["crowded"]["throttled"] > 0


def test_it_stops_within_its_time_and_leaves_a_quiet_plate_and_nothing_else(service: Boot) -> None:
    found = service.step("stopped")
    assert (found["ActiveState"], found["Result"]) == ("inactive", "success")
    assert found["took_s"] < seconds("TimeoutStopSec")
    assert found["quiet_after_ms"] is not None
    assert found["driven_after_ms"] is None
    assert (found["processes"], found["runtime"]) == ([], False)
    (stopping,) = lines(service, "SIGTERM: stopping")
    assert not [
        entry for entry in service.step("journal") if entry["t_s"] > stopping["t_s"] and "kill" in entry["text"]
    ]


def test_a_start_on_a_configuration_that_is_wrong_fails_once_with_an_error_that_names_the_key(service: Boot) -> None:
    found = service.step("misconfigured")
    assert found["exit"] != 0
    assert (found["ActiveState"], found["Result"], found["NRestarts"]) == ("failed", "exit-code", "0")
    (line,) = [entry for entry in lines(service, "limits.w_limit") if "SIGHUP" not in entry["text"]]
    assert line["priority"] == ERROR


def test_every_line_of_its_own_has_a_priority_and_no_prefix_left(service: Boot) -> None:
    own = [entry for entry in service.step("journal") if not entry["by_systemd"]]
    assert {INFO, ERROR} <= {entry["priority"] for entry in own}
    assert not [entry["text"] for entry in own if re.match(r"<\d>|\d\d:\d\d:\d\d", entry["text"])]
    assert {entry["priority"] for entry in own if "trackpad: Magic Trackpad" in entry["text"]} == {INFO}
