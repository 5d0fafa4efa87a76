"""What runs under systemd in the guest: hapticd is installed as a user would, touched, its pad pulled and plugged in;
it is killed, hung, given other configurations, stopped, started on a touchscreen, and uninstalled. Steps only look;
`test_under_systemd.py` outside judges.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import board
import manager
import msgspec
from board import PORT
from kernel import PATIENCE_S, access, hidraw_of, wait_for
from pad import HID_ID, BluetoothPad, RestingFingers
from plate import MOVES_UM, RESTS_UM, is_as_asked, measured_um, wait_state
from touchscreen import Touchscreen

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
Found = dict[str, Any]


class Rig:
    """What the steps share."""

    def __init__(self) -> None:
        board.plug_in()
        self._pad = BluetoothPad()
        wait_for("the board's two ends", lambda: PORT.exists() and board.GADGET_END.exists())
        process = subprocess.Popen([sys.executable, HERE / "board.py", TRACE])
        os.sched_setscheduler(process.pid, os.SCHED_FIFO, os.sched_param(PRIORITY + 1))  # it has its own processor
        self._hidraw = hidraw_of(HID_ID)
        self._fingers: RestingFingers | None = None
        self._client: Client | None = None

    def steps(self) -> Iterator[tuple[str, Callable[[], Found]]]:
        yield "installed", self._install
        yield "ready", self._ready
        yield "driven", self._drive
        yield "pulled", self._pull
        yield "back", self._plug_in
        yield "killed", lambda: self._strike(signal.SIGKILL)
        yield "hung", lambda: self._strike(signal.SIGSTOP)
        yield "reloaded", self._reload
        yield "stopped", self._stop
        yield "misconfigured", self._start_on_nonsense
        yield "touchscreen", self._touchscreen
        yield "uninstalled", self._uninstall

    def _install(self) -> Found:
        """The README's way: `hapticd service install`, a configuration, and what it says is to be run then."""
        printed = manager.run(f"{PROGRAM} service install")
        CONFIG.write_text(configuration(4.0), encoding="utf-8")
        CONFIG.with_name("modes.npz").write_bytes((HERE / "modes.npz").read_bytes())
        return {"commands": _run_what_is_said(printed), **manager.facts()}

    def _ready(self) -> Found:
        facts = manager.facts()
        status = RUNTIME.stat()
        sockets = sorted(entry for entry in RUNTIME.iterdir() if entry.is_socket())
        member, other = f"--groups={status.st_gid}", "--clear-groups"
        return {
            **facts,
            "process": manager.process(int(facts["MainPID"])),
            "runtime": [f"{status.st_mode & 0o7777:04o}", status.st_uid, status.st_gid],
            "ids": [int(manager.run(f"id {which} hapticd")) for which in ("-u", "-g")],
            "devices_gid": int(manager.run("getent group hapticd-dev").split(":")[2]),
            "nodes": [access(PORT), access(self._hidraw)],
            "board": manager.run(f"udevadm info --query=property --name={PORT}"),
            "sockets": [entry.name for entry in sockets],
            "member_may": [_may_write(member, entry) for entry in sockets],
            "others_may": [_may_write(other, entry) for entry in sockets],
        }

    def _drive(self) -> Found:
        """Two fingers land; a client gives them opposite targets, and looks until the board measures it. It stays, and
        the plate moves on."""
        if self._fingers is None:
            pad = self._pad
            self._fingers = RestingFingers(lambda _: pad.touch(PLACES))
        return _driven(self._new_client()) | self._saw()

    def _pull(self) -> Found:
        """Under the fingers."""
        assert self._fingers is not None
        assert self._client is not None
        self._fingers.freeze()
        self._fingers = None
        self._pad.unplug()
        return {"quiet": _quiet(self._client)}

    def _plug_in(self) -> Found:
        self._pad = BluetoothPad()
        wait_for("two enables, the driver's and the daemon's", lambda: len(self._pad.features) >= 2)
        return self._drive() | {"features": [feature.hex() for feature in self._pad.features]}

    def _strike(self, number: signal.Signals) -> Found:
        before = manager.facts()
        t_struck_ns = time.monotonic_ns()
        os.kill(int(before["MainPID"]), number)
        after = manager.wait_restarted(before)
        return {"before": before, "after": after, "driven": self._drive(), **_motion_since(t_struck_ns)}

    def _reload(self) -> Found:
        """With nonsense first, which changes nothing."""
        before = manager.facts()
        for text, answer in (
            (NONSENSE, "configuration stays."),
            (configuration(3.0), "applying the new configuration"),
        ):
            CONFIG.write_text(text, encoding="utf-8")
            manager.run("systemctl reload hapticd")
            manager.wait_said(answer)
        return {"before": before, "after": manager.facts(), "driven": self._drive()}

    def _stop(self) -> Found:
        uid = int(manager.run("id -u hapticd"))
        t_asked_ns = time.monotonic_ns()
        manager.run("systemctl stop hapticd")
        took_s = (time.monotonic_ns() - t_asked_ns) * 1e-9
        return {
            **manager.facts(),
            "took_s": took_s,
            "processes": [entry.name for entry in Path("/proc").glob("[0-9]*") if entry.stat().st_uid == uid],
            "runtime": RUNTIME.exists(),
            **_motion_since(t_asked_ns),
        }

    def _start_on_nonsense(self) -> Found:
        CONFIG.write_text(NONSENSE, encoding="utf-8")
        started = subprocess.run(["systemctl", "start", "hapticd"], capture_output=True)
        return {"exit": started.returncode, **manager.facts()}

    def _touchscreen(self) -> Found:
        """The daemon as root, for the rules open no touchscreen: pulled under the fingers, and plugged in again."""
        OWN_CONFIG.write_text(f'{PLATE}[trackpad]\nsource = "evdev"\ndevice = "{SCREEN}"\n', encoding="utf-8")
        daemon = subprocess.Popen(
            [PROGRAM, "run", "--config", OWN_CONFIG], env={**os.environ, "HAPTICD_RUNTIME_DIR": str(RUNTIME)}
        )
        wait_for("its sockets", lambda: (RUNTIME / "control").exists())
        found, client = [], self._new_client()
        for _ in range(2):
            screen = Touchscreen(SCREEN)
            fingers = RestingFingers(lambda frame, screen=screen: screen.touch(PLACES_MM, frame))
            driven = _driven(client)
            fingers.freeze()
            screen.unplug()
            found.append(driven | {"quiet": _quiet(client)})
        client.close()
        daemon.terminate()
        return {"plugs": found, "exit": daemon.wait(PATIENCE_S)}

    def _uninstall(self) -> Found:
        manager.run("systemctl disable hapticd")
        commands = _run_what_is_said(manager.run(f"{PROGRAM} service remove"))
        left = [
            str(path) for folder in ("systemd", "udev", "hapticd") for path in Path("/etc", folder).rglob("*hapticd*")
        ]
        return {"commands": commands, "left": left, **manager.facts()}

    def _new_client(self) -> Client:
        if self._client is not None:
            self._client.close()
        self._client = Client(RUNTIME, timeout_s=PATIENCE_S)
        return self._client

    def _saw(self) -> Found:
        assert self._client is not None
        status = self._client.status()
        return {
            "real_time": status["real_time"],
            "board": status["board"],
            "w_limit_um": self._client.plate()["w_limit_um"],
            "process": manager.process(int(manager.facts()["MainPID"])),
        }


