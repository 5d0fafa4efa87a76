"""What the kernel and the distribution grant: udev's rules, groups, real time, a quick clock, a processor awake."""

from __future__ import annotations

import grp
import importlib.util
import os
import pwd
import resource
import sys
from pathlib import Path

from ...errors import HapticdError
from ...io.host.cpu_latency import LATENCY_FILE
from .. import installation
from .finding import PASS, WARN, Finding, Patient

RULES = "71-hapticd.rules"
RULE_FOLDERS = ("etc/udev/rules.d", "run/udev/rules.d", "usr/local/lib/udev/rules.d", "usr/lib/udev/rules.d")
DEVICE_GROUP, CLIENT_GROUP = "hapticd-dev", "hapticd"
CAP_IPC_LOCK, CAP_SYS_NICE = 14, 23  # linux/capability.h
MEMLOCK_BYTES = 512 << 20  # what the service's unit grants
QUICK_CLOCKS = ("tsc", "kvm-clock", "arch_sys_counter", "hyperv_clocksource_tsc_page", "xen")
HAPTICD = Path(sys.executable).with_name("hapticd")  # sudo has a path of its own
INSTALL = f"sudo {HAPTICD} install-service && sudo udevadm control --reload && sudo udevadm trigger"


def rules(patient: Patient) -> Finding:
    """udev's rule, which gives devices to the service and to who sits at the screen."""
    found = next((folder for folder in RULE_FOLDERS if patient.root.joinpath(folder, RULES).is_file()), None)
    if found is None:
        if not (patient.has_pad or patient.has_board):
            return Finding(PASS, "udev rules", "not installed, and not needed for the simulated plate")
        return Finding(WARN, "udev rules", f"{RULES} is not installed", INSTALL)
    try:
        ours = next(file.text for file in installation.service_files() if file.name == RULES)
    except HapticdError as error:
        return Finding(WARN, "udev rules", str(error))
    if patient.text(found, RULES) != ours.strip():
        return Finding(WARN, "udev rules", f"/{found}/{RULES} is not this version's", INSTALL)
    return Finding(PASS, "udev rules", f"/{found}/{RULES}")


def groups(patient: Patient) -> Finding:
    """Whether this user is in the groups that sockets and devices belong to."""
    if os.geteuid() == 0:
        return Finding(PASS, "groups", "root needs none")
    user = _user_name()
    wanted = [CLIENT_GROUP] if patient.root.joinpath("run/hapticd").is_dir() else []
    wanted += [DEVICE_GROUP] if patient.has_pad or patient.has_board else []
    for name in wanted:
        try:
            group = grp.getgrnam(name)
        except KeyError:
            return Finding(WARN, "groups", f"there is no group {name}", "sudo systemd-sysusers, after install-service")
        if group.gr_gid in os.getgroups():
            continue
        if user in group.gr_mem:
            return Finding(WARN, "groups", f"{user} is in {name}, but not in this session", "log out and in again")
        said = f"{user} is not in {name}; whoever sits at the screen gets devices without it"
        return Finding(WARN, "groups", said, f"sudo usermod -aG {name} {user}, then log in again")
    return Finding(PASS, "groups", f"{user} is in {', '.join(wanted)}" if wanted else "none is needed")


def _user_name() -> str:
    try:
        return pwd.getpwuid(os.geteuid()).pw_name
    except KeyError:  # as in containers
        return str(os.geteuid())


