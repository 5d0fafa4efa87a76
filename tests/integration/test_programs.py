"""What a person types: the demo and the examples of `clients/`, against the real service."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

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
    assert any("1.00 -> " in line for line in live)  # a pad that was late may have lifted both by the last line
    assert any(re.fullmatch(r"sticky contact, um RMS( +\d+\.\d+){3}", line) for line in lines)
    assert any(re.fullmatch(r"contrast of the two( +\d+\.\d){3}", line) for line in lines)
    assert any(line.startswith("The sticky finger gets ") for line in lines)
    assert lines[-2] == f"picture: {out}"
    assert lines[-1].endswith("hapticd view --sim")
    assert out.read_bytes().startswith(b"\x89PNG")
    assert {path.name for path in bench.folder.iterdir()} <= {"demo.png", "hapticd.toml", "rig"}  # it tidied up


@pytest.mark.long
def test_the_address_that_a_demo_prints_is_a_page_while_it_runs(tmp_path: Path) -> None:
    with live_demo(tmp_path) as (process, lines):
        (address,) = re.findall(r"(?m)^the plate: (http://127\.0\.0\.1:\S+)$", "".join(lines))
        with urllib.request.urlopen(address, timeout=PATIENCE_S) as page:
            assert (page.status, b"<canvas" in page.read()) == (200, True)
        process.send_signal(signal.SIGHUP)
        process.wait(PATIENCE_S)


@contextmanager
def live_demo(folder: Path) -> Iterator[tuple[subprocess.Popen[str], list[str]]]:
    """A demo and the lines up to its first live one; its picture and its files go to this folder."""
    command = [sys.executable, "-m", "hapticd", "demo", "--out", str(folder / "demo.png")]
    environ = {**os.environ, "TMPDIR": str(folder)}
    with subprocess.Popen(command, env=environ, stdout=PIPE, stderr=PIPE, text=True) as process:
        assert process.stdout is not None
        lines = [process.stdout.readline()]
        while not re.match("(ACTIVE|ARMED|IDLE)", lines[-1]):
            assert process.poll() is None
            lines.append(process.stdout.readline())
        yield process, lines
