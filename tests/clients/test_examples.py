"""The examples run, say what they do, and stop cleanly."""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path
from types import ModuleType

import pytest
from fake_daemon import FakeDaemon

from hapticd_client import Client

CLIENTS = Path(__file__).parents[2] / "clients"
NAMES = sorted(path.stem for path in (CLIENTS / "examples").glob("*.py"))


def example(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, CLIENTS / "examples" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def run(name: str, daemon: FakeDaemon, *arguments: str) -> None:
    example(name).main(["--endpoint", str(daemon.directory), "--seconds", "0.1", *arguments])


@pytest.mark.parametrize("name", NAMES)
def test_help_shows_an_example(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        example(name).main(["--help"])
    assert left.value.code == 0
    assert "example: hapticd run --sim" in capsys.readouterr().out


@pytest.mark.parametrize("name", NAMES)
def test_without_a_daemon_an_example_ends_with_one_sentence(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    program = example(name)
    monkeypatch.setattr(program, "Client", partial(Client, timeout_s=0.05))
    with pytest.raises(SystemExit) as left:
        program.main(["--endpoint", str(tmp_path)])
    assert left.value.code == 1
    assert capsys.readouterr().err.startswith(f"No hapticd answers at {tmp_path}")


def test_the_papers_environment_makes_left_fingers_slip_and_right_ones_stick(
    daemon: FakeDaemon, capsys: pytest.CaptureFixture[str]
) -> None:
    daemon.fingers = {1: (-20.0, 0.0), 2: (20.0, 0.0)}
    run("paper_environment", daemon, "--slippery-um", "1.5")
    lines = capsys.readouterr().out.splitlines()
    assert lines == ["finger 1 landed at x = -20.0 mm: 1.5 um", "finger 2 landed at x = +20.0 mm: 0 um"]
    assert daemon.scene.owner_of(1) is None


@pytest.mark.parametrize(("arguments", "user_um", "virtual_um"), [([], 1.0, 0.0), (["--swap"], 0.0, 1.0)])
def test_the_study_gives_user_and_virtual_finger_opposite_friction(
    daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch, arguments: list[str], user_um: float, virtual_um: float
) -> None:
    daemon.fingers = {1: (-20.0, 0.0)}
    wanted_um: dict[int | str, float | None] = {}
    publish = daemon.server.publish

    def noted(payload: bytes) -> None:
        for key in (1, "walker"):
            wanted_um[key] = (
                daemon.scene.amplitude_um(key, 0.0, 0.0) if daemon.scene.owner_of(key) else wanted_um.get(key)
            )
        publish(payload)

    monkeypatch.setattr(daemon.server, "publish", noted)
    run("virtual_finger", daemon, *arguments)
    assert wanted_um == {1: user_um, "walker": virtual_um}


def test_achieved_amplitudes_are_printed_beside_what_was_asked(
    daemon: FakeDaemon, capsys: pytest.CaptureFixture[str]
) -> None:
    daemon.fingers = {1: (-20.0, 0.0), 2: (20.0, 0.0)}
    with Client(daemon.directory) as client:
        client.set(1, amplitude_um=1.25)
        run("print_achieved", daemon, "--every", "0.01")
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 2
    assert lines[-1] == "  ACTIVE  1: 1.25 -> 1.25 um"


@pytest.mark.parametrize("name", NAMES)
def test_ctrl_c_is_a_clean_end(name: str, daemon: FakeDaemon) -> None:
    command = [sys.executable, str(CLIENTS / "examples" / f"{name}.py"), "--endpoint", str(daemon.directory)]
    environ = {**os.environ, "PYTHONPATH": str(CLIENTS / "python"), "PYTHONUNBUFFERED": "1"}
    daemon.fingers = {1: (-20.0, 0.0)}
    pipe = subprocess.PIPE
    with subprocess.Popen(command, env=environ, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        _, complaints = process.communicate(timeout=5.0)
        assert (process.returncode, complaints) == (0, "")
    assert daemon.scene.owner_of(1) is None
