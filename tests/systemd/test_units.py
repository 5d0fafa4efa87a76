"""The service files: systemd accepts the unit, little is left to it, and rules and configuration fit the program."""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

from hapticd.config import loader as config
from hapticd.config.sections import SIMULATED, Config
from hapticd.errors import ConfigError
from hapticd.io.host.cpu_latency import LATENCY_FILE
from hapticd.tools.service import MAX_DESCRIPTORS
from hapticd.wire.trackpad import PADS
from hapticd.wire.trackpad.pad import BLUETOOTH

FOLDER = Path(__file__).parents[2] / "systemd"
UNIT = FOLDER / "hapticd.service"
RULES = FOLDER / "71-hapticd.rules"
CONFIGURATION = FOLDER / "hapticd.toml"
TCP = FOLDER / "tcp.conf"

MAX_EXPOSURE = 1.0  # of 10; bare units have 9.6
MAX_EXPOSURE_TCP = 1.6  # a network of its own, without any, is what it cannot have then

needs_systemd = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")


def directives(name: str) -> list[str]:
    """The values of one key of the unit, in order."""
    return re.findall(rf"^{name}=(.*)$", UNIT.read_text(encoding="utf-8"), re.MULTILINE)


def analyze(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["systemd-analyze", "--no-pager", *map(str, arguments)], capture_output=True, text=True, timeout=60, check=False
    )


@needs_systemd
@pytest.mark.parametrize(("drop_in", "max_exposure"), [("", MAX_EXPOSURE), (TCP.read_text("utf-8"), MAX_EXPOSURE_TCP)])
def test_systemd_accepts_unit_and_drop_in_and_leaves_them_next_to_nothing(
    drop_in: str, max_exposure: float, tmp_path: Path
) -> None:
    """With a program that exists on every machine, for systemd looks whether it does; a drop-in's lines come last."""
    unit = tmp_path / UNIT.name
    text = re.sub(r"^ExecStart=\S+", "ExecStart=/bin/true", UNIT.read_text("utf-8"), flags=re.MULTILINE)
    unit.write_text(f"{text}\n{drop_in}", encoding="utf-8")
    verified = analyze("verify", unit)
    assert (verified.returncode, verified.stderr) == (0, "")  # an unknown key is only a line on stderr
    judged = analyze("security", "--offline=true", f"--threshold={round(max_exposure * 10)}", unit)
    assert judged.returncode == 0, judged.stdout[-300:]


def test_the_only_folder_that_it_may_write_is_the_configurations_for_recordings() -> None:
    (name,) = directives("StateDirectory")
    assert f'# file = "/var/lib/{name}/session.mcap"' in CONFIGURATION.read_text(encoding="utf-8")


def test_the_drop_in_opens_the_three_ports_of_one_address_range_and_no_more() -> None:
    lines = [line for line in TCP.read_text(encoding="utf-8").splitlines() if "=" in line and not line.startswith("#")]
    opened = dict(line.split("=", 1) for line in lines)
    assert (opened["SocketBindDeny"], opened["SocketBindAllow"]) == ("any", "tcp:7410-7412")
    assert "any" not in opened["IPAddressAllow"].split()
    assert "IPAddressDeny" not in opened  # the unit's own, any, stays


DIRECTIVES = {
    "IPAddressDeny": ["any"],
    "ProtectSystem": ["strict"],
    "ReadWritePaths": [],
    "ExecStart": ["/opt/hapticd/bin/hapticd run --config /etc/hapticd/hapticd.toml"],
    "Type": ["notify"],
    "NotifyAccess": ["main"],
    "WatchdogSec": ["1"],
    "ExecReload": ["/bin/kill -HUP $MAINPID"],
    "RestartPreventExitStatus": [str(ConfigError.exit_code)],  # a wrong configuration is not started again
    "SyslogLevel": ["err"],  # of last words
    "LimitNOFILE": [str(MAX_DESCRIPTORS)],  # of all clients together
    "RestrictRealtime": [],
    "LimitRTPRIO": ["20"],
    "LimitMEMLOCK": directives("MemoryMax"),  # mlockall counts address space, not what is touched
    "DevicePolicy": ["closed"],
    "DeviceAllow": [
        "char-hidraw rw", "char-ttyACM rw", "char-ttyUSB rw", "/dev/ptmx rw", "char-pts rw", f"{LATENCY_FILE} w"
    ],
    "RestrictAddressFamilies": ["AF_UNIX AF_NETLINK"],
}  # fmt: skip


