"""What runs under systemd in the guest: hapticd is installed as a user would, touched, its pad pulled and plugged in;
it is hung, given another configuration, stopped, given nonsense, started on a touchscreen, and uninstalled. Each step
of `Rig` is a test of `test_under_systemd.py` outside.
"""

from __future__ import annotations

import math
import os
import re
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import board
import manager
from board import PORT
from kernel import PATIENCE_S, hidraw_of, wait_for
from manager import lines
from pad import HID_ID, BluetoothPad, RestingFingers
from plate import MOVES_UM, RESTS_UM, is_as_asked, measured_um, wait_state
from touchscreen import Touchscreen

from hapticd.compiled import why_interpreted
from hapticd.tools.install_service import AFTER_REMOVAL, AFTERWARDS
from hapticd.wire.trackpad import PADS
from hapticd_client import Client, PlateState

HERE, RESULTS = Path(__file__).parent, Path("/run/results")
LASTS_NS = 20_000_000  # of a plate at rest; references that pass through zero are shorter
PROGRAM = "/opt/hapticd/bin/hapticd"
CONFIG, OWN_CONFIG = Path("/etc/hapticd/hapticd.toml"), Path("/run/touchscreen.toml")
RUNTIME = Path("/run/hapticd")
TRACE = Path("/run/board-trace")
PLACES = {1: (-824, 275), 2: (1317, -386)}  # raw, of two fingers on the pad
PLACES_MM = [(-20.0, 7.5), (25.0, -7.5)]  # and on the touchscreen
OTHER_USER = 64445
PRIORITY = 20
SCREEN = "virtual touchscreen"
PLATE = f"""
[plate]
modes_file = "/etc/hapticd/modes.npz"
[device]
port = "{PORT}"
"""
CONFIGURATION = f"""{PLATE}
[trackpad]
source = "hid"
[limits]
w_limit_um = [LIMIT, LIMIT]
[realtime]
fifo_priority = {PRIORITY}
processor = 0
"""
NONSENSE = "[limits]\nw_limit = 3\n"
ERROR, INFO = 3, 6  # syslog(3)