def configuration(limit_um: float) -> str:
    return CONFIGURATION.replace("LIMIT", str(limit_um))


def _run_what_is_said(printed: str) -> list[str]:
    commands = [line.strip() for line in printed.partition("then run:\n")[2].splitlines()]
    for command in commands:
        manager.run(command)
    return commands


def _driven(client: Client) -> Found:
    moved_um = 0.0

    def moves(state: PlateState) -> bool:
        nonlocal moved_um
        moved_um = measured_um(client) if is_as_asked(client, state) else 0.0
        return moved_um > MOVES_UM

    state = wait_state(client, "a plate that is driven and moves", moves)
    return {"state": msgspec.to_builtins(state), "plate_um": moved_um}


def _quiet(client: Client) -> Found:
    state = wait_state(client, "a quiet plate", lambda state: not state.fingers and not any(state.modal_um))
    wait_for("a plate at rest", lambda: measured_um(client) < RESTS_UM)
    return msgspec.to_builtins(state)


def _may_write(groups: str, path: Path) -> bool:
    who = f"setpriv --reuid={OTHER_USER} --regid={OTHER_USER} {groups}"
    return subprocess.run([*who.split(), "test", "-w", path]).returncode == 0


def _motion_since(t_ns: int) -> dict[str, float | None]:
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
    instants = {"quiet_after_ms": t_quiet_ns, "driven_after_ms": t_again_ns}
    return {name: None if t is None else (t - t_ns) * 1e-6 for name, t in instants.items()}


def step(name: str, look: Callable[[], Any]) -> bool:
    """Run it and keep what it found, or how it failed and the journal; False if it failed."""
    print(f"guest: {name}", flush=True)
    found, error = None, None
    try:
        found = look()
    except Exception:
        log = "\n".join(entry["text"] for entry in manager.journal())
        error = f"{traceback.format_exc()}\nthe daemon said:\n{log}"
    (RESULTS / f"{name}.json").write_text(json.dumps({"found": found, "error": error}, default=str))
    return error is None


def main() -> None:
    rigs: list[Rig] = []
    if step("plugged", lambda: rigs.append(Rig())):
        for name, look in rigs[0].steps():
            if not step(name, look):
                break
    step("journal", manager.journal)


if __name__ == "__main__":
    main()
