"""hapticd as a service on Debian's kernel and systemd: the unit as `service install` puts it, and devices' nodes.

One boot in QEMU (`machine.py`) runs `guest/service.py` with a virtual trackpad and touchscreen, a board on a virtual
USB and a client. What the unit says is in force to the letter, its time limits too: the guest's clock counts
instructions, so that a busy host delays nothing in it.
"""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

import machine

pytestmark = [pytest.mark.long, pytest.mark.timeout(1300)]

(RIG,) = (
    n for n in ast.parse((machine.FOLDER / "guest/service.py").read_text("utf-8")).body if isinstance(n, ast.ClassDef)
)
STEPS = [one.name for one in RIG.body if isinstance(one, ast.FunctionDef) and not one.name.startswith("_")]


@pytest.fixture(scope="module")
def guest(tmp_path_factory: pytest.TempPathFactory) -> machine.Boot:
    """What the guest's program found: it ran once, to its end."""
    if (reason := machine.missing()) is not None:
        pytest.skip(reason)
    return machine.boot(tmp_path_factory.mktemp("guest"))


@pytest.mark.parametrize("step", ["plugged", *STEPS])
def test_each_step_of_the_guests_program_ends_as_it_has_to(guest: machine.Boot, step: str) -> None:
    assert guest.error(step) == ""
