"""What a person, or a viewer for them, has to do with the simulated rig: two ZeroMQ sockets in its directory.

    truth     XPUB   the plate's true motion some 100 times a second, while somebody listens
    fingers   PULL   the fingers that a person holds on the pad now; they take the place of the scenario's

Each message is one MessagePack map:

    truth     {"t_ns": .., "paths": .., "path": [.., ..], "fingers": [[x_mm, y_mm], ..], "modal_um": [[d, q], ..],
               "truth_um": [[d, q], ..]}
    fingers   {"fingers": {"1": [x_mm, y_mm], ..}}

`t_ns` is the host's monotonic clock; `fingers` are those that touch, `path` which of the rig's `paths` fingers each is:
the scenario's first, then a person's; `modal_um` are all modes of the plate, the driven ones first; `truth_um` is the
complex displacement under each finger that touches, peak to peak. A sender of fingers repeats them: one that is silent
for `hands.SILENT_S` has let go of all.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgpack
import numpy as np
import numpy.typing as npt
import zmq

from ...errors import DeviceError, RequestError
from ..fingers.hands import Point, decode_hands
from ..world import Instant

ENDPOINTS = ("truth", "fingers")
PERIOD_S = 0.01  # between two truths
MAX_MESSAGE_BYTES = 4096
HIGH_WATER = 16


class RigSockets:
    """Both sockets, bound in `directory` until `close`. Raises DeviceError where they cannot be."""

    def __init__(self, directory: Path) -> None:
        self.refused = 0  # messages that hold no fingers
        self._is_subscribed = False
        self._t_told_s = 0.0
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
            raise DeviceError(f"{directory}: the rig's sockets cannot be here ({error.strerror}).") from None

    def wants_truth(self, t_s: float) -> bool:
        """Somebody listens, and the next truth is due."""
        while True:
            try:
                self._is_subscribed = self._truth.recv(zmq.NOBLOCK)[:1] == b"\x01"
            except zmq.Again:
                return self._is_subscribed and t_s - self._t_told_s >= PERIOD_S

    def tell(self, t_s: float, t_ns: int, now: Instant, truth_um: npt.NDArray[np.complex128]) -> None:
        """Publish what the plate does at `t_s` of the rig, `t_ns` of the host, and what is under each finger (F,)."""
        self._t_told_s = t_s
        touching = np.flatnonzero(np.isfinite(now.finger_mm[:, 0]))
        message = {
            "t_ns": t_ns,
            "paths": len(now.finger_mm),
            "path": touching.tolist(),
            "fingers": now.finger_mm[touching].tolist(),
            "modal_um": [[w_um.real, w_um.imag] for w_um in now.plate_um.tolist()],
            "truth_um": [[w_um.real, w_um.imag] for w_um in truth_um[touching].tolist()],
        }
        self._truth.send(msgpack.packb(message), zmq.NOBLOCK)

    def held(self) -> Iterator[dict[str, Point]]:
        """What the senders of fingers have said since the last call; what is no such message is counted."""
        while True:
            try:
                yield decode_hands(self._fingers.recv(zmq.NOBLOCK))
            except RequestError:
                self.refused += 1
            except zmq.Again:
                return

    def close(self) -> None:
        """Close both and remove their files."""
        self._context.destroy(linger=0)
        for path in self._paths:
            path.unlink(missing_ok=True)
