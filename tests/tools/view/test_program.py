"""`hapticd view` as a command: errors in one sentence, and no processes or files left."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from asynchronous import wait_for

from hapticd.__main__ import main

pytestmark = pytest.mark.long

PATIENCE_S = 60.0


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--sim", "--endpoint", "/tmp"), "cannot be combined with --endpoint"),
        (("--scenario", "strokes"), "give --sim as well"),
        (("--sim", "--scenario", "dance"), "there is no 'dance': choose one of strokes,"),
        (("--endpoint", "/no/such/directory"), "/no/such/directory is not a directory"),
    ],
)
def test_invalid_arguments_are_one_sentence(
    arguments: tuple[str, ...], sentence: str, refused: Callable[..., str]
) -> None:
    assert sentence in refused("view", "--no-browser", *arguments)


def test_a_port_in_use_and_a_missing_library_are_one_sentence(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        assert main(["view", "--no-browser", "--port", str(taken.getsockname()[1])]) == 1
    assert "choose another with --port" in capsys.readouterr().err
    for name in [one for one in sys.modules if one.startswith("hapticd.tools.web")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "aiohttp", None)
    assert main(["view", "--no-browser"]) == 1
    assert f"run `{sys.executable} -m pip install 'aiohttp>=" in capsys.readouterr().err


def children_of(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


@pytest.fixture
def simulated_view(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A viewer of a simulated plate, which keeps its files in `tmp_path`."""
    command = [sys.executable, "-m", "hapticd", "view", "--sim", "--no-browser", "--port", "0"]
    environ = {"TMPDIR": str(tmp_path), "PATH": "/usr/bin:/bin", "HAPTICD_PURE": "1"}
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env=environ) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("the plate: http://127.0.0.1:")
        yield process
        process.kill()


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="needs /proc")
@pytest.mark.parametrize("depth", [1, 2], ids=["service", "rig"])
def test_a_viewer_whose_simulated_plate_is_killed_ends_with_a_sentence(
    depth: int, simulated_view: subprocess.Popen[str], tmp_path: Path
) -> None:
    wait_for(lambda: any(tmp_path.glob("hapticd-run-*/run/control")), PATIENCE_S)
    pid = simulated_view.pid
    for _ in range(depth):
        (pid,) = children_of(pid)
    os.kill(pid, signal.SIGKILL)
    assert simulated_view.wait(PATIENCE_S) == 1
    assert simulated_view.stderr is not None
    said = simulated_view.stderr.read().splitlines()
    assert said[-1] == "hapticd: The service of the simulated plate has ended: start this command again."
    assert ("hapticd: The simulated rig has ended: start this command again." in said) == (depth == 2)
    assert not [left for left in tmp_path.iterdir() if depth == 2 or left.name.startswith("hapticd-run-")]


@pytest.mark.parametrize("end", [signal.SIGTERM, signal.SIGINT])
def test_a_simulated_plate_ends_with_its_viewer(
    end: signal.Signals, simulated_view: subprocess.Popen[str], tmp_path: Path
) -> None:
    assert len(list(tmp_path.glob("hapticd-run-*"))) == 1
    simulated_view.send_signal(end)
    assert simulated_view.wait(PATIENCE_S) == 0
    assert list(tmp_path.iterdir()) == []
