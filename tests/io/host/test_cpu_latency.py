"""Processors are kept awake while fingers are down, for a moment after, and never by a daemon that is gone."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from hapticd.io.host.cpu_latency import LINGER_NS, CpuLatencyHold

T0_NS = 1 << 53
KERNELS_OWN_US = 2_000_000_000


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "cpu_dma_latency"
    path.touch()
    return path


def wishes_us(file: Path) -> list[int]:
    """What was written, as the kernel reads it: one signed 32-bit number a time."""
    return [number for (number,) in struct.iter_unpack("=i", file.read_bytes())]


def test_a_touch_keeps_them_awake_at_once_and_for_a_moment_after_the_last(file: Path) -> None:
    awake = CpuLatencyHold(file)
    for t_ns, is_touched, written in (
        (0, True, [0]),
        (10, True, [0]),
        (10 + LINGER_NS - 1, False, [0]),
        (10 + LINGER_NS, False, [0, KERNELS_OWN_US]),
        (9 * LINGER_NS, False, [0, KERNELS_OWN_US]),
        (10 * LINGER_NS, True, [0, KERNELS_OWN_US, 0]),
    ):
        awake.look(is_touched, T0_NS + t_ns)
        assert wishes_us(file) == written
    awake.close()
