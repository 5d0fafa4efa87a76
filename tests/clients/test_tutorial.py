"""The tutorial is run as a reader runs it, on the simulated plate."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from hapticd.tools.daemon_process import DaemonProcess

SCRIPT = Path(__file__).parents[2] / "clients/python/tutorial.py"
PRINTED = (
    r"1\. A plate of 137\.5 x 137\.5 mm with 2 modes\.\n"
    r"2\. Finger \d+ landed at \(-30, 10\) mm\.\n"
    r"3\. Friction 0\.2 takes 1\.\d um of vibration; it gets \d\.\d um\.\n"
    r"4\. Left of the ridge, on it and right of it the finger is asked (1\.\d), 0\.0, \1 um\.\n"
    r"5\. The click began when finger \d+ entered\.\n"
    r"6\. Marked at \d+\.\d{3} s\. Go on with clients/examples\.\n"
)


@pytest.mark.long
@pytest.mark.timeout(180)
def test_each_step_of_the_tutorial_says_what_it_found() -> None:
    with DaemonProcess('scenario = "hands"', log_level="error") as running:
        there = os.environ | {"HAPTICD_RUNTIME_DIR": str(running.runtime_dir)}
        done = subprocess.run([sys.executable, SCRIPT], env=there, capture_output=True, text=True, timeout=150)
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(PRINTED, done.stdout), done.stdout
