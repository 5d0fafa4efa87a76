"""Any bytes to any decoder: its own error or a sound value, at a bounded cost. Kept and new inputs."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from pathlib import Path

import pytest

from fuzz import clients, devices, files
from fuzz.explore import MISSING
from fuzz.target import measured

TARGETS = {target.name: target for target in (*devices.TARGETS, *clients.TARGETS, *files.TARGETS)}
NEW_INPUTS = 500  # to each decoder, a second at most: `make fuzz` tries as many as it has time for
INPUTS = {name: target.inputs() for name, target in TARGETS.items()}
each = pytest.mark.parametrize("name", TARGETS)


def check_cost(name: str, data: bytes) -> bool:
    cost, allowed = measured(TARGETS[name].check, data), TARGETS[name].allowed(len(data))
    assert cost.lines <= allowed.lines
    assert cost.peak_bytes <= allowed.peak_bytes
    return TARGETS[name].check(data)


@each
def test_inputs_keep_the_promises_at_a_bounded_cost_and_some_mean_something(name: str) -> None:
    understood = [check_cost(name, data) for data in INPUTS[name].values()]
    assert any(understood)  # a corpus of an old form means nothing


@pytest.mark.long
def test_what_strains_a_decoder_most_stays_within_its_bounds() -> None:
    for data in clients.client_extremes().values():
        check_cost("client", data)


@each
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


@pytest.mark.long
@each
def test_new_inputs_led_by_coverage_break_no_promise(name: str, tmp_path: Path) -> None:
    script = Path(__file__).with_name("explore.py")
    seed = 0 if os.environ.get("NEW_EXAMPLES") else 1
    command = [sys.executable, script, name, f"-runs={NEW_INPUTS}", "--seconds=30", f"-seed={seed}"]
    explored = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    if explored.returncode == MISSING:
        pytest.skip("atheris is not installed: no coverage-guided fuzzing")
    assert explored.returncode == 0, explored.stderr[-3000:]
