"""Child processes and entry points: what they import, and how many threads they start."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import hapticd
from hapticd.tools import owned_process

PACKAGE = Path(hapticd.__file__).parent
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
COUNT = "import os; print(len(os.listdir('/proc/self/task')), *(os.environ[name] for name in {names}))"


def tasks_of(load: str, **environ: str) -> list[str]:
    """Threads of a process that has loaded an entry point and then numpy's BLAS, and its thread counts."""
    multiply = "import numpy as np; np.ones((300, 300)) @ np.ones((300, 300))"
    program = f"{load}; {multiply}; {COUNT.format(names=THREADS)}"
    clean = {name: value for name, value in os.environ.items() if name not in THREADS}
    command = [sys.executable, "-c", program]
    return subprocess.run(command, env=clean | environ, capture_output=True, text=True, check=True).stdout.split()


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="needs /proc")
@pytest.mark.parametrize(
    "entry",
    ["hapticd.__main__", "hapticd.sim.rig.program", "hapticd.tools.owned_process"],
)
def test_an_entry_point_starts_no_threads_for_numpy(entry: str) -> None:
    assert tasks_of(f"import {entry}") == ["1", "1", "1", "1"]


@pytest.fixture
def _in_a_folder_with_other_modules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "hapticd").mkdir()
    for name in ("hapticd/__init__.py", "json.py", "numpy.py"):
        (tmp_path / name).write_text("raise SystemExit('what lies here was run')\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("_in_a_folder_with_other_modules")
def test_a_command_as_a_child_runs_in_a_folder_that_holds_a_hapticd_and_a_json() -> None:
    with owned_process.start(["run", "--print-config"], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert "[plate]" in process.stdout.read()
