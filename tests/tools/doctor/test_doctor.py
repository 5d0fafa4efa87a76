"""Each check of the doctor, and a fix for every finding that is no pass."""

from __future__ import annotations

import asyncio
import fcntl
import json
import resource
import socket
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from clients.fake_daemon import FakeDaemon
from input_node import AXES, FakeNode
from virtual_board import BoardLink, in_virtual_time

from hapticd import __version__
from hapticd.__main__ import main
from hapticd.board_values import BoardCalibration, ModeCalibration
from hapticd.config import loader as config
from hapticd.config.sections import Config
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.errors import DeviceError, HapticdError
from hapticd.files import calibration
from hapticd.io.devices import input_nodes
from hapticd.io.host.realtime import Granted
from hapticd.sim.fingers.paths import Rest
from hapticd.sim.fingers.sensor import SensorModel
from hapticd.tools import pads
from hapticd.tools.doctor import devices, files, host, program, service
from hapticd.tools.doctor.finding import FAIL, PASS, WARN, CheckResult, System
from hapticd.tools.doctor.program import CHECKS
from hapticd.values import RawReport
from hapticd.wire.trackpad import DEFAULT_PAD
from hapticd.wire.trackpad.evdev import POSITION_X, POSITION_Y


def examined(text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    path = tmp_path / "hapticd.toml"
    path.write_text(text, encoding="utf-8")
    return program.examine(path), capsys.readouterr().out


def system(tmp_path: Path, status: Any = None, version: str = __version__, **sections: dict[str, Any]) -> System:
    """A system with these sections of a configuration, and `tmp_path` as its file system."""
    made = config.from_table(dict(sections), where="test", folder=None)
    return System(made, tmp_path, status, version, tmp_path)


def put(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


@pytest.fixture(autouse=True)
def _nothing_of_this_host(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Hide daemons and pads of this host."""
    monkeypatch.setattr(service, "directories", lambda _: (tmp_path,))
    monkeypatch.setattr(devices, "load_hid", lambda: None)
    monkeypatch.setattr(devices, "find_pads", lambda *_: iter(()))
    monkeypatch.setattr(pads, "connected", lambda _: Pad([], (None, "no trackpad is connected")))


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rate of reports is not waited for."""
    monkeypatch.setattr(devices, "LISTEN_S", 0.0)
    monkeypatch.setattr(devices, "LOOK_EVERY_S", 0.01)


REAL = {"device": {"port": "/dev/ttyACM7"}, "trackpad": {"source": "hid"}, "plate": {"modes_file": "modes.npz"}}


def test_the_simulated_plate_has_no_failure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, output = examined("", tmp_path, capsys)
    assert code == 0
    assert "FAIL" not in output
    assert f"warn  daemon: none runs in {tmp_path}" in output
    assert output.count("\npass") + output.count("\nwarn") == len(CHECKS)


def test_after_a_bad_configuration_no_other_check_runs_and_the_report_can_be_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "hapticd.toml"
    path.write_text("[limits]\nw_limit = 3\n", encoding="utf-8")
    assert main(["doctor", "--config", str(path), "--json"]) == 1
    output = json.loads(capsys.readouterr().out)
    assert output["failed"]
    ((finding),) = output["findings"]
    assert (finding["verdict"], finding["check"]) == ("FAIL", "configuration")
    assert "did you mean w_limit_um?" in finding["text"]
    assert finding["remedy"]


def test_another_configuration_of_the_service_is_reported(tmp_path: Path) -> None:
    assert program.configured(None, tmp_path).verdict == PASS
    put(tmp_path / "etc/hapticd/hapticd.toml", "")
    found = program.configured(None, tmp_path)
    assert (found.verdict, found.remedy) == (WARN, f"hapticd doctor --config {tmp_path}/etc/hapticd/hapticd.toml")
    assert program.configured(tmp_path / "mine.toml", tmp_path).verdict == PASS


# --- files ---


def test_a_missing_board_fails_with_its_remedy(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    axis_mm = np.linspace(-60.0, 60.0, 9)
    shapes = np.stack(np.meshgrid(axis_mm, axis_mm)) / 60.0
    ModeShapes.from_grid(axis_mm, axis_mm, shapes).save(tmp_path / "modes.npz")
    text = f'[device]\nport = "{tmp_path}/none"\n[trackpad]\nsource = "replay"\ndevice = "modes.npz"\n'
    code, output = examined(text + '[plate]\nmodes_file = "modes.npz"\n', tmp_path, capsys)
    assert code == 1
    assert f"FAIL  board: {tmp_path}/none does not exist\n      -> plug the board in" in output
    assert "warn  calibration: none" in output
    assert "warn  firmware: not checked" in output
    (tmp_path / "modes.npz").write_text("nothing", encoding="utf-8")
    assert "FAIL  mode shapes:" in examined('[plate]\nmodes_file = "modes.npz"\n', tmp_path, capsys)[1]


BOTH_MODES = tuple(ModeCalibration(mode, 29195.0 + 20 * mode, 500.0, 4.0, 0.0) for mode in (0, 1))


def test_a_calibration_is_read_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "plate.toml"
    section = {"calibration_file": str(path)}
    assert files.calibrated(system(tmp_path, device=section)).verdict == FAIL
    calibration.save(path, BoardCalibration(BOTH_MODES[:1]))
    assert "has 1 of 2 modes" in files.calibrated(system(tmp_path, device=section)).text
    calibration.save(path, BoardCalibration(BOTH_MODES))
    found = files.calibrated(system(tmp_path, device=section))
    assert (found.verdict, found.text) == (PASS, f"{path}: modes at 29195.0, 29215.0 Hz")


def test_what_the_self_test_found_is_part_of_the_calibration(tmp_path: Path) -> None:
    path = tmp_path / "plate.toml"
    calibration.save(path, BoardCalibration(BOTH_MODES))
    real = {**REAL, "device": {"calibration_file": str(path), "port": "/dev/ttyACM0"}}
    for outcome, verdict in (("passed", PASS), ("running", PASS), ("moved", WARN), ("unknown", WARN), ("unsafe", FAIL)):
        status = {"board": {"self_test": {"outcome": outcome, "text": "the result"}, "refused": "the result"}}
        found = files.calibrated(system(tmp_path, status, **real))
        assert (found.verdict, "self-test: the result" in found.text) == (verdict, True)
        assert ("firmware selftest --port /dev/ttyACM0 --calibration" in found.remedy) is (verdict != PASS)
        assert devices.firmware(system(tmp_path, status)).remedy == "see calibration above"


def test_recordings_need_a_folder_and_room(tmp_path: Path) -> None:
    section = {"file": str(tmp_path / "none" / "s.mcap"), "max_mb": 1}
    missing = files.recordings(system(tmp_path, record=section))
    assert (missing.verdict, missing.remedy) == (FAIL, f"mkdir -p {tmp_path / 'none'}")
    section["file"] = str(tmp_path / "s.mcap")
    assert files.recordings(system(tmp_path, record=section)).verdict == PASS
    section["max_mb"] = 1_000_000
    assert files.recordings(system(tmp_path, record=section)).verdict == WARN


# --- the daemon ---


def test_a_stale_socket_is_not_a_daemon_and_a_lock_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(service, "ANSWER_S", 0.05)
    with socket.socket(socket.AF_UNIX) as left_behind, (tmp_path / "lock").open("wb") as lock:
        left_behind.bind(str(tmp_path / "control"))
        output = examined("", tmp_path, capsys)[1]
        assert f"warn  daemon: none runs in {tmp_path} (the socket there is stale" in output
        fcntl.flock(lock, fcntl.LOCK_EX)
        code, output = examined("", tmp_path, capsys)
        assert code == 1
        assert f"FAIL  daemon: one holds {tmp_path / 'lock'}, but does not answer" in output
        assert "fuser -v" in output


def test_a_daemon_that_answers_is_asked_for_its_status(
    tmp_path: Path, daemon: FakeDaemon, reported: dict[str, Any]
) -> None:
    daemon.status = reported
    found = service.find(Config(), {}, str(tmp_path))
    assert service.daemon(found) == CheckResult(PASS, f"version {__version__} answers in {tmp_path}")
    assert service.health(found).text == "ACTIVE: touched"
    assert devices.firmware(found).text == "version 9.9, at 921600 baud, reported to the daemon"
    older = service.daemon(replace(found, version="0.0.9"))
    assert (older.verdict, "0.0.9" in older.text, "restart" in older.remedy) == (WARN, True, True)
    lacking = devices.firmware(replace(found, status={"board": {"ready": False, "lacking": "it sends no STATUS"}}))
    assert (lacking.verdict, lacking.text) == (WARN, "it sends no STATUS")


def test_a_daemon_in_a_directory_that_others_may_have_made_is_not_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(service, "TEMPORARY", tmp_path.parent)
    monkeypatch.setattr(service, "directories", lambda _: (tmp_path,))
    tmp_path.chmod(0o777)
    with socket.socket(socket.AF_UNIX) as control:
        control.bind(str(tmp_path / "control"))
        control.listen()
        control.setblocking(False)
        found = service.find(Config(), {})
        with pytest.raises(BlockingIOError):
            control.accept()
    assert (found.status, found.directory) == (None, tmp_path)
    finding = service.daemon(found)
    assert (finding.verdict, "other users may write to it" in finding.text) == (FAIL, True)


def test_a_directory_without_access_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    closed = tmp_path / "closed"
    closed.mkdir()
    monkeypatch.setattr(service, "directories", lambda _: (tmp_path, closed))
    monkeypatch.setattr(service.os, "access", lambda path, _: path != closed)
    found = service.daemon(service.find(Config(), {}))
    assert (found.verdict, found.text) == (FAIL, f"{closed} is not accessible to this user")
    assert "usermod -aG hapticd" in found.remedy


@pytest.mark.parametrize(("state", "verdict"), [("FAULT", FAIL), ("IDLE", WARN), ("ARMED", PASS)])
def test_the_daemon_s_state_is_judged_with_its_reason(tmp_path: Path, state: str, verdict: str) -> None:
    found = service.health(system(tmp_path, {"state": state, "state_changes": [{"why": "the cause"}]}))
    assert (found.verdict, found.text) == (verdict, f"{state}: the cause")


@pytest.mark.parametrize(
    ("source", "counted"), [("trackpad", "reports_left_out"), ("board", "left_out"), ("clients", "too_fast")]
)
def test_what_each_source_sent_too_fast_is_named(source: str, counted: str, tmp_path: Path) -> None:
    counters = {source: {counted: 7, "gone_early": 3}}
    quiet = {"state": "ARMED", "inputs": {"trackpad": {"left_out": 0}}, "clients": {"too_fast": 0}}
    assert service.health(system(tmp_path, quiet)).verdict == PASS
    found = service.health(system(tmp_path, quiet | (counters if source == "clients" else {"inputs": counters})))
    assert found.verdict == WARN
    assert f"7 ({source} {counted.replace('_', ' ')})" in found.text
    assert "3 (" not in found.text


def test_a_second_daemon_elsewhere_is_found_by_its_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = tmp_path / "other"
    put(other / "lock", "")
    monkeypatch.setattr(service, "directories", lambda _: (tmp_path, other))
    assert service.alone(system(tmp_path)).verdict == PASS
    with (other / "lock").open("rb") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        found = service.alone(system(tmp_path))
    assert found.verdict == WARN
    assert str(other) in found.text


# --- devices ---


def test_a_missing_pad_and_a_port_of_another_group_fail(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    port = tmp_path / "ttyACM7"
    port.touch()
    monkeypatch.setattr(devices, "is_accessible", lambda _: False)
    assert devices.trackpad(system(tmp_path, **REAL)).text == "none is connected"
    found = devices.board(system(tmp_path, **{**REAL, "device": {"port": str(port)}}))
    assert (found.verdict, found.text) == (FAIL, f"{port} cannot be opened by this user")
    assert f"usermod -aG {port.group()} " in found.remedy


def touched(seed: int, seconds: float) -> list[RawReport]:
    reports = SensorModel(seed=seed).reports([Rest((0.0, 0.0))], seconds)
    return [RawReport(round(report.t_arrive_s * 1e9), report.data) for report in reports]


class Pad:
    """A source that gives what it is given, at once."""

    def __init__(self, reports: list[RawReport], link: tuple[Any, str] = (DEFAULT_PAD, "here")) -> None:
        self._reports, self._link = reports, link

    def start(self, loop: asyncio.AbstractEventLoop, on_reports: Any, on_link: Any) -> None:
        loop.call_soon(on_link, *self._link)
        loop.call_soon(on_reports, self._reports)

    @property
    def counters(self) -> dict[str, int | str]:
        return {}

    def request_enable(self) -> None: ...

    async def close(self) -> None: ...


SCREEN = {**REAL, "trackpad": {"source": "evdev"}}


def evdev_found(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, found: object = None, **trackpad: object
) -> CheckResult:
    """The check of the touch device, where this is what the search finds."""

    def find(*_: object) -> Iterator[object]:
        if isinstance(found, OSError):
            raise found
        yield from () if found is None else (found,)

    monkeypatch.setattr(input_nodes, "find_nodes", find)
    return devices.trackpad(system(tmp_path, **{**SCREEN, "trackpad": {"source": "evdev", **trackpad}}))


def test_a_touchscreen_is_reported_with_its_size_and_contacts(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    found = evdev_found(monkeypatch, tmp_path, FakeNode())
    assert (found.verdict, found.text) == (PASS, "screen at /dev/input/event7: 400 x 200 mm, 10 contacts")
    without_slots = {code: AXES[code] for code in (POSITION_X, POSITION_Y)}
    assert "without numbers (protocol A)" in str(evdev_found(monkeypatch, tmp_path, FakeNode(without_slots)))


def test_what_is_wrong_with_a_touchscreen_is_said_with_its_fix(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "event0").touch()
    monkeypatch.setattr(input_nodes, "FOLDER", tmp_path)
    refused = evdev_found(monkeypatch, tmp_path, PermissionError(13, "Permission denied"), device="/dev/input/event7")
    assert "/dev/input/event7 cannot be opened (Permission denied)" in str(refused)
    assert "usermod -aG input" in str(refused)
    gone = evdev_found(monkeypatch, tmp_path, FileNotFoundError(2, "No such file"), device="/dev/input/event7")
    assert "plug it in" in gone.remedy
    assert "no device named 'wall'" in str(evdev_found(monkeypatch, tmp_path, device="wall"))
    assert "no device that reports contacts" in str(evdev_found(monkeypatch, tmp_path))
    monkeypatch.setattr(devices, "is_readable", lambda _: False)
    assert "none that this user may read" in str(evdev_found(monkeypatch, tmp_path))
    sizeless = AXES | {POSITION_X: AXES[POSITION_X]._replace(resolution=0)}
    assert "set trackpad.size_mm" in str(evdev_found(monkeypatch, tmp_path, FakeNode(sizeless)))


@pytest.mark.parametrize(
    ("source", "package", "library"), [("evdev", "evdev", "evdev"), ("tuio", "pythonosc", "python-osc>=1.10")]
)
def test_a_source_whose_package_is_missing_names_what_installs_it(
    source: str, package: str, library: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    found = devices.trackpad(system(tmp_path, **{**REAL, "trackpad": {"source": source, "size_mm": [400.0, 200.0]}}))
    assert found.verdict == FAIL
    assert f"{source} needs the extra " in found.text
    assert library in found.remedy


def test_a_trackers_address_is_free_or_is_not(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{other.getsockname()[1]}"
        tracker = {**REAL, "trackpad": {"source": "tuio", "device": address, "size_mm": [400.0, 200.0]}}
        taken = devices.trackpad(system(tmp_path, **tracker))
    assert (taken.verdict, taken.text) == (FAIL, f"{address} cannot be bound (Address already in use)")
    assert devices.trackpad(system(tmp_path, **tracker)).verdict == PASS
    assert devices.trackpad(system(tmp_path, {"state": "IDLE"}, **tracker)).verdict == PASS


@pytest.mark.parametrize(
    ("counted", "verdict", "named"),
    [
        ({}, PASS, "awaited"),
        ({"frames": 90, "contacts": 0, "other_profiles": 90, "sender": "127.0.0.1 port 9"}, PASS, "127.0.0.1 port 9"),
        ({"frames": 90, "contacts": 90, "other_sender": 400}, WARN, "400 other sender"),
        ({"other_address": 1, "refused_address": "192.0.2.7"}, WARN, "192.0.2.7"),
        ({"frames": 0, "unended": 9}, WARN, "each datagram is alone"),
        ({"frames": 9, "outside": 9}, WARN, "(0 to 1)"),
        ({"frames": 9, "hovering": 9}, WARN, "above the surface"),
        ({"other_profiles": 9, "foreign": 9}, WARN, "objects and no fingers"),
        ({"length": 9}, WARN, "4096 bytes"),
        ({"foreign": 9}, WARN, "TUIO 1.1 or 2.0"),
    ],
)
def test_what_a_tracker_sends_is_judged_by_the_daemons_counters(
    counted: dict[str, int | str], verdict: str, named: str, tmp_path: Path
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as daemons:
        daemons.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{daemons.getsockname()[1]}"
        tracker = {**REAL, "trackpad": {"source": "tuio", "device": address, "size_mm": [400.0, 200.0]}}
        found = devices.trackpad(system(tmp_path, {"state": "ACTIVE", "inputs": {"trackpad": counted}}, **tracker))
    assert (found.verdict, bool(found.remedy)) == (verdict, verdict == WARN)
    assert named in found.text


def test_without_a_daemon_the_pad_itself_is_measured() -> None:
    assert devices.listen(Pad(touched(1, 0.5)), 0.001) == pytest.approx(88.9, rel=0.03)
    assert devices.listen(Pad([]), 0.001) is None
    with pytest.raises(HapticdError, match="no trackpad is connected"):
        devices.listen(Pad([], (None, "no trackpad is connected")), 0.001)


@pytest.mark.parametrize(
    ("counters", "expected_hz"),
    [
        ([0, 20, 40, 60, 80], 80.0),
        ([5, 5, 5, 5, 5], None),
        ([0, 3, 23, 43, 63, 83, 95, 95, 95], 80.0),  # a finger came and went
        ([7], None),
        ([], None),
        ([90, 100, 0, 20, 40], 80.0),  # another daemon
    ],
)
def test_a_counter_s_rate_is_that_of_its_longest_unbroken_run(counters: list[int], expected_hz: float | None) -> None:
    samples = [(k * 250_000_000, count) for k, count in enumerate(counters)]
    rate_hz = devices.steady_rate_hz(samples)
    assert rate_hz == (None if expected_hz is None else pytest.approx(expected_hz))


@pytest.mark.parametrize(("step", "verdict"), [(22, PASS), (12, WARN), (0, WARN)])
def test_the_rate_that_the_daemon_counts_is_judged(
    tmp_path: Path, step: int, verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def counted_at(k: int) -> dict[str, Any]:
        return {"t_ns": k * 250_000_000, "trackpad": {"reports": {"frames": k * step}}}

    counted = iter(range(1, 100))
    monkeypatch.setattr(devices, "refreshed", lambda _: system(tmp_path, counted_at(next(counted))))
    found = devices.rate(system(tmp_path, counted_at(0)), wait=lambda _: None)
    assert found.verdict == verdict
    assert (f"{step * 4:.1f} Hz" in found.text) == (step > 0)


def test_a_free_board_reports_its_firmware() -> None:
    assert in_virtual_time(devices.firmware_version(BoardLink(), "the bench")) == __version__  # type: ignore[arg-type]
    with pytest.raises(DeviceError, match="No board answers on the bench"):
        in_virtual_time(devices.firmware_version(BoardLink(mute=True), "the bench"))  # type: ignore[arg-type]


# --- the machine ---


def test_the_udev_rule_is_compared_and_its_fix_copies_the_installed_file(tmp_path: Path) -> None:
    assert host.rules(system(tmp_path)).verdict == PASS
    assert host.rules(system(tmp_path, trackpad={"source": "evdev"})).verdict == PASS
    missing = host.rules(system(tmp_path, **REAL))
    assert missing.verdict == WARN
    *_, source, destination = missing.remedy.partition(" && ")[0].split()
    path = tmp_path / "etc/udev/rules.d" / host.RULES
    assert destination == f"/{path.relative_to(tmp_path)}"
    put(path, "an older one")
    assert "is not this version's" in host.rules(system(tmp_path, **REAL)).text
    put(path, Path(source).read_text())
    assert host.rules(system(tmp_path, **REAL)).verdict == PASS


def test_a_slow_clock_and_a_sleepy_governor_are_warnings_with_a_better_one(tmp_path: Path) -> None:
    cpu, source = tmp_path / "sys/devices/system/cpu", tmp_path / "sys/devices/system/clocksource/clocksource0"
    assert [check(system(tmp_path)).verdict for check in (host.clock, host.governor)] == [PASS, PASS]
    put(source / "available_clocksource", "hpet tsc acpi_pm\n")
    for name, verdict in (("hpet", WARN), ("tsc", PASS)):
        put(source / "current_clocksource", f"{name}\n")
        found = host.clock(system(tmp_path))
        assert (found.verdict, found.remedy.startswith("echo tsc | sudo tee /sys/")) == (verdict, verdict == WARN)
    for name, verdict in (("powersave", WARN), ("performance", PASS)):
        put(cpu / "cpu0/cpufreq/scaling_governor", f"{name}\n")
        assert host.governor(system(tmp_path)).verdict == verdict


@pytest.mark.parametrize(
    ("priority", "limits", "capabilities", "has_file", "verdict"),
    [
        (0, (0, 0), 0, False, PASS),
        (10, (0, resource.RLIM_INFINITY), 0, True, WARN),
        (10, (20, 65536), 0, True, WARN),
        (10, (20, 65536), 1 << 14, True, PASS),
        (10, (0, resource.RLIM_INFINITY), 1 << 23, True, PASS),
        (10, (20, resource.RLIM_INFINITY), 0, False, WARN),
        (10, (20, resource.RLIM_INFINITY), 0, True, PASS),
    ],
)
def test_real_time_needs_limits_or_capabilities_and_the_latency_file(
    tmp_path: Path,
    priority: int,
    limits: tuple[int, int],
    capabilities: int,
    has_file: bool,
    verdict: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    limit_of = dict(zip((resource.RLIMIT_RTPRIO, resource.RLIMIT_MEMLOCK), limits, strict=True))
    monkeypatch.setattr(resource, "getrlimit", lambda which: (limit_of[which],) * 2)
    put(tmp_path / "proc/self/status", f"Name:\tpython\nCapEff:\t{capabilities:016x}\n")
    if has_file:
        put(tmp_path / "dev/cpu_dma_latency", "")
    assert host.real_time(system(tmp_path, realtime={"fifo_priority": priority})).verdict == verdict


def test_the_running_daemon_s_grants_count_more_than_this_user_s_limits(tmp_path: Path) -> None:
    for refused, verdict in ((("mlockall: Cannot allocate memory",), WARN), ((), PASS)):
        granted = {name: getattr(Granted(10, (1,), False, refused), name) for name in Granted.__slots__}
        assert host.real_time(system(tmp_path, {"real_time": granted})).verdict == verdict


def test_groups_are_asked_for_only_where_something_belongs_to_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(host.os, "geteuid", lambda: 1)
    assert host.groups(system(tmp_path)).text == "none is needed"
    found = host.groups(system(tmp_path, **REAL))
    assert found.verdict in (PASS, WARN)  # the host may or may not have the group
    assert host.DEVICE_GROUP in found.text


@pytest.mark.usefixtures("impatient")
def test_every_finding_that_is_no_pass_has_a_fix(tmp_path: Path) -> None:
    found = [check(system(tmp_path, **REAL, realtime={"fifo_priority": 50})) for check in CHECKS.values()]
    found += [check(System(Config(), tmp_path, {"state": "FAULT"}, "0")) for check in CHECKS.values()]
    assert all(one.remedy for one in found if one.verdict != PASS)
    assert not any(one.remedy for one in found if one.verdict == PASS)
