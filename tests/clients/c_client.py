"""The C client, compiled for tests."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "clients" / "c"
WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wshadow"]
SANITIZERS = ["-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


def compiled(folder: Path, *words: str) -> Path:
    """Compile with libzmq and return what was made."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    probe = subprocess.run([compiler or "false", "-E", "-"], input="#include <zmq.h>", capture_output=True, text=True)
    if probe.returncode != 0:
        pytest.skip("a C compiler and libzmq3-dev are not installed")
    assert compiler is not None
    made = folder / "made"
    command = [compiler, *WARNINGS, f"-I{FOLDER}", *words, "-lzmq", "-lm", "-o", str(made)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return made
