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
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd import board_protocol as protocol
from hapticd.bench.closed_loop import Law, LoopPlate
from hapticd.sim.board.board import FLAG_LIVE, BoardTrace
from hapticd.wire import device
from hapticd.wire.framing import FrameSplitter, encode_frame

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


def played(script: bytes) -> Iterator[tuple[BoardTrace, int]]:
    """The script played to the host's library: the ticks of each RUN, and the references said before it."""
    board, decoder, references, at = Law("deadbeat").board(LoopPlate(), noise_um=0.0), device.Decoder(), 0, 0
    board.fake_measurement(np.zeros(2, dtype=np.complex128))

    def take(n: int) -> bytes:
        nonlocal at
        at += n
        return script[at - n : at]

    while at < len(script):
        operation = take(1)[0] % 5
        if operation == RAW:
            data = take(int.from_bytes(take(1)))
            board.receive(data)
            references += len(data) // 8
        elif operation == FRAME:
            kind, n = take(1) or b"\0", int.from_bytes(take(1))
            board.receive(encode_frame(kind + take(n)))
            references += kind[0] == protocol.MSG_REFERENCE
        elif operation == RUN:
            ticks = int.from_bytes(take(1))
            trace = BoardTrace(ticks, 2, 2)
            board.run(ticks, np.zeros((ticks, 0, 2)), np.zeros((ticks, 0)), trace)
            yield trace, references
        elif operation == SENSE and len(parts := take(16)) == 16:
            board.fake_measurement(np.frombuffer(parts, "<f4").astype(np.float64).view(np.complex128))
        elif operation == LISTEN:
            decoder.feed(board.transmit())
            assert not any(decoder.counters.values()), "what is sent is made of sound frames"


def check(script: bytes) -> None:
    for trace, references in played(script):
        magnitude_v = np.abs(trace.voltage_v)
        live = (trace.flags & FLAG_LIVE) != 0
        assert np.isfinite(magnitude_v).all()
        assert (magnitude_v <= 150 * 1.000001).all()
        assert (np.abs(trace.reference_um) <= 4 * 1.000002).all()
        assert references >= 3 or not live.any()
        if references < 3:
            assert (magnitude_v <= protocol.RAW_LIMIT_FRAC * 150 * 1.000001).all()


def test_the_seeds_are_made_from_the_golden_conversation() -> None:
    for name, script in seeds().items():
        assert (SEEDS / name).read_bytes() == script


def test_the_seed_that_should_arm_the_board_does() -> None:
    assert any((trace.flags & FLAG_LIVE).any() for trace, _ in played(seeds()["armed"]))


@pytest.mark.parametrize("path", sorted(SEEDS.iterdir()), ids=lambda path: path.name)
def test_every_kept_script_leaves_the_board_within_its_bounds(path: Path) -> None:
    check(path.read_bytes())


operations = st.one_of(
    st.binary(max_size=60).map(lambda data: bytes((RAW, len(data))) + data),
    st.builds(lambda kind, data: bytes((FRAME, kind, len(data))) + data, st.integers(0, 15), st.binary(max_size=60)),
    st.sampled_from(sorted(seeds().values())),
    st.integers(0, 60).map(lambda ticks: bytes((RUN, ticks))),
    st.lists(st.floats(width=32), min_size=4, max_size=4).map(lambda w: bytes((SENSE,)) + struct.pack("<4f", *w)),
    st.just(bytes((LISTEN,))),
)


@settings(max_examples=150)
@given(st.lists(operations, max_size=20))
def test_no_script_drives_the_board_out_of_its_bounds(parts: list[bytes]) -> None:
    check(b"".join(parts))


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
