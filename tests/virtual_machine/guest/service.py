"""What runs under systemd in the guest: hapticd is installed as a user would, touched, killed, hung, given other
configurations, flooded, and stopped. `test_under_systemd.py` outside judges.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import manager
import msgpack
import msgspec
import zmq
from bluetooth import BluetoothPad
from cable import CableBoard
from dear import KINDS, published
from hand import Hand
from kernel import PATIENCE_S, Node, touch_node, wait_for
from plate import MOVES_UM, RESTS_UM, is_as_asked, measured_um, wait_state
from steps import step

from hapticd_client import Client, PlateState

HERE = Path(__file__).parent
LASTS_NS = 20_000_000  # of a plate at rest; references that pass through zero are shorter
PROGRAM = "/opt/hapticd/bin/hapticd"
CONFIG = Path("/etc/hapticd/hapticd.toml")
RUNTIME = Path("/run/hapticd")
PORT, GADGET_END, TRACE = Path("/dev/ttyACM0"), Path("/dev/ttyGS0"), Path("/run/board-trace")
LEFT, RIGHT = (-824, 275), (1317, -386)
STRANGER = 64445
PRIORITY = 20
FLOOD_S = 2.5
CONFIGURATION = f"""
[plate]
modes_file = "modes.npz"
[trackpad]
source = "hid"
[device]
port = "{PORT}"
[limits]
w_limit_um = [LIMIT, LIMIT]
[realtime]
fifo_priority = {PRIORITY}
processor = 0
lock_memory = true
stay_awake = true
"""
NONSENSE = "[limits]\nw_limit = 3\n"


class Story:
    """What the steps share."""

    def __init__(self) -> None:
        self._plug = CableBoard(0x0483, 0x5740)
        self._pad = BluetoothPad(0x004C, 0x0265)
        wait_for("the board's two ends", lambda: PORT.exists() and GADGET_END.exists())
        self._board = subprocess.Popen([sys.executable, HERE / "board.py", GADGET_END, TRACE])
        os.sched_setscheduler(self._board.pid, os.SCHED_FIFO, os.sched_param(PRIORITY + 1))  # it has its own processor
        self._node: Node = touch_node("0005:004C:0265")
        self._hand: Hand | None = None
        self._client: Client | None = None

    def steps(self) -> Iterator[tuple[str, Callable[[], dict[str, Any]]]]:
        yield "installed", self._install
        yield "ready", self._ready
        yield "driven", self._drive
        yield "killed", lambda: self._strike(signal.SIGKILL)
        yield "hung", lambda: self._strike(signal.SIGSTOP)
        yield "refused", lambda: self._reload(NONSENSE, "The present configuration stays.")
        yield "reloaded", lambda: self._reload(configuration(3.0), "applying the new configuration")
        yield "flooded", self._flood
        yield "stopped", self._stop
        yield "misconfigured", self._start_on_nonsense

    def _install(self) -> dict[str, Any]:
        """The README's way: `hapticd install-service`, a configuration, and what it says is to be run then."""
        printed = manager.run(f"{PROGRAM} install-service")
        CONFIG.write_text(configuration(4.0), encoding="utf-8")
        CONFIG.with_name("modes.npz").write_bytes((HERE / "modes.npz").read_bytes())
        commands = [line.strip() for line in printed.partition("then run:\n")[2].splitlines()]
        for command in commands:
            manager.run(command)
        return {"commands": commands, **manager.facts()}

    def _ready(self) -> dict[str, Any]:
        facts = manager.facts()
        status = RUNTIME.stat()
        sockets = sorted(entry for entry in RUNTIME.iterdir() if entry.is_socket())
        member, stranger = f"--groups={status.st_gid}", "--clear-groups"
        return {
            **facts,
            "process": manager.process(int(facts["MainPID"])),
            "runtime": [f"{status.st_mode & 0o7777:04o}", status.st_uid, status.st_gid],
            "ids": [int(manager.run(f"id {which} hapticd")) for which in ("-u", "-g")],
            "devices_gid": int(manager.run("getent group hapticd-dev").split(":")[2]),
            "nodes": [_access(PORT), _access(self._node.hidraw)],
            "sockets": [entry.name for entry in sockets],
            "member_may": [_may_write(member, entry) for entry in sockets],
            "stranger_may": [_may_write(stranger, entry) for entry in sockets],
        }

    def _drive(self) -> dict[str, Any]:
        """Two fingers land; a client gives them opposite targets, and looks until the board measures it. It stays, and
        the plate moves on."""
        if self._hand is None:
            self._hand = Hand(self._pad, {1: LEFT, 2: RIGHT})
        if self._client is not None:
            self._client.close()
        self._client = client = Client(timeout_s=PATIENCE_S)
        moves = lambda state: is_as_asked(client, state) and measured_um(client) > MOVES_UM  # noqa: E731
        return self._saw(client, wait_state(client, "a plate that is driven and moves", moves))

    def _strike(self, number: signal.Signals) -> dict[str, Any]:
        before = manager.facts()
        t_struck_ns = time.monotonic_ns()
        os.kill(int(before["MainPID"]), number)
        after = manager.wait_restarted(before)
        return {"before": before, "after": after, "driven": self._drive(), **_motion_since(t_struck_ns)}

    def _reload(self, text: str, answer: str) -> dict[str, Any]:
        before = manager.facts()
        CONFIG.write_text(text, encoding="utf-8")
        manager.run("systemctl reload hapticd")
        manager.wait_said(answer)
        return {"before": before, "after": manager.facts(), "driven": self._drive()}

    def _flood(self) -> dict[str, Any]:
        """Two users publish the dearest scenes. The fingers are no client's, so that they feel surfaces and effects."""
        assert self._client is not None
        self._client.close()
        self._client = client = Client(timeout_s=PATIENCE_S)
        before, then, kinds = manager.facts(), client.status(), {}
        for kind in KINDS:
            with published(kind, RUNTIME):
                instants_ns = _instants_ns(FLOOD_S)
            now = client.status()
            kinds[kind] = {"instants_ns": instants_ns, **_counted(then, now)}
            then = now
        return {"before": before, **kinds, "after": manager.facts(), "driven": self._drive()}

    def _stop(self) -> dict[str, Any]:
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

    def _start_on_nonsense(self) -> dict[str, Any]:
        CONFIG.write_text(NONSENSE, encoding="utf-8")
        started = subprocess.run(["systemctl", "start", "hapticd"], capture_output=True)
        return {"exit": started.returncode, **manager.facts()}

    def _saw(self, client: Client, state: PlateState) -> dict[str, Any]:
        status = client.status()
        return {
            "state": msgspec.to_builtins(state),
            "plate_um": measured_um(client),
            "real_time": status["real_time"],
            "board": status["board"],
            "w_limit_um": client.plate()["w_limit_um"],
            "process": manager.process(int(manager.facts()["MainPID"])),
        }


