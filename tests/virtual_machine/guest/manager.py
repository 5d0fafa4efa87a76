"""The service as systemd has it: its properties, its processes, its journal."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

from kernel import wait_for

UNIT = "hapticd.service"
POLL_S = 0.3  # each look is a process, and an emulated processor has better to do
FACTS = (
    "ActiveState", "SubState", "Result", "MainPID", "NRestarts", "User", "FragmentPath", "DropInPaths", "StatusText",
    "WatchdogUSec", "RestartUSec", "TimeoutStopUSec", "UnitFileState",
)  # fmt: skip


def run(command: str) -> str:
    """What it prints. RuntimeError with its own words if it fails."""
    done = subprocess.run(command.split(), capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(f"{command}: {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


def facts() -> dict[str, str]:
    """What `systemctl show` says of the unit."""
    lines = run(f"systemctl show {UNIT} --property={','.join(FACTS)}").splitlines()
    return dict(line.split("=", 1) for line in lines)


def wait_restarted(before: dict[str, str]) -> dict[str, str]:
    """Its facts once it was restarted once more, and is ready."""

    def look() -> dict[str, str] | None:
        now = facts()
        return now if now["ActiveState"] == "active" and now["NRestarts"] != before["NRestarts"] else None

    return wait_for("a restarted service", look, POLL_S)


def process(pid: int) -> dict[str, Any]:
    """What the kernel says of its main process: ids, rights, memory held, and each thread's policy and priority."""
    lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    status = dict(line.split(":\t", 1) for line in lines if ":\t" in line)
    threads = [int(task) for task in os.listdir(f"/proc/{pid}/task")]
    return {
        **{
            name: status[name].split() for name in ("Uid", "Gid", "Groups", "CapEff", "CapBnd", "NoNewPrivs", "Seccomp")
        },
        "locked_kb": int(status["VmLck"].split()[0]),
        "nice": os.getpriority(os.PRIO_PROCESS, pid),
        "policies": {tid == pid: os.sched_getscheduler(tid) for tid in sorted(threads, reverse=True)},
        "priority": os.sched_getparam(pid).sched_priority,
        "runs_compiled": "__mypyc." in Path(f"/proc/{pid}/maps").read_text(encoding="utf-8"),
        "opened": sorted({os.readlink(entry) for entry in Path(f"/proc/{pid}/fd").iterdir()}),
    }


def journal() -> list[dict[str, Any]]:
    """Every line of the service and about it: priority, text, the instant in s, and whether systemd says it."""
    lines = run(f"journalctl --unit {UNIT} --output json --no-pager --all").splitlines()
    return [_entry(json.loads(line)) for line in lines]


def _entry(entry: dict[str, Any]) -> dict[str, Any]:
    return {
        "text": entry["MESSAGE"],
        "priority": int(entry["PRIORITY"]),
        "t_s": int(entry["__MONOTONIC_TIMESTAMP"]) * 1e-6,
        "by_systemd": entry.get("_PID") == "1",
    }


def lines(text: str) -> list[dict[str, Any]]:
    """The journal's lines with this in them, once there is one."""
    return wait_for(f"{text!r} in the journal", lambda: [one for one in journal() if text in one["text"]], POLL_S)
