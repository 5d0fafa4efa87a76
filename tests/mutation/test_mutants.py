"""Every mutant of the two limiters dies by their tests; the few that cannot are equivalent, each for its reason."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.long
TRIAL = Path(__file__).with_name("trial.py")

_GROWS = "1 - shave has the same float for the few steps that it takes"
_SIZE = "abs(w_um) if isinstance(w_um, float) else math.hypot(w_um.real, w_um.imag)"
HOST_EQUIVALENT = {
    f"size_um = {_SIZE}: {_SIZE} -> {_SIZE.replace('isinstance(w_um, float)', 'False')}": "the same for a float",
    "shave = 2.0**-53: 2.0 -> 1.9999999999999998": "1 - shave rounds to the same float below 1",
    "shave = 2.0**-53: 2.0 -> 2.0000000000000004": "1 - shave rounds to the same float below 1",
    "shave = 2.0**-53: 53 -> 54": "1 - 2**-54 is 1 in floats: one step without effect, then the same ones",
    "shave *= 2.0: 2.0 -> 1.9999999999999998": _GROWS,
    "shave *= 2.0: 2.0 -> 2.0000000000000004": _GROWS,
}
_ROUND_DOWN = "limiter.c #define ROUND_DOWN (1.0f - 0x1p-21f):"
_TOLERANCE = "limiter.h #define HD_LIMIT_TOLERANCE 1e-6f:"
BOARD_EQUIVALENT = {
    f"{_ROUND_DOWN} @27 0x1p-21f -> (0x1.fffffe0000000p-22f)": "1 - 2**-21 has the same float",
    f"{_ROUND_DOWN} @27 0x1p-21f -> (0x1.0000020000000p-21f)": "1 - 2**-21 has the same float",
    f"{_TOLERANCE} @27 1e-6f -> (0x1.0c6f780000000p-20f)": "1 + 1e-6 has the same float",
    f"{_TOLERANCE} @27 1e-6f -> (0x1.0c6f7c0000000p-20f)": "1 + 1e-6 has the same float",
    "limiter.c if (!(magnitude <= limit_um[k] * (1.0f + HD_LIMIT_TOLERANCE))) {:"
    " @42 1.0f -> (0x1.fffffe0000000p-1f)": "1 + 1e-6 has the same float",
    "phasor.h return (a.d - a.d) + (a.q - a.q) == 0.0f;: @23 + -> -": "both are 0, or one is NaN",
    "phasor.h return b < a ? b : a;: @13 < -> <=": "of equals either is the smaller",
}


def lived(side: str) -> tuple[int, set[str]]:
    tried = subprocess.run([sys.executable, TRIAL, side], capture_output=True, text=True, check=False)
    assert tried.returncode == 0, tried.stderr[-3000:]
    result = json.loads(tried.stdout)
    return result["mutants"], set(result["lived"])


def test_every_mutant_of_the_hosts_gate_dies() -> None:
    mutants, left = lived("host")
    assert mutants > 100
    assert left == set(HOST_EQUIVALENT)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not there: no mutants of the firmware")
def test_every_mutant_of_the_boards_limiter_dies() -> None:
    mutants, left = lived("board")
    assert mutants > 80
    assert left == set(BOARD_EQUIVALENT)
