"""`hapticd-study run` as a process: sessions in the browser and interrupted ones, on one simulated plate."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from hapticd_client import Client
from hapticd_study import program
from hapticd_study.rehearsal import Rehearsal
from hapticd_study.session import read

pytestmark = [pytest.mark.long, pytest.mark.timeout(300)]
PIPE = subprocess.PIPE
PATIENCE_S = 120.0


@pytest.fixture(scope="module")
def service() -> Iterator[Path]:
    """A service on the simulated plate."""
    if find_spec("hapticd") is None:
        pytest.skip("needs hapticd")
    with Rehearsal() as running:
        with Client(running.runtime_dir, timeout_s=PATIENCE_S) as client:
            next(state for state in client.states(PATIENCE_S) if state.fingers)
        yield running.runtime_dir


def study(service: Path, folder: Path, *arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-u", "-m", "hapticd_study.program", "run", "--participant", "P1", "--out", str(folder)]
    return subprocess.Popen(
        [*command, "--endpoint", str(service), *arguments], stdin=PIPE, stdout=PIPE, stderr=PIPE, text=True
    )


def look(url: str) -> dict[str, Any]:
    with urllib.request.urlopen(url.replace("?", "screen?"), timeout=PATIENCE_S) as response:
        return dict(json.load(response))


def press(url: str, number: int, key: str) -> None:
    origin, _, key_of_page = url.rpartition("/")
    body = json.dumps({"number": number, "key": key}).encode()
    request = urllib.request.Request(f"{origin}/press{key_of_page}", body, {"Origin": origin})
    urllib.request.urlopen(request, timeout=PATIENCE_S).close()


def test_a_session_runs_in_the_browser_and_is_recorded(service: Path, tmp_path: Path) -> None:
    folder = tmp_path / "answers"
    arguments = ("--browser", "--record", "--trials", "2")
    with study(service, folder, *arguments) as process:
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
        assert (process.returncode, complaint.count("\n")) == (0, 1)
        assert complaint.endswith("The plate's own friction curve is used.\n")
    assert output == f"2 of 2 answers in {folder}/P1.jsonl; then: hapticd-study report {folder}\n"
    shown = [heading for heading in headings if heading != "One moment"]
    assert shown == ["Training: high", "Trial 1 of 2", "Trial 2 of 2", "Thank you"]
    held = read(folder / "P1.jsonl")
    assert [answer.answer for answer in held.answers] == ["low", "low"]
    assert (held.is_over, held.simulated) == (True, "plate")
    assert all(answer.felt_friction is not None and answer.speed_mm_s > 10.0 for answer in held.answers)
    assert (folder / "P1.mcap").stat().st_size > 10_000


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_leaves_the_plate_quiet_and_shows_how_to_continue(
    number: signal.Signals, service: Path, tmp_path: Path
) -> None:
    with study(service, tmp_path / "answers") as process:
        assert process.stdout is not None
        assert any("Training" in line for line in process.stdout)
        process.send_signal(number)
        output, complaint = process.communicate(timeout=PATIENCE_S)
        assert (process.returncode, complaint.count("\n")) == (130, 1)
    assert output.endswith("P1.jsonl: the same command continues it.\n")
    assert read(tmp_path / "answers" / "P1.jsonl").answers == ()
    with Client(service, timeout_s=PATIENCE_S) as client:
        assert all(not finger.owner for finger in client.fingers())


def test_each_part_of_a_session_has_a_recording_of_its_own(tmp_path: Path) -> None:
    assert program._recording(tmp_path / "P1.jsonl") == tmp_path / "P1.mcap"
    (tmp_path / "P1.mcap").touch()
    assert program._recording(tmp_path / "P1.jsonl") == tmp_path / "P1.2.mcap"
