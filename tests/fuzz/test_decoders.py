"""Any bytes to any decoder: its own error or a sound value, at a bounded cost. Kept, damaged and new inputs."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzz.explore import MISSING
from fuzz.target import Target, measured
from fuzz.targets import TARGETS

NEW_INPUTS = 500  # to each decoder, a second at most: `make fuzz` tries as many as it has time for
DAMAGES = 60


def inputs(target: Target) -> dict[str, bytes]:
    """The seeds, and what else is in the corpus."""
    seeds = target.seeds()
    kept = {f"kept {path.name}": path.read_bytes() for path in sorted(target.corpus.iterdir())}
    return seeds | {label: data for label, data in kept.items() if data not in seeds.values()}


INPUTS = {name: inputs(target) for name, target in TARGETS.items()}


def check_cost(target: Target, data: bytes) -> None:
    cost, allowed = measured(target.check, data), target.allowed(len(data))
    assert cost.lines <= allowed.lines
    assert cost.peak_bytes <= allowed.peak_bytes


@pytest.mark.parametrize(("name", "label"), [(name, label) for name, found in INPUTS.items() for label in found])
def test_an_input_keeps_the_promises_at_a_bounded_cost(name: str, label: str) -> None:
    check_cost(TARGETS[name], INPUTS[name][label])


@pytest.mark.long
@pytest.mark.parametrize("name", TARGETS)
def test_what_strains_a_decoder_most_stays_within_its_bounds(name: str) -> None:
    for data in TARGETS[name].extremes().values():
        check_cost(TARGETS[name], data)


@pytest.mark.parametrize("name", sorted(TARGETS.keys() - {"modes-npz"}))  # numpy reads a header by `ast.literal_eval`
def test_what_a_decoder_leaves_is_gone_without_the_garbage_collector(name: str) -> None:
    """Which sleeps while fingers are down; what waits for it holds whole files, and the heap between them."""
    assert min(left_behind(name) for _ in range(3)) == 0  # the first fills caches; threads leave their own


def left_behind(name: str) -> int:
    """How many objects wait for the collector."""
    gc.collect()
    gc.disable()
    try:
        for data in INPUTS[name].values():
            TARGETS[name].check(data)
        return gc.collect()
    finally:
        gc.enable()


@st.composite
def damaged(draw: st.DrawFn, kept: list[bytes]) -> bytes:
    """A kept input with pieces cut out, doubled, overwritten, or taken from another."""
    data = draw(st.sampled_from(kept))
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(data)))
        end = draw(st.integers(start, min(start + 40, len(data))))
        other = draw(st.sampled_from(kept))
        at = draw(st.integers(0, len(other)))
        put = draw(st.sampled_from([b"", data[start:end] * 2, other[at : at + 40]]) | st.binary(max_size=8))
        data = data[:start] + put + data[end:]
    return data


@pytest.mark.parametrize("name", TARGETS)
def test_a_damaged_input_breaks_no_promise(name: str) -> None:
    @settings(max_examples=DAMAGES, derandomize=True)
    @given(damaged(list(INPUTS[name].values())))
    def damage(data: bytes) -> None:
        TARGETS[name].check(data)

    damage()


@pytest.mark.long
@pytest.mark.parametrize("name", TARGETS)
def test_new_inputs_led_by_coverage_break_no_promise(name: str, tmp_path: Path) -> None:
    script = Path(__file__).with_name("explore.py")
    seed = 0 if os.environ.get("NEW_EXAMPLES") else 1
    command = [sys.executable, script, name, f"--runs={NEW_INPUTS}", "--seconds=30", f"--seed={seed}"]
    explored = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    if explored.returncode == MISSING:
        pytest.skip("atheris is not installed: no coverage-guided fuzzing")
    assert explored.returncode == 0, explored.stderr[-3000:]
