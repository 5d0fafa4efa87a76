"""A board on USB: the firmware's own C in a process of its own, behind the gadget's end of a serial port.

    python board.py PORT TRACE

It runs on the guest's clock, with the reference plate's two modes and nothing else: no other modes, no noise, no finger
that damps, no delay but USB's. TRACE gets a line for every step: the instant in ns, the plate's larger amplitude in um.
"""

from __future__ import annotations

import contextlib
import os
import select
import sys
import time
import tty
from pathlib import Path

import numpy as np

from hapticd.sim.board.board import Board, BoardConfig, BoardTrace, PlateModel

TICK_NS = 500_000
STEP_TICKS = 8  # 4 ms
MAX_BEHIND_TICKS = 1000  # after a longer pause time is dropped, as a board that was stopped would


def main(port: Path, trace: Path) -> None:
    config = BoardConfig()
    gain = np.diag(config.gain_um_per_v_s)
    model = PlateModel(
        np.array(config.decay_1_s), np.array(config.detuning_rad_s), gain, np.eye(2), 0.0, config.v_limit_v
    )
    fd = os.open(port, os.O_RDWR | os.O_NONBLOCK | os.O_NOCTTY)
    tty.setraw(fd)
    with trace.open("w", buffering=1) as lines:
        _serve(Board(model, config=config, boot_id=7), fd, lines.write)


def _serve(board: Board, fd: int, write: object) -> None:
    """Until the plug is pulled."""
    assert callable(write)
    rows = BoardTrace(STEP_TICKS, 2, 2)
    no_finger = np.zeros((STEP_TICKS, 0, 2)), np.zeros((STEP_TICKS, 0))
    t_next_ns = time.monotonic_ns()
    while True:
        wait_s = max(t_next_ns - time.monotonic_ns(), 0) * 1e-9
        if select.select([fd], [], [], wait_s)[0]:
            board.receive(os.read(fd, 4096))
        behind_ticks = (time.monotonic_ns() - t_next_ns) // TICK_NS
        if behind_ticks < 0:
            continue
        t_next_ns += (STEP_TICKS + (behind_ticks if behind_ticks > MAX_BEHIND_TICKS else 0)) * TICK_NS
        board.run(STEP_TICKS, *no_finger, rows)
        write(f"{time.monotonic_ns()} {np.abs(rows.plate_um[-1]).max():.4f}\n")
        while said := board.transmit():
            with contextlib.suppress(BlockingIOError):  # the other end is not open
                os.write(fd, said)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
