"""The physical half of the rig where board and plate are another process: the calls of `world.World`, in real time.

The plate there feels no fingers, so they only say where its truth is looked at. Of the plate the bench tells the two
driven modes, every 2 ms; what the daemon asked of it is read off the frames on their way to the board.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ...wire import protocol
from ...wire.framing import FrameSplitter
from ..fingers.paths import Path as FingerPath
from ..world import Instant, Recording
from .emulator import MODES, BenchReport, Emulator

_FRAME_MAX = 512  # encoded; a reference of two modes has at most 450 bytes
_KNOT = struct.Struct(f"<H{2 * MODES}f")


class Outboard:
    """A board in another process, with the fingers of `paths` at its plate; t = 0 is the rig's start."""

    def __init__(self, paths: Sequence[FingerPath], program: Path, *, boot_id: int, keep: bool) -> None:
        self.t_s = 0.0
        self._paths = paths
        self._plate_um = np.zeros(MODES, dtype=np.complex128)
        self._keep = keep
        self._reports: list[tuple[int, BenchReport]] = []
        self._board_us = 0
        self._boot_s = math.inf
        self._asked = Overheard()
        self._emulator = Emulator(program, boot_id=boot_id)

    def close(self) -> None:
        """End the process."""
        self._emulator.close()

    def receive(self, data: bytes, t_s: float) -> None:
        """Bytes reach the board. It takes them now: it is real time that runs."""
        del t_s
        self._emulator.write(data)
        if self._keep:
            self._asked.feed(data, self._board_us)

    def advance(self, t_s: float) -> bytes:
        """Time has gone on to `t_s`: what the board has said since."""
        self.t_s = max(self.t_s, t_s)
        for report in self._emulator.reports():
            self._board_us = unwrapped_us(report.t_us, self._board_us)
            # The board's clock against the rig's, by the report that was fastest: nothing arrives before it is sent.
            self._boot_s = min(self._boot_s, t_s - self._board_us * 1e-6)
            self._plate_um = np.array(report.plate_um)
            if self._keep:
                self._reports.append((self._board_us, report))
        return self._emulator.read()

    @property
    def t_ahead_s(self) -> float:
        """Nobody has been asked where the fingers will be: this plate does not feel them."""
        return self.t_s

    def now(self) -> Instant:
        """The fingers now, and what the bench saw last."""
        finger_mm = np.array([path.position_mm(np.array([self.t_s]))[0] for path in self._paths]).reshape(-1, 2)
        return Instant(finger_mm, self._plate_um)

    def recording(self) -> Recording:
        """Everything so far, at the instants of the bench's reports; of a person's fingers only the newest places."""
        t_us = np.array([board_us for board_us, _ in self._reports], dtype=np.int64)
        plate_um = np.array([report.plate_um for _, report in self._reports], dtype=np.complex128).reshape(-1, MODES)
        t_s = np.asarray(t_us * 1e-6 + self._boot_s, dtype=np.float64)
        finger_mm = np.full((len(t_s), len(self._paths), 2), np.nan)
        for index, path in enumerate(self._paths):
            finger_mm[:, index] = path.position_mm(t_s)
        return Recording(
            t_s=t_s,
            finger_mm=finger_mm,
            reference_um=self._asked.at(t_us),
            measured_um=plate_um,
            plate_um=plate_um,
            flags=np.zeros(len(t_s), dtype=np.uint8),
        )


def unwrapped_us(t_us: int, near_us: int) -> int:
    """The instant nearest to `near_us` that a 32-bit clock shows as `t_us`."""
    half = 1 << 31
    return near_us + (t_us - near_us + half) % (1 << 32) - half


class Overheard:
    """The references on their way to a board: polylines in its time, as `firmware/PROTOCOL.md` lays them out."""

    def __init__(self) -> None:
        self._splitter = FrameSplitter(_FRAME_MAX)
        self._lines: list[tuple[npt.NDArray[np.float64], npt.NDArray[np.complex128]]] = []

    def feed(self, data: bytes, near_us: int) -> None:
        """Bytes to the board, in pieces of any size, at about `near_us` of its clock, which does not wrap."""
        for frame in self._splitter.feed(data):
            if frame[0] == protocol.MSG_REFERENCE:
                self._take(frame[1:], near_us)

    def _take(self, payload: bytes, near_us: int) -> None:
        _, t_apply_us, _, modes = protocol.REFERENCE.unpack_from(payload)
        knots = np.array(list(_KNOT.iter_unpack(payload[protocol.REFERENCE.size :])))
        assert modes == MODES, "the daemon refuses a board of other modes"
        t_us = unwrapped_us(t_apply_us, near_us) + knots[:, 0] * (protocol.KNOT_UNIT_NS // 1000)
        self._lines.append((t_us, knots[:, 1::2] + 1j * knots[:, 2::2]))

    def at(self, t_us: npt.NDArray[np.int64]) -> npt.NDArray[np.complex128]:
        """(T, M) um: what was asked for at rising instants of the board's clock. From its first knot on a later frame
        takes the place of those before it; ramps and limits of the board are not in it."""
        asked_um = np.zeros((len(t_us), MODES), dtype=np.complex128)
        for line_us, modal_um in self._lines:
            part = t_us >= line_us[0]
            for mode in range(MODES):
                asked_um[part, mode] = np.interp(t_us[part], line_us, modal_um[:, mode])
        return asked_um
