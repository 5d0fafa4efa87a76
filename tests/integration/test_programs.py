"""What a person types: the demo and the examples of `clients/`, against the real service."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import pytest
from service import PATIENCE_S, PIPE, Bench, first


@pytest.mark.alone  # its picture and its live lines need a rig that is on time
def test_the_demo_shows_two_fingers_and_writes_its_picture(bench: Bench) -> None:
    out = bench.folder / "demo.png"
    command = [sys.executable, "-m", "hapticd", "demo", "--seconds", "3", "--out", str(out)]
    environ = {**os.environ, "TMPDIR": str(bench.folder)}
    with subprocess.Popen(command, env=environ, stdout=PIPE, stderr=PIPE, text=True) as process:
        output, complaints = first(process).communicate(timeout=2 * PATIENCE_S)
    of_a_busy_machine = "trackpad silent|too busy|Waiting for hapticd"
    faults = [line for line in complaints.splitlines() if not re.search(of_a_busy_machine, line)]
    assert (process.returncode, faults) == (0, [])
    lines = output.splitlines()
    live = [line for line in lines if re.match(r"(ACTIVE|ARMED|IDLE) +horizon", line)]
    assert 2 <= len(live) <= 4
    assert any("0.50 -> " in line for line in live)  # a pad that was late may have lifted both by the last line
    assert any(re.fullmatch(r"sticky contact, um RMS( +\d+\.\d+){3}", line) for line in lines)
    assert any(re.fullmatch(r"contrast of the two( +\d+\.\d){3}", line) for line in lines)
    assert any(line.startswith("The sticky finger gets ") for line in lines)
    assert lines[-2] == f"picture: {out}"
    assert lines[-1].endswith("hapticd view --sim")
    assert out.read_bytes().startswith(b"\x89PNG")
    assert {path.name for path in bench.folder.iterdir()} <= {"demo.png", "hapticd.toml", "rig"}  # it tidied up
