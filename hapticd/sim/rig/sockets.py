"""Sockets of the simulated rig for a viewer: two ZeroMQ sockets in its directory.

    truth     XPUB   the plate's ground truth, up to 100 times a second, while subscribed
    fingers   PULL   a sender's fingers that are down now, in place of the scenario's. Nil lifts the scenario's

Each message is one MessagePack map:

    truth     {"t_ns": .., "fingers": [[x_mm, y_mm], ..], "modal_um": [[d, q], ..], "truth_um": [[d, q], ..]}
    fingers   {"fingers": {"1": [x_mm, y_mm], ..}} or {"fingers": nil}, of `hapticd_contract.simulated`; a finger may
              have its pressure and its contact behind its place, a message its "sender"

`t_ns` is the host's monotonic clock; `fingers` are those that touch; `modal_um` are all modes of the plate, driven ones
first; `truth_um` is the complex displacement under each finger, peak to peak. A sender repeats its message: after
`hands.TIMEOUT_S` without one its fingers lift, or the scenario's land again; after fingers these wait `RETURN_S`.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgpack
import numpy as np
import numpy.typing as npt
import zmq

from hapticd_contract.simulated import SimulatedTouches

from ...errors import DeviceError, RequestError
from ..fingers.hands import decode_hands
from ..world import PlateInstant

ENDPOINTS = ("truth", "fingers")
PERIOD_S = 0.01  # between two messages of truth
MAX_MESSAGE_BYTES = 4096
HIGH_WATER = 16


class RigSockets:
    """Both sockets, bound in `directory` until `close`. Raises DeviceError if that fails."""

    def __init__(self, directory: Path) -> None:
        self._is_subscribed = False
        self._t_sent_s = 0.0
        self._paths = [directory / name for name in ENDPOINTS]
        self._context = zmq.Context()
        self._truth, self._fingers = self._context.socket(zmq.XPUB), self._context.socket(zmq.PULL)
        try:
            for socket, path in zip((self._truth, self._fingers), self._paths, strict=True):
                socket.linger, socket.rcvhwm, socket.sndhwm = 0, HIGH_WATER, HIGH_WATER
                socket.maxmsgsize = MAX_MESSAGE_BYTES
                socket.bind(f"ipc://{path}")
        except zmq.ZMQError as error:
            self.close()
            raise DeviceError(f"{directory}: the rig's sockets cannot be bound ({error.strerror}).") from None

    def is_truth_due(self, t_s: float) -> bool:
        """Return whether there is a subscriber and the next message is due."""
        while True:
            try:
                self._is_subscribed = self._truth.recv(zmq.NOBLOCK)[:1] == b"\x01"
            except zmq.Again:
                return self._is_subscribed and t_s - self._t_sent_s >= PERIOD_S

    def publish(self, t_s: float, t_ns: int, now: PlateInstant, truth_um: npt.NDArray[np.complex128]) -> None:
        """Publish the plate at `t_s` (rig) or `t_ns` (host), with the displacement under each finger (F,)."""
        self._t_sent_s = t_s
        touching = np.flatnonzero(np.isfinite(now.finger_mm[:, 0]))
        message = {
            "t_ns": t_ns,
            "fingers": now.finger_mm[touching].tolist(),
            "modal_um": [[w_um.real, w_um.imag] for w_um in now.plate_um.tolist()],
            "truth_um": [[w_um.real, w_um.imag] for w_um in truth_um[touching].tolist()],
        }
        self._truth.send(msgpack.packb(message), zmq.NOBLOCK)

    def held(self) -> Iterator[SimulatedTouches]:
        """Yield the messages of fingers since the last call; invalid ones are left out."""
        while True:
            try:
                yield decode_hands(self._fingers.recv(zmq.NOBLOCK))
            except RequestError:
                continue
            except zmq.Again:
                return

    def close(self) -> None:
        """Close both and remove their files."""
        self._context.destroy(linger=0)
        for path in self._paths:
            path.unlink(missing_ok=True)
