"""Board and plate as another process, with the interface of `world.World`, in real time.

That plate is not damped by fingers; their positions only select where its ground truth is evaluated. The bench reports
the two driven modes every 2 ms; references are decoded from the frames on their way to the board.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ... import board_protocol as protocol
from ...wire.framing import FrameSplitter
from ..board.emulator import MODES, BenchReport, Emulator
from ..fingers.paths import Path as FingerPath
from ..world import PlateInstant, WorldRecording

_FRAME_MAX = 512  # encoded; a reference of two modes has at most 450 bytes
_KNOT = struct.Struct(f"<H{2 * MODES}f")


class Outboard:
    """A board in another process with the fingers of `paths`; t = 0 is the rig's start."""

    def __init__(self, paths: Sequence[FingerPath], program: Path, *, boot_id: int, keep: bool) -> None:
        self.t_s = 0.0
        self._paths = paths
        self._plate_um = np.zeros(MODES, dtype=np.complex128)
        self._keep = keep
        self._reports: list[tuple[int, BenchReport]] = []
        self._board_us = 0
        self._boot_s = math.inf
        self._references = ReferenceMonitor()
        self._emulator = Emulator(program, boot_id=boot_id)

    def close(self) -> None:
        """Stop the process."""
        self._emulator.close()

    def receive(self, data: bytes, t_s: float) -> None:
        """Deliver bytes to the board now, as it runs in real time."""
        del t_s
        self._emulator.write(data)
        if self._keep:
            self._references.feed(data, self._board_us)

    def advance(self, t_s: float) -> bytes:
        """Advance to `t_s`; return the board's output."""
        self.t_s = max(self.t_s, t_s)
        for report in self._emulator.reports():
            self._board_us = unwrapped_us(report.t_us, self._board_us)
            # Offset of the board's clock by the report with the least delay.
            self._boot_s = min(self._boot_s, t_s - self._board_us * 1e-6)
            self._plate_um = np.array(report.plate_um)
            if self._keep:
                self._reports.append((self._board_us, report))
        return self._emulator.read()

    @property
    def t_ahead_s(self) -> float:
        """As in World: finger positions are not computed ahead."""
        return self.t_s

    def now(self) -> PlateInstant:
        """Return the fingers now, and the bench's last report."""
        finger_mm = np.array([path.position_mm(np.array([self.t_s]))[0] for path in self._paths]).reshape(-1, 2)
        return PlateInstant(finger_mm, self._plate_um)

    def recording(self) -> WorldRecording:
        """Return the history at the instants of the bench's reports; of a user's fingers only recent positions."""
        t_us = np.array([board_us for board_us, _ in self._reports], dtype=np.int64)
        plate_um = np.array([report.plate_um for _, report in self._reports], dtype=np.complex128).reshape(-1, MODES)
        t_s = np.asarray(t_us * 1e-6 + self._boot_s, dtype=np.float64)
        finger_mm = np.full((len(t_s), len(self._paths), 2), np.nan)
        for index, path in enumerate(self._paths):
            finger_mm[:, index] = path.position_mm(t_s)
        return WorldRecording(
            t_s=t_s,
            finger_mm=finger_mm,
            reference_um=self._references.at(t_us),
            plate_um=plate_um,
            flags=np.zeros(len(t_s), dtype=np.uint8),
        )


def unwrapped_us(t_us: int, near_us: int) -> int:
    """Unwrap a 32-bit clock: return the instant nearest to `near_us` that it shows as `t_us`."""
    half = 1 << 31
    return near_us + (t_us - near_us + half) % (1 << 32) - half


class ReferenceMonitor:
    """Decoder of references on their way to a board: polylines in its time (`firmware/PROTOCOL.md`)."""

    def __init__(self) -> None:
        self._splitter = FrameSplitter(_FRAME_MAX)
        self._polylines: list[tuple[npt.NDArray[np.float64], npt.NDArray[np.complex128]]] = []

    def feed(self, data: bytes, near_us: int) -> None:
        """Decode bytes to the board, in pieces of any size, at about `near_us` of its unwrapped clock."""
        for frame in self._splitter.feed(data):
            if frame[0] == protocol.MSG_REFERENCE:
                self._add(frame[1:], near_us)

    def _add(self, payload: bytes, near_us: int) -> None:
        _, t_apply_us, _, modes = protocol.REFERENCE.unpack_from(payload)
        knots = np.array(list(_KNOT.iter_unpack(payload[protocol.REFERENCE.size :])))
        assert modes == MODES, "the daemon refuses a board of other modes"
        t_us = unwrapped_us(t_apply_us, near_us) + knots[:, 0] * (protocol.KNOT_UNIT_NS // 1000)
        self._polylines.append((t_us, knots[:, 1::2] + 1j * knots[:, 2::2]))

    def at(self, t_us: npt.NDArray[np.int64]) -> npt.NDArray[np.complex128]:
        """Return the reference (T, M) in um at rising instants of the board's clock, without its ramps and limits.

        From its first knot on, a frame replaces the earlier ones.
        """
        reference_um = np.zeros((len(t_us), MODES), dtype=np.complex128)
        for knot_us, modal_um in self._polylines:
            part = t_us >= knot_us[0]
            for mode in range(MODES):
                reference_um[part, mode] = np.interp(t_us[part], knot_us, modal_um[:, mode])
        return reference_um