class Rig:
    """What the steps share. Each is a method, in order."""

    def __init__(self) -> None:
        board.plug_in()
        self._pad = BluetoothPad()
        wait_for("the board's two ends", lambda: PORT.exists() and board.GADGET_END.exists())
        process = subprocess.Popen([sys.executable, HERE / "board.py", TRACE])
        os.sched_setscheduler(process.pid, os.SCHED_FIFO, os.sched_param(PRIORITY + 1))  # it has its own processor
        self._hidraw = hidraw_of(HID_ID)
        self._fingers: RestingFingers | None = None
        self._client: Client | None = None
        self._finger_ids: set[int] = set()
        self._trips = 0

    def installed(self) -> None:
        """The commands that `service install` prints start the unit as it is written."""
        printed = manager.run(f"{PROGRAM} service install")
        CONFIG.write_text(configuration(4.0), encoding="utf-8")
        CONFIG.with_name("modes.npz").write_bytes((HERE / "modes.npz").read_bytes())
        expect(_run_what_is_said(printed), AFTERWARDS.splitlines())
        found = manager.facts()
        expect([found[name] for name in ("ActiveState", "SubState", "UnitFileState")], ["active", "running", "enabled"])
        expect((found["FragmentPath"], found["DropInPaths"]), ("/etc/systemd/system/hapticd.service", ""))
        expect([found[name] for name in ("WatchdogUSec", "RestartUSec", "TimeoutStopUSec")], ["1s", "250ms", "2s"])

    def ready(self) -> None:
        """When clients are served, it says where."""
        found = manager.facts()
        expect(found["StatusText"], f"serving clients in {RUNTIME}")
        serving, started = (lines(text)[0]["t_s"] for text in ("serving clients in", "Started hapticd.service"))
        assert serving <= started

    def confined(self) -> None:
        """A user of its own without capabilities, behind a filter; the core compiled, where no memory may be made
        executable."""
        process = self._process()
        uid, gid = (manager.run(f"id {which} hapticd").strip() for which in ("-u", "-g"))
        devices = manager.run("getent group hapticd-dev").split(":")[2]
        expect((set(process["Uid"]), set(process["Gid"])), ({uid}, {gid}))
        expect(set(process["Groups"]), {gid, devices})
        expect([int(process[name][0], 16) for name in ("CapEff", "CapBnd")], [0, 0])
        expect((process["NoNewPrivs"], process["Seccomp"]), (["1"], ["2"]))
        expect(process["runs_compiled"], why_interpreted() == "")

    def sockets(self) -> None:
        """Open to its group alone; ZeroMQ's own are the daemon's."""
        status = RUNTIME.stat()
        expect(status.st_mode & 0o7777, 0o750)
        nodes = sorted(entry for entry in RUNTIME.iterdir() if entry.is_socket())
        open_to_members = {node.name for node in nodes if _may_write(f"--groups={status.st_gid}", node)}
        expect(open_to_members, {"control", "targets", "telemetry", "record"})
        assert not any(_may_write("--clear-groups", node) for node in nodes)

    def nodes(self) -> None:
        """The rules give it trackpad and board, and the hardening lets it open them; ModemManager leaves them alone."""
        devices = int(manager.run("getent group hapticd-dev").split(":")[2])
        for node in (PORT, self._hidraw):
            expect((node.stat().st_mode & 0o777, node.stat().st_gid), (0o660, devices))
            assert str(node) in self._process()["opened"]
        assert "ID_MM_DEVICE_IGNORE=1" in manager.run(f"udevadm info --query=property --name={PORT}")

    def driven(self) -> None:
        """As the client asked; the loop alone has the real time that it asked for."""
        self._finger_ids = self._drive()
        process, real_time = self._process(), self._status()["real_time"]
        expect((process["policies"][True], process["priority"]), (os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, PRIORITY))
        expect(process["policies"][False], 0)
        assert process["locked_kb"] > 0
        expect((real_time["priority"], real_time["processors"]), (PRIORITY, [0]))
        expect((real_time["memory_locked"], real_time["stays_awake"]), (True, True))
        self._trips = self._status()["board"]["deadman_trips"]

    def pulled(self) -> None:
        """Under the fingers, which lift; the next plug brings new ones. The daemon enables multitouch as the kernel's
        driver does."""
        assert self._fingers is not None
        assert self._client is not None
        self._fingers.freeze()
        self._fingers = None
        self._pad.unplug()
        _expect_silence(self._client)
        self._pad = BluetoothPad()
        wait_for("two enables, the driver's and the daemon's", lambda: len(self._pad.features) >= 2)
        assert not self._drive() & self._finger_ids
        expect(set(self._pad.features), {PADS["mt2-bt"].enable})
        pad = "trackpad: Magic Trackpad 2 on Bluetooth"
        said = [entry["text"] for entry in lines(pad) if "cannot be opened" not in entry["text"]]
        expect(said[:3:2], [f"{pad} at /dev/hidraw0"] * 2)
        assert "was lost" in said[1]

    def hung(self) -> None:
        """The board silences the plate by itself, the watchdog ends the daemon, and systemd starts it again after the
        unit's pause."""
        before, t_struck_ns = manager.facts(), time.monotonic_ns()
        os.kill(int(before["MainPID"]), signal.SIGSTOP)
        after = manager.wait_restarted(before)
        expect(int(after["NRestarts"]), int(before["NRestarts"]) + 1)
        assert after["MainPID"] != before["MainPID"]
        (again,) = lines(f"Scheduled restart job, restart counter is at {after['NRestarts']}.")
        ended = [entry for entry in lines("Main process exited") if entry["t_s"] < again["t_s"]][-1]
        assert 0.25 <= again["t_s"] - ended["t_s"] < 0.75
        assert "status=6/ABRT" in ended["text"]
        assert lines("Watchdog timeout (limit 1s)!")
        self._drive()
        silent_ms, driven_ms = _motion_since(t_struck_ns)
        assert silent_ms is not None
        assert 25.0 < silent_ms < 100.0, silent_ms  # 50 ms after the last frame, 10 ms of ramp, the plate's own decay
        assert driven_ms is not None
        assert driven_ms > silent_ms
        assert self._status()["board"]["deadman_trips"] > self._trips

    def reloaded(self) -> None:
        """With another configuration, by the same process."""
        before = manager.facts()
        CONFIG.write_text(configuration(3.0), encoding="utf-8")
        manager.run("systemctl reload hapticd")
        lines("applying the new configuration")
        self._drive()
        expect(manager.facts()["MainPID"], before["MainPID"])
        assert self._client is not None
        expect(list(self._client.plate()["w_limit_um"]), [3.0, 3.0])

    def stopped(self) -> None:
        """Within its time, the plate silent, and nothing left."""
        uid = int(manager.run("id -u hapticd"))
        t_asked_ns = time.monotonic_ns()
        manager.run("systemctl stop hapticd")
        assert time.monotonic_ns() - t_asked_ns < 2 * 10**9
        expect([manager.facts()[name] for name in ("ActiveState", "Result")], ["inactive", "success"])
        silent_ms, driven_ms = _motion_since(t_asked_ns)
        assert silent_ms is not None
        assert driven_ms is None
        assert not [entry for entry in Path("/proc").glob("[0-9]*") if entry.stat().st_uid == uid]
        assert not RUNTIME.exists()
        (stopping,) = lines("SIGTERM: stopping")
        assert not [entry for entry in manager.journal() if "kill" in entry["text"] and entry["t_s"] > stopping["t_s"]]

    def misconfigured(self) -> None:
        """A start fails once, with an error that names the key."""
        CONFIG.write_text(NONSENSE, encoding="utf-8")
        assert subprocess.run(["systemctl", "start", "hapticd"], capture_output=True).returncode != 0
        found = manager.facts()
        expect([found[name] for name in ("ActiveState", "Result", "NRestarts")], ["failed", "exit-code", "0"])
        (line,) = lines("limits.w_limit")
        expect(line["priority"], ERROR)

    def touchscreen(self) -> None:
        """The daemon as root, for the rules open no touchscreen: pulled under the fingers, and plugged in again."""
        OWN_CONFIG.write_text(f'{PLATE}[trackpad]\nsource = "evdev"\ndevice = "{SCREEN}"\n', encoding="utf-8")
        daemon = subprocess.Popen(
            [PROGRAM, "run", "--config", OWN_CONFIG], env={**os.environ, "HAPTICD_RUNTIME_DIR": str(RUNTIME)}
        )
        wait_for("its sockets", lambda: (RUNTIME / "control").exists())
        client = self._new_client()
        for _ in range(2):
            screen = Touchscreen(SCREEN)
            fingers = RestingFingers(lambda frame, screen=screen: screen.touch(PLACES_MM, frame))
            found = sorted((finger.x_mm, finger.y_mm) for finger in _driven(client).fingers)
            for place_mm, asked_mm in zip(found, PLACES_MM, strict=True):
                assert math.dist(place_mm, asked_mm) < 0.3, place_mm
            fingers.freeze()
            screen.unplug()
            _expect_silence(client)
        client.close()
        daemon.terminate()
        expect(daemon.wait(PATIENCE_S), 0)

    def uninstalled(self) -> None:
        """The configuration stays."""
        manager.run("systemctl disable hapticd")
        expect(_run_what_is_said(manager.run(f"{PROGRAM} service remove")), AFTER_REMOVAL.splitlines())
        left = [path for folder in ("systemd", "udev", "hapticd") for path in Path("/etc", folder).rglob("*hapticd*")]
        expect(left, [CONFIG])
        assert manager.facts()["ActiveState"] != "active"

    def logged(self) -> None:
        """Every line of its own has a priority, and no prefix is left."""
        own = [entry for entry in manager.journal() if not entry["by_systemd"]]
        assert {INFO, ERROR} <= {entry["priority"] for entry in own}
        expect([entry["text"] for entry in own if re.match(r"<\d>|\d\d:\d\d:\d\d", entry["text"])], [])

    def _drive(self) -> set[int]:
        """Two fingers land, and a client gives them opposite targets until the board measures it. They stay, and the
        plate moves on."""
        if self._fingers is None:
            pad = self._pad
            self._fingers = RestingFingers(lambda _: pad.touch(PLACES))
        state = _driven(self._new_client())
        expect(self._status()["real_time"]["refused"], [])
        return {finger.id for finger in state.fingers}

    def _new_client(self) -> Client:
        if self._client is not None:
            self._client.close()
        self._client = Client(RUNTIME, timeout_s=PATIENCE_S)
        return self._client

    def _status(self) -> dict[str, Any]:
        assert self._client is not None
        return self._client.status()

    def _process(self) -> dict[str, Any]:
        return manager.process(int(manager.facts()["MainPID"]))


