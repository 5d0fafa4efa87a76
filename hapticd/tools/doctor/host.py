"""Checks of the host: udev rules, groups, real-time limits, clock source, frequency governor, installed parts."""

from __future__ import annotations

import grp
import importlib.util
import os
import pwd
import resource

from ...errors import HapticdError, rebuild
from ...io.host.cpu_latency import LATENCY_FILE
from ..install_service import DESTINATIONS, service_files, service_folder
from .finding import PASS, WARN, CheckResult, System

RULES = "71-hapticd.rules"
RULE_FOLDERS = ("etc/udev/rules.d", "run/udev/rules.d", "usr/local/lib/udev/rules.d", "usr/lib/udev/rules.d")
DEVICE_GROUP, CLIENT_GROUP = "hapticd-dev", "hapticd"
CAP_IPC_LOCK, CAP_SYS_NICE = 14, 23  # linux/capability.h
MEMLOCK_BYTES = 512 << 20  # granted by the service's unit
FAST_CLOCKS = ("tsc", "kvm-clock", "arch_sys_counter", "hyperv_clocksource_tsc_page", "xen")
USERS = "hapticd.sysusers.conf"


def _copied(name: str) -> str:
    """Return the command that installs a file of the service, also where no service may run, as in a home."""
    return f"sudo install -D -m 644 {service_folder() / name} /{DESTINATIONS[name]}"


INSTALL = f"{_copied(RULES)} && sudo udevadm control --reload && sudo udevadm trigger"


def rules(system: System) -> CheckResult:
    """Check the udev rule that gives devices to the service and to the user logged in at the screen."""
    found = next((folder for folder in RULE_FOLDERS if system.root.joinpath(folder, RULES).is_file()), None)
    if found is None:
        if not system.has_ruled_device:
            return CheckResult(PASS, "not installed, and not needed for these devices")
        return CheckResult(WARN, f"{RULES} is not installed", INSTALL)
    try:
        ours = service_files()[RULES]
    except HapticdError as error:
        return CheckResult(WARN, str(error))
    if system.text(found, RULES) != ours.strip():
        return CheckResult(WARN, f"/{found}/{RULES} is not this version's", INSTALL)
    return CheckResult(PASS, f"/{found}/{RULES}")


def groups(system: System) -> CheckResult:
    """Check that this user is in the groups of sockets and devices."""
    if os.geteuid() == 0:
        return CheckResult(PASS, "root needs none")
    user = _user_name()
    needed = [CLIENT_GROUP] if system.root.joinpath("run/hapticd").is_dir() else []
    needed += [DEVICE_GROUP] if system.has_ruled_device else []
    for name in needed:
        try:
            group = grp.getgrnam(name)
        except KeyError:
            return CheckResult(WARN, f"group {name} does not exist", f"{_copied(USERS)} && sudo systemd-sysusers")
        if group.gr_gid in os.getgroups():
            continue
        if user in group.gr_mem:
            return CheckResult(WARN, f"{user} is in {name}, but not in this session", "log out and in again")
        text = f"{user} is not in {name}, which only the user logged in at the screen does not need"
        return CheckResult(WARN, text, f"sudo usermod -aG {name} {user}, then log in again")
    return CheckResult(PASS, f"{user} is in {', '.join(needed)}" if needed else "none is needed")


def _user_name() -> str:
    try:
        return pwd.getpwuid(os.geteuid()).pw_name
    except KeyError:  # as in containers
        return str(os.geteuid())


def real_time(system: System) -> CheckResult:
    """Check priority, locked memory and CPU latency: as granted to the daemon, else the limits of this user."""
    requested = system.config.realtime
    granted = system.reported("real_time", "priority")
    if granted is not None:
        refused = system.reported("real_time", "refused") or ()
        if refused:
            return CheckResult(WARN, f"the system refused the daemon: {'; '.join(refused)}", "systemctl cat hapticd")
        return CheckResult(PASS, f"the daemon runs at priority {granted}, with all it requested")
    if requested.fifo_priority == 0:
        return CheckResult(PASS, "not configured")
    allowed = _limit(resource.RLIMIT_RTPRIO)
    if requested.fifo_priority > allowed and not _can(system, CAP_SYS_NICE):
        return CheckResult(
            WARN,
            f"this user is limited to priority {allowed:g}, the configuration requests {requested.fifo_priority}",
            "run it as the service, whose unit grants 20: sudo systemctl start hapticd",
        )
    if _limit(resource.RLIMIT_MEMLOCK) < MEMLOCK_BYTES and not _can(system, CAP_IPC_LOCK):
        return CheckResult(
            WARN,
            f"this user may lock {_limit(resource.RLIMIT_MEMLOCK) / 2**20:g} MiB of memory, not enough for all of it",
            "run it as the service, whose unit grants 512 MiB: sudo systemctl start hapticd",
        )
    latency_file = system.root / LATENCY_FILE.relative_to("/")
    if not os.access(latency_file, os.W_OK):
        text = f"this user may not write to {LATENCY_FILE}, so processors enter sleep states"
        return CheckResult(WARN, text, INSTALL)
    return CheckResult(PASS, f"priority {requested.fifo_priority} is within this user's limits")


def _limit(which: int) -> float:
    soft, _hard = resource.getrlimit(which)
    return float("inf") if soft == resource.RLIM_INFINITY else float(soft)


def _can(system: System, capability: int) -> bool:
    for line in (system.text("proc/self/status") or "").splitlines():
        if line.startswith("CapEff:"):
            return bool(int(line.split()[1], 16) >> capability & 1)
    return False


def clock(system: System) -> CheckResult:
    """Check the source of the monotonic clock, which is read several times per pass."""
    folder = "sys/devices/system/clocksource/clocksource0"
    source = system.text(folder, "current_clocksource")
    if source is None:
        return CheckResult(PASS, "its source is not reported by this system")
    if source in FAST_CLOCKS:
        return CheckResult(PASS, source)
    offered = (system.text(folder, "available_clocksource") or "").split()
    fast = next((one for one in FAST_CLOCKS if one in offered), None)
    remedy = f"echo {fast} | sudo tee /{folder}/current_clocksource" if fast else "journalctl -k --grep clocksource"
    return CheckResult(WARN, f"{source} is slow to read", remedy)


def governor(system: System) -> CheckResult:
    """Check the frequency governor: a processor clocked down between touches delays each first pass."""
    folder = system.root / "sys/devices/system/cpu"
    names = {system.text(str(path)) for path in folder.glob("cpu*/cpufreq/scaling_governor")}
    found = {name for name in names if name is not None}
    if not found:
        return CheckResult(PASS, "no frequency governor")
    if found == {"performance"}:
        return CheckResult(PASS, "governor performance")
    text = f"governor {', '.join(sorted(found))}: passes after a pause take longer"
    return CheckResult(WARN, text, "sudo cpupower frequency-set -g performance")


def built(_: System) -> CheckResult:
    """Check the simulated board's firmware."""
    if importlib.util.find_spec("hapticd.sim.board._firmware") is None:
        return CheckResult(
            WARN, "its firmware is not built", f"sudo apt install build-essential python3-dev, then {rebuild()}"
        )
    return CheckResult(PASS, "its firmware is built")