def real_time(patient: Patient) -> Finding:
    """Priority, memory, processors awake: what a running daemon was granted, else what this user may ask for."""
    wanted = patient.config.realtime
    granted = patient.told("real_time", "priority")
    if granted is not None:
        refused = patient.told("real_time", "refused") or ()
        if refused:
            return Finding(WARN, "real time", f"the daemon was refused {'; '.join(refused)}", "systemctl cat hapticd")
        return Finding(PASS, "real time", f"the daemon runs at priority {granted}, nothing was refused it")
    if wanted.fifo_priority == 0 and not (wanted.lock_memory or wanted.stay_awake):
        return Finding(PASS, "real time", "not asked for")
    allowed = _limit(resource.RLIMIT_RTPRIO)
    if wanted.fifo_priority > allowed and not _can(patient, CAP_SYS_NICE):
        return Finding(
            WARN,
            "real time",
            f"this user may ask for priority {allowed:g}, not {wanted.fifo_priority}",
            "run it as the service, whose unit grants 20: sudo systemctl start hapticd",
        )
    if wanted.lock_memory and _limit(resource.RLIMIT_MEMLOCK) < MEMLOCK_BYTES and not _can(patient, CAP_IPC_LOCK):
        return Finding(
            WARN,
            "real time",
            f"this user may lock {_limit(resource.RLIMIT_MEMLOCK) / 2**20:g} MiB of memory, not all of it",
            "run it as the service, whose unit grants 512 MiB: sudo systemctl start hapticd",
        )
    latency_file = patient.root / LATENCY_FILE.relative_to("/")
    if wanted.stay_awake and not os.access(latency_file, os.W_OK):
        said = f"this user may not write to {LATENCY_FILE}, so processors will sleep"
        return Finding(WARN, "real time", said, INSTALL)
    asked = [f"priority {wanted.fifo_priority}"] if wanted.fifo_priority > 0 else []
    asked += ["locked memory"] if wanted.lock_memory else []
    asked += ["processors that stay awake"] if wanted.stay_awake else []
    return Finding(PASS, "real time", f"{' and '.join(asked)} may be asked for")


def _limit(which: int) -> float:
    soft, _hard = resource.getrlimit(which)
    return float("inf") if soft == resource.RLIM_INFINITY else float(soft)


def _can(patient: Patient, capability: int) -> bool:
    for line in (patient.text("proc/self/status") or "").splitlines():
        if line.startswith("CapEff:"):
            return bool(int(line.split()[1], 16) >> capability & 1)
    return False


def clock(patient: Patient) -> Finding:
    """The clock behind the monotonic clock: it is read several times a pass."""
    folder = "sys/devices/system/clocksource/clocksource0"
    source = patient.text(folder, "current_clocksource")
    if source is None:
        return Finding(PASS, "clock", "this system does not tell its source")
    if source in QUICK_CLOCKS:
        return Finding(PASS, "clock", source)
    offered = (patient.text(folder, "available_clocksource") or "").split()
    quick = next((one for one in QUICK_CLOCKS if one in offered), None)
    remedy = f"echo {quick} | sudo tee /{folder}/current_clocksource" if quick else "journalctl -k --grep clocksource"
    return Finding(WARN, "clock", f"{source} is slow to read", remedy)


def governor(patient: Patient) -> Finding:
    """How processors are clocked: one that dozes between touches is late for each."""
    folder = patient.root / "sys/devices/system/cpu"
    told = {patient.text(str(path)) for path in folder.glob("cpu*/cpufreq/scaling_governor")}
    found = {name for name in told if name is not None}
    if not found:
        return Finding(PASS, "processor", "its clock is not governed by this system")
    if found == {"performance"}:
        return Finding(PASS, "processor", "governor performance")
    said = f"governor {', '.join(sorted(found))}: passes after a pause take longer"
    return Finding(WARN, "processor", said, "sudo cpupower frequency-set -g performance")


def built(_: Patient) -> Finding:
    """The simulated board's firmware."""
    if importlib.util.find_spec("hapticd.sim.board._firmware") is None:
        return Finding(
            WARN, "simulated board", "its firmware is not built", "sudo apt install gcc, and pip install hapticd again"
        )
    return Finding(PASS, "simulated board", "its firmware is built")


def client_library(_: Patient) -> Finding:
    """What clients of Python import, and this program to ask the daemon."""
    if importlib.util.find_spec("hapticd_client") is None:
        return Finding(WARN, "client library", "not installed here", "pip install clients/python")
    return Finding(PASS, "client library", "installed")