def expect(found: object, wanted: object) -> None:
    assert found == wanted, f"{found}, not {wanted}"


def configuration(limit_um: float) -> str:
    return CONFIGURATION.replace("LIMIT", str(limit_um))


def _run_what_is_said(printed: str) -> list[str]:
    commands = [line.strip() for line in printed.partition("then run:\n")[2].splitlines()]
    for command in commands:
        manager.run(command)
    return commands


def _driven(client: Client) -> PlateState:
    """The state once the plate is driven as asked, and moves by what the board measures."""
    state = wait_state(
        client, "a plate that is driven", lambda state: is_as_asked(client, state) and measured_um(client) > MOVES_UM
    )
    left, right = sorted(state.fingers, key=lambda finger: finger.x_mm)
    assert abs(left.achieved_um - 1.0) <= 0.15, left
    assert right.achieved_um < 0.6, right  # of what is not known of a plate
    return state


def _expect_silence(client: Client) -> None:
    state = wait_state(client, "a silent plate", lambda state: not state.fingers and not any(state.modal_um))
    wait_for("a plate at rest", lambda: measured_um(client) < RESTS_UM)
    expect(state.state, "IDLE")


def _may_write(groups: str, path: Path) -> bool:
    who = f"setpriv --reuid={OTHER_USER} --regid={OTHER_USER} {groups}"
    return subprocess.run([*who.split(), "test", "-w", path]).returncode == 0