def configuration(limit_um: float) -> str:
    return CONFIGURATION.replace("LIMIT", str(limit_um))


def _instants_ns(seconds: float) -> list[int]:
    """The instants of all states that come in this time: none from a service that has ended."""
    t_end_s, found = time.monotonic() + seconds, []
    with zmq.Context() as context, context.socket(zmq.SUB) as states:
        states.subscribe(b"")
        states.connect(f"ipc://{RUNTIME}/telemetry")
        while (left_s := t_end_s - time.monotonic()) > 0.0:
            if states.poll(1e3 * left_s):
                found.append(msgpack.unpackb(states.recv())["t_ns"])
    return found


def _counted(before: dict[str, Any], after: dict[str, Any]) -> dict[str, int]:
    """How much its counters of what was too dear have grown."""
    names = {"touch": ("passes", "left_out_knots", "left_out_fingers"), "timing": ("overruns", "throttled")}
    return {name: after[part][name] - before[part][name] for part, several in names.items() for name in several}


def _access(node: Path) -> list[str | int]:
    status = node.stat()
    return [str(node), f"{status.st_mode & 0o777:04o}", status.st_gid]


def _may_write(groups: str, path: Path) -> bool:
    who = f"setpriv --reuid={STRANGER} --regid={STRANGER} {groups}"
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


def main() -> None:
    log = lambda: "\n".join(entry["text"] for entry in manager.journal())  # noqa: E731
    stories: list[Story] = []
    if step("plugged", lambda: stories.append(Story()) or "both", log):
        for name, look in stories[0].steps():
            if step(name, look, log) is None:
                break
    step("journal", manager.journal, log)


if __name__ == "__main__":
    main()
