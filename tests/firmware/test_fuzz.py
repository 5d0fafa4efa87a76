"""Scripts of anything (firmware/fuzz/fuzz_core.c): the kept ones are replayed, and new ones are tried for a while.

The seeds in `tests/data/fuzz-board` come from the golden conversation; a script that once broke a promise belongs
beside them. After a wanted change of the golden file `python tests/firmware/test_fuzz.py` writes the seeds anew.
"""

from __future__ import annotations

import json
import os
import shutil
import struct
import subprocess
from pathlib import Path

import pytest

from hapticd.wire.framing import FrameSplitter

ROOT = Path(__file__).parents[2]
GOLDEN = ROOT / "tests" / "data" / "board-golden.jsonl"
SEEDS = ROOT / "tests" / "data" / "fuzz-board"
RAW, FRAME, RUN, SENSE, LISTEN = range(5)
FUZZ_RUNS = 4_000  # a second


def seeds() -> dict[str, bytes]:
    """A script for each command of the golden conversation, and one of all of them."""
    scripts: dict[str, bytes] = {}
    for row in map(json.loads, GOLDEN.read_text(encoding="utf-8").splitlines()):
        if "host" in row:
            (message,) = FrameSplitter(512).feed(bytes.fromhex(row["line"]))
            heard = bytes((FRAME, message[0], len(message) - 1)) + message[1:]
            scripts.setdefault(row["host"], heard + bytes((RUN, 20, LISTEN)))
    scripts["conversation"] = b"".join(scripts.values())
    reference = scripts["ReferenceFrame"][: -len((RUN, 20, LISTEN))]
    seq = 3  # of the script's bytes, its lower one
    armed = b"".join(reference[:seq] + bytes((7 + i,)) + reference[seq + 1 :] for i in range(3))
    scripts["armed"] = armed + bytes((RUN, 60, SENSE)) + struct.pack("<4f", 1.0, 0.5, 0.0, -0.5) + bytes((RUN, 200))
    return scripts


def test_the_seeds_are_made_from_the_golden_conversation() -> None:
    for name, script in seeds().items():
        assert (SEEDS / name).read_bytes() == script


@pytest.mark.long
@pytest.mark.parametrize("modes", [2, 3, 8])
def test_new_scripts_keep_the_boards_promises_under_the_sanitizers(modes: int, tmp_path: Path) -> None:
    if shutil.which("clang") is None or shutil.which("make") is None:
        pytest.skip("clang or make is not there: no fuzzing")
    target = f"{tmp_path}/fuzz-{modes}modes"
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


if __name__ == "__main__":
    SEEDS.mkdir(exist_ok=True)
    for seed_name, seed in seeds().items():
        (SEEDS / seed_name).write_bytes(seed)