def _motion_since(t_ns: int) -> tuple[float | None, float | None]:
    """From the plate itself: after how long it was quiet, and after how long it moved again; None if it did not."""
    lines = (line.split() for line in TRACE.read_text(encoding="ascii").splitlines()[:-1])
    rows = [(int(t), float(um)) for t, um in lines]
    t_quiet_ns = None
    for t, um in rows:
        if t > t_ns and um >= RESTS_UM:
            t_quiet_ns = None  # it only passed through zero
        elif t > t_ns and t_quiet_ns is None:
            t_quiet_ns = t
        elif t_quiet_ns is not None and t - t_quiet_ns >= LASTS_NS:
            break
    t_again_ns = next((t for t, um in rows if t_quiet_ns is not None and t > t_quiet_ns and um > MOVES_UM), None)
    t_silent_ms, t_again_ms = (None if t is None else (t - t_ns) * 1e-6 for t in (t_quiet_ns, t_again_ns))
    return t_silent_ms, t_again_ms


def run(name: str, step: Callable[[], object]) -> bool:
    """Keep how it failed, and the journal; False if it did."""
    print(f"guest: {name}", flush=True)
    error = ""
    try:
        step()
    except Exception:
        said = "\n".join(entry["text"] for entry in manager.journal())
        error = f"{traceback.format_exc()}\nthe daemon said:\n{said}"
    (RESULTS / name).write_text(error, encoding="utf-8")
    return not error


def main() -> None:
    rigs: list[Rig] = []
    if run("plugged", lambda: rigs.append(Rig())):
        for name in (name for name in vars(Rig) if not name.startswith("_")):
            if not run(name, getattr(rigs[0], name)):
                break


if __name__ == "__main__":
    main()
