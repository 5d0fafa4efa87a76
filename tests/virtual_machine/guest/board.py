"""A board on USB: a serial gadget on a bus in memory (dummy_hcd), and behind its end the firmware's own C in a process
of its own. Files: the kernel's `Documentation/usb/gadget_configfs.rst`.

    python board.py TRACE

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

GADGET = Path("/sys/kernel/config/usb_gadget/board")
PORT, GADGET_END = Path("/dev/ttyACM0"), Path("/dev/ttyGS0")
TICK_NS = 500_000
STEP_S = 0.004
MOST_TICKS = 1000  # after a longer pause time is dropped, as a board that was stopped would


def plug_in() -> None:
    """Connect a serial port with a board's ids."""
    _write(GADGET, idVendor="0x0483", idProduct="0x5740", bcdDevice="0x0110")
    _write(GADGET / "strings/0x409", manufacturer="tests", product="virtual board", serialnumber="1")
    _write(GADGET / "configs/c.1", MaxPower="500")
    (GADGET / "functions/acm.0").mkdir(parents=True)
    (GADGET / "configs/c.1/acm.0").symlink_to(GADGET / "functions/acm.0")
    _write(GADGET, UDC=os.listdir("/sys/class/udc")[0])


def _write(folder: Path, **values: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, value in values.items():
        (folder / name).write_text(f"{value}\n")


def main(trace: Path) -> None:
    config = BoardConfig()
    gain = np.diag(config.gain_um_per_v_s)
    model = PlateModel(
        np.array(config.decay_1_s), np.array(config.detuning_rad_s), gain, np.eye(2), 0.0, config.v_limit_v
    )
    fd = os.open(GADGET_END, os.O_RDWR | os.O_NONBLOCK | os.O_NOCTTY)
    tty.setraw(fd)
    with trace.open("w", buffering=1) as lines:
        _serve(Board(model, config=config, boot_id=7), fd, lines.write)


def _serve(board: Board, fd: int, write: object) -> None:
    """Runs until the plug is pulled."""
    assert callable(write)
    rows = BoardTrace(MOST_TICKS, 2, 2)
    no_finger = np.zeros((MOST_TICKS, 0, 2)), np.zeros((MOST_TICKS, 0))
    t_board_ns = time.monotonic_ns()
    while True:
        is_readable = bool(select.select([fd], [], [], STEP_S)[0])
        behind_ticks = (time.monotonic_ns() - t_board_ns) // TICK_NS  # its clock is that of the host before it reads
        t_board_ns += behind_ticks * TICK_NS
        if behind_ticks > 0:
            board.run(min(behind_ticks, MOST_TICKS), *no_finger, rows)
            write(f"{time.monotonic_ns()} {np.abs(rows.plate_um[min(behind_ticks, MOST_TICKS) - 1]).max():.4f}\n")
        if is_readable:
            board.receive(os.read(fd, 4096))
        while reply := board.transmit():
            with contextlib.suppress(BlockingIOError):  # the other end is not open
                os.write(fd, reply)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
