"""`hapticd study run` as a process: a session in the browser, and an interrupted one."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from fake_daemon import FakeDaemon
from msgspec import Struct

from hapticd.config.sections import SimConfig
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.tools.study import own_curve, program
from hapticd.tools.study.session import read
from hapticd_contract.requests import PlateRequest, Request

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[3]
PIPE = subprocess.PIPE
PATIENCE_S = 60.0


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[FakeDaemon]:
    """A daemon with one finger on its plate."""
    (tmp_path / "run").mkdir()
    running = FakeDaemon(tmp_path / "run")
    running.fingers = {1: (-20.0, 0.0)}
    running.start()
    yield running
    running.stop()


def study(daemon: FakeDaemon, folder: Path, *arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "hapticd", "study", "run", "--participant", "P1", "--out", str(folder)]
    environ = {**os.environ, "PYTHONPATH": str(ROOT / "clients" / "python"), "PYTHONUNBUFFERED": "1"}
    return subprocess.Popen(
        [*command, "--endpoint", str(daemon.directory), *arguments],
        env=environ, cwd=ROOT, stdin=PIPE, stdout=PIPE, stderr=PIPE, text=True,
    )  # fmt: skip


def look(url: str) -> dict[str, Any]:
    with urllib.request.urlopen(url.replace("?", "screen?"), timeout=PATIENCE_S) as response:
        return dict(json.load(response))


def press(url: str, number: int, key: str) -> None:
    origin, _, key_of_page = url.rpartition("/")
    body = json.dumps({"number": number, "key": key}).encode()
    urllib.request.urlopen(
        urllib.request.Request(f"{origin}/press{key_of_page}", body, {"Origin": origin}), timeout=PATIENCE_S
    ).close()


def test_a_session_runs_in_the_browser(daemon: FakeDaemon, tmp_path: Path) -> None:
    folder = tmp_path / "answers"
    with study(daemon, folder, "--browser", "--trials", "2") as process:
        assert process.stdout is not None
        url = process.stdout.readline().removeprefix("open ").strip()
        headings: list[str] = []
        while "Thank you" not in headings:
            screen = look(url)
            if screen["heading"] not in headings:
                headings.append(screen["heading"])
            if screen["keys"]:  # repeatedly: an early press does not count
                press(url, screen["number"], "next" if screen["keys"][-1]["name"] == "next" else "low")
        output, complaint = process.communicate(timeout=PATIENCE_S)
        assert (process.returncode, complaint) == (0, "")
    assert output == f"2 of 2 answers in {folder}/P1.jsonl; then: hapticd study report {folder}\n"
    shown = [heading for heading in headings if heading != "One moment"]
    assert shown == ["Training: high", "Trial 1 of 2", "Trial 2 of 2", "Thank you"]
    held = read(folder / "P1.jsonl")
    assert [answer.answer for answer in held.answers] == ["low", "low"]
    assert held.is_over
    assert daemon.scene.owner_of(1) is None


class SimulatedDaemon(FakeDaemon):
    """A daemon on the simulated plate, as `hapticd run --sim` starts it."""

    def _handle(self, request: Request, user: str) -> Struct | Mapping[str, object]:
        return {"simulated": "/rig"} if isinstance(request, PlateRequest) else super()._handle(request, user)


def test_a_session_with_a_daemon_on_the_simulated_plate_is_marked(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    running = SimulatedDaemon(tmp_path / "run")
    running.start()
    with study(running, tmp_path / "answers") as process:
        assert process.stdout is not None
        assert any("Training" in line for line in process.stdout)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=PATIENCE_S)
    running.stop()
    assert read(tmp_path / "answers" / "P1.jsonl").simulated == "plate"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_leaves_the_plate_quiet_and_shows_how_to_continue(
    number: signal.Signals, daemon: FakeDaemon, tmp_path: Path
) -> None:
    with study(daemon, tmp_path / "answers") as process:
        assert process.stdout is not None
        assert any("Training" in line for line in process.stdout)
        process.send_signal(number)
        output, complaint = process.communicate(timeout=PATIENCE_S)
        assert (process.returncode, complaint) == (130, "")
    assert output.endswith("P1.jsonl: the same command continues it.\n")
    assert daemon.scene.owner_of(1) is None
    assert read(tmp_path / "answers" / "P1.jsonl").answers == ()


def test_a_rehearsal_is_on_the_plate_and_the_wiring_that_were_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    tables: list[str] = []
    monkeypatch.setattr(program, "DaemonProcess", lambda sim, *_, **__: tables.append(sim))
    program.rehearsal(plate=SimConfig(plate="fingertip", modes=5, wiring="inverted"))
    assert tables[0].splitlines()[1:] == ['plate = "fingertip"', "modes = 5", 'wiring = "inverted"']


def test_each_part_of_a_session_has_a_recording_of_its_own(tmp_path: Path) -> None:
    session = tmp_path / "P1.jsonl"
    assert program._recording(session) == tmp_path / "P1.mcap"
    (tmp_path / "P1.mcap").touch()
    assert program._recording(session) == tmp_path / "P1.2.mcap"


@pytest.mark.timeout(120)
def test_a_rehearsal_is_by_the_participants_curve_and_recorded(tmp_path: Path) -> None:
    calibration, answers = tmp_path / "calibration", tmp_path / "answers"
    own = own_curve.path_of(calibration, "P1")
    own.parent.mkdir(parents=True)
    own.write_text("[plate]\nfriction_curve = [0.0, 0.4, 1.5]\n", encoding="utf-8")
    command = [sys.executable, "-m", "hapticd", "study", "run", "--sim", "--record", "--participant", "P1"]
    command += ["--out", str(answers), "--calibration", str(calibration)]
    with subprocess.Popen(command, stdin=PIPE, stdout=PIPE, stderr=PIPE, text=True, cwd=ROOT) as process:
        assert process.stdout is not None
        assert any("Training" in line for line in process.stdout)
        process.send_signal(signal.SIGINT)
        _, complaint = process.communicate(timeout=PATIENCE_S)
    assert "another friction curve" not in complaint
    recording = open_recording(answers / "P1.mcap")
    assert recording.header.config.plate.friction_curve == (0.0, 0.4, 1.5)
    assert recording.has_end or any(recording.records())


def test_a_service_with_another_curve_is_named(daemon: FakeDaemon, tmp_path: Path) -> None:
    own = own_curve.path_of(tmp_path / "calibration", "P1")
    own.parent.mkdir(parents=True)
    own.write_text("[plate]\nfriction_curve = [0.0, 0.4, 1.5]\n", encoding="utf-8")
    with study(daemon, tmp_path / "answers", "--calibration", str(tmp_path / "calibration")) as process:
        assert process.stdout is not None
        assert any("Training" in line for line in process.stdout)
        process.send_signal(signal.SIGINT)
        _, complaint = process.communicate(timeout=PATIENCE_S)
    assert f"start `hapticd run --friction {own}`" in complaint
