"""The examples run, print their actions and stop cleanly."""

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
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def run(name: str, daemon: FakeDaemon, *arguments: str) -> None:
    example(name).main(["--endpoint", str(daemon.directory), "--seconds", "0.1", *arguments])


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


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_ctrl_c_is_a_clean_end(name: str, daemon: FakeDaemon) -> None:
    command = [sys.executable, str(CLIENTS / "examples" / f"{name}.py"), "--endpoint", str(daemon.directory)]
    environ = {**os.environ, "PYTHONPATH": str(CLIENTS / "python"), "PYTHONUNBUFFERED": "1"}
    daemon.fingers = {1: (-20.0, 0.0)}
    pipe = subprocess.PIPE
    with subprocess.Popen(command, env=environ, stdout=pipe, stderr=pipe, text=True) as process:
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        _, complaints = process.communicate(timeout=5.0)
        assert (process.returncode, complaints) == (0, "")
    assert daemon.scene.owner_of(1) is None


# --- textures ---------------------------------------------------------------------------------------------------


def test_a_photograph_that_is_none_is_one_sentence(daemon: FakeDaemon, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        run("photograph", daemon, str(CLIENTS / "PROTOCOL.md"))
    assert left.value.code == 1
    assert capsys.readouterr().err.endswith("PROTOCOL.md: is not a PNG or JPEG that Pillow can read.\n")
