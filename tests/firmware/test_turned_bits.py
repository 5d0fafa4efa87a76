"""A bit of the memory of core, carrier or sine table turns over while the board drives the independent plate."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import NamedTuple

import pytest

from hapticd.board_protocol import FAULTS

from .built import built

MEMORY_FAULT = 11
CHECKED_TICKS = 8  # the carrier's scales, within so many (firmware/core/memory.h)
CHUNK_MS = 0.05


class Case(NamedTuple):
    """One line of firmware/bench/cases.c."""

    seed: int
    control_hz: float
    peak: float  # of W_LIM
    fault: int
    where: str
    over_ms: float  # for which a voltage above its limit was played without a pause


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built("cases-2modes", tmp_path_factory)


def cases(program: Path, count: int) -> list[Case]:
    ran = subprocess.run([program, "flipped", str(count)], check=True, capture_output=True, text=True)
    words = [line.split() for line in ran.stdout.splitlines()]
    return [Case(int(w[0]), float(w[3]), float(w[8]), int(w[9]), w[10], float(w[13])) for w in words]


def check(found: list[Case]) -> None:
    for case in found:
        assert case.peak <= 1.6, case  # at most 1.13 in 15 000
        assert case.over_ms <= 1e3 * (CHECKED_TICKS + 1) / case.control_hz + CHUNK_MS, case


def test_a_turned_bit_leaves_neither_an_amplitude_nor_a_voltage_far_above_its_limit(program: Path) -> None:
    found = cases(program, 80)
    check(found)
    assert sum(case.fault == MEMORY_FAULT for case in found) >= 15
    assert {case.where for case in found} == {"tick", "carrier", "core", "table"}


@pytest.mark.long
def test_six_hundred_of_them_do_not_either(program: Path) -> None:
    check(cases(program, 600))


def test_the_fault_says_that_only_a_reset_helps() -> None:
    assert "reset" in FAULTS[MEMORY_FAULT]
