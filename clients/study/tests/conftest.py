"""Puts the distribution, the client library and the fakes of this folder on the path; and refused command lines."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

STUDY = Path(__file__).parents[1]
PACKAGES = [str(STUDY), str(STUDY.parent / "python")]
sys.path[:0] = [*PACKAGES, str(STUDY / "tests")]
os.environ["PYTHONPATH"] = os.pathsep.join(PACKAGES)  # of the programs that the tests start
settings.register_profile("same-each-time", database=None, deadline=None, derandomize=True)
if not os.environ.get("NEW_EXAMPLES"):
    settings.load_profile("same-each-time")


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Runs a wrong call, which prints one line and nothing else; returns that line."""
    from hapticd_study.program import main

    def run(*arguments: str) -> str:
        assert main(arguments) == 2
        printed = capsys.readouterr()
        assert (printed.out, printed.err.count("\n")) == ("", 1)
        return printed.err

    return run
