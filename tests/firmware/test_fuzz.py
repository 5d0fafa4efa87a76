"""Scripts of anything (firmware/fuzz/fuzz_core.c): new ones are tried for a while.

The seeds in `tests/data/fuzz-board` were made of the golden conversation; a script that once broke a promise belongs
with them.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SEEDS = ROOT / "tests" / "data" / "fuzz-board"
FUZZ_RUNS = 4_000  # a second


@pytest.mark.long
def test_new_scripts_keep_the_boards_promises_under_the_sanitizers(tmp_path: Path) -> None:
    if shutil.which("clang") is None or shutil.which("make") is None:
        pytest.skip("clang or make is not there: no fuzzing")
    target = f"{tmp_path}/fuzz-8modes"
    built = subprocess.run(
        ["make", "-C", ROOT / "firmware", f"BUILD={tmp_path}", target], capture_output=True, text=True, check=False
    )
    if "clang_rt.fuzzer" in built.stderr:
        pytest.skip("clang has no libFuzzer (libclang-rt): no fuzzing")
    assert built.returncode == 0, built.stderr
    found = tmp_path / "corpus"
    found.mkdir()
    seed = 0 if os.environ.get("NEW_EXAMPLES") else 1  # 0 draws a new one
    command = [target, f"-runs={FUZZ_RUNS}", f"-seed={seed}", "-max_len=2048", str(found), str(SEEDS)]
    fuzzed = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert fuzzed.returncode == 0, fuzzed.stderr[-2000:]