def test_the_unit_grants_what_the_daemon_needs_and_nothing_else() -> None:
    assert {name: directives(name) for name in DIRECTIVES} == DIRECTIVES
    soft_us, hard_us = map(int, directives("LimitRTTIME")[0].split(":"))  # of a loop that never sleeps
    assert soft_us < hard_us <= 200_000
    calls = {call for listed in directives("SystemCallFilter") for call in listed.split()}
    assert {"sched_setscheduler", "sched_setaffinity"} <= calls


def test_every_user_and_group_named_is_made_by_sysusers() -> None:
    sysusers = (FOLDER / "hapticd.sysusers.conf").read_text(encoding="utf-8")
    made = set(re.findall(r"^[ug] (\S+)", sysusers, re.MULTILINE))
    owners = set(re.findall(r'GROUP="([^"]+)"', RULES.read_text(encoding="utf-8")))
    assert owners == {"hapticd-dev"}
    assert owners | set(directives("User")) | set(directives("SupplementaryGroups")) == made


def rule_lines() -> list[str]:
    lines = RULES.read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def test_rules_are_lists_of_matches_and_assignments() -> None:
    term = r'[A-Z]+(\{\w+\})?(==|=|\+=)"[^"]*"'
    assert rule_lines()
    for line in rule_lines():
        assert re.fullmatch(rf"{term}(, {term})*", line), line
        assert 'MODE="0660"' in line
        assert 'TAG+="uaccess"' in line
    assert RULES.name < "73-seat-late.rules"  # which acts on the tag


def test_rules_open_the_trackpads_that_the_daemon_looks_for_and_no_others() -> None:
    usb, bluetooth = set(), set()
    for line in rule_lines():
        if (vendor := re.search(r'ATTRS\{idVendor\}=="(\w+)"', line)) and "hidraw" in line:
            products = re.search(r'ATTRS\{idProduct\}=="([^"]+)"', line)
            assert products is not None
            usb |= {(int(vendor[1], 16), int(product, 16)) for product in products[1].split("|")}
        for kernel_name in re.findall(
            r"0005:[0-9A-F]{4}:[0-9A-F]{4}\.\*", line
        ):  # the kernel writes them in upper case
            bluetooth.add((int(kernel_name[5:9], 16), int(kernel_name[10:14], 16)))
    known = {(ids.bus == BLUETOOTH, (ids.vendor_id, ids.product_id)) for pad in PADS.values() if (ids := pad.ids)}
    assert usb == {ids for is_bluetooth, ids in known if not is_bluetooth}
    assert bluetooth == {ids for is_bluetooth, ids in known if is_bluetooth}
    (board,) = [line for line in rule_lines() if "ttyACM" in line]
    assert 'ENV{ID_MM_DEVICE_IGNORE}="1"' in board, "ModemManager leaves it alone"


def test_the_configuration_runs_the_simulated_plate_as_it_stands() -> None:
    loaded = config.load(CONFIGURATION)
    assert (loaded.trackpad.source, loaded.device.port) == (SIMULATED, SIMULATED)
    assert loaded == Config()


def test_the_configuration_s_lines_for_a_real_plate_are_valid_too(tmp_path: Path) -> None:
    text = CONFIGURATION.read_text(encoding="utf-8")
    text = re.sub(r'^(source|port) = "sim"\n', "", text, flags=re.MULTILINE)
    text = re.sub(r"^# (\w+ = )", r"\1", text, flags=re.MULTILINE)
    (tmp_path / "modes.npz").touch()
    (tmp_path / "hapticd.toml").write_text(text, encoding="utf-8")
    loaded = config.load(tmp_path / "hapticd.toml")
    assert (loaded.trackpad.source, loaded.device.port) == ("hid", "/dev/ttyACM0")
    table = tomllib.loads(text)
    assert all(table[section] for section in table)
