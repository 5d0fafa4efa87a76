"""What a command started for itself ends with it, however it dies, and leaves nothing behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from asynchronous import wait_for

from hapticd.tools.daemon_process import DaemonProcess

pytestmark = pytest.mark.long

PATIENCE_S = 60.0
OWNER = """
import os, signal
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # also where the tests run under nohup
from hapticd.tools.daemon_process import DaemonProcess
from hapticd.sim.rig.process import RigProcess
with RigProcess("rest", 1) as rig, DaemonProcess(f'rig_dir = "{rig.directory}"') as daemon:
    print(daemon.process.pid, rig.process.pid, flush=True)
    signal.pause()
"""


def is_gone(pid: int) -> bool:
    """No such process, or one that only waits for somebody to ask how it ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0] == "Z"
    except FileNotFoundError:
        return True


@pytest.fixture
def owner(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    environ = {**os.environ, "TMPDIR": str(tmp_path)}
    with subprocess.Popen([sys.executable, "-c", OWNER], env=environ, stdout=subprocess.PIPE, text=True) as process:
        yield process
        process.kill()


def owned(owner: subprocess.Popen[str]) -> list[int]:
    """The service and its rig, once both are started."""
    assert owner.stdout is not None
    pids = [int(pid) for pid in owner.stdout.readline().split()]
    assert len(pids) == 2
    return pids


@pytest.mark.parametrize("sign", [signal.SIGKILL, signal.SIGHUP, signal.SIGTERM])
def test_a_service_and_its_rig_end_with_their_owner_however_that_ends(
    owner: subprocess.Popen[str], sign: signal.Signals, tmp_path: Path
) -> None:
    pids = owned(owner)
    wait_for(lambda: any(tmp_path.glob("hapticd-run-*/run/control")), PATIENCE_S)  # at work, or on its way there

    owner.send_signal(sign)

    assert owner.wait(PATIENCE_S) == -sign
    wait_for(lambda: all(is_gone(pid) for pid in pids), PATIENCE_S)
    assert list(tmp_path.iterdir()) == []


def test_a_service_that_its_owner_ends_says_nothing_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with DaemonProcess('scenario = "rest"') as running:
        wait_for(lambda: (running.runtime_dir / "control").exists(), PATIENCE_S)
    assert running.process.returncode == 0
    assert capfd.readouterr().err == ""
    assert [path.name for path in tmp_path.iterdir()] == []
