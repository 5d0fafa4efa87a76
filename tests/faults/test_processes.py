"""Faults that only real processes have: signals, and a reader of standard error that stalls."""

from __future__ import annotations

import os
import signal

import pytest
from service import Bench, drive

pytestmark = pytest.mark.long


def test_a_terminal_that_stalls_stalls_nobody_else(bench: Bench) -> None:
    bench.rig()
    reader, writer = os.pipe()
    try:
        os.set_blocking(writer, False)
        filled = 0
        while filled < 1 << 20:
            try:
                filled += os.write(writer, bytes(4096))
            except BlockingIOError:
                break
        os.set_blocking(writer, True)
        service = bench.service(stderr=writer)  # its very first line would block for ever
        drive(bench.client())
        assert service.end(signal.SIGTERM) == 0
    finally:
        os.close(reader)
        os.close(writer)
