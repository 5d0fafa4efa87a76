"""Viewer's connection to the simulated rig: the plate's ground truth, and the fingers held on the pad."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from pathlib import Path

import msgpack
import msgspec
import zmq
from msgspec.structs import astuple

from hapticd_contract.simulated import SimulatedTouch

FRESH_NS = 100_000_000  # an older message is from a stopped rig


_Pairs = tuple[tuple[float, float], ...]


class Truth(msgspec.Struct, frozen=True, rename={"fingers_mm": "fingers"}):
    """Ground truth: positions of the fingers, phasors of the modes, and the displacement at each finger."""

    t_ns: int
    fingers_mm: _Pairs
    modal_um: _Pairs
    truth_um: _Pairs


_TRUTH = msgspec.msgpack.Decoder(Truth)


def decode_truth(payload: bytes) -> Truth | None:
    """Decode a message of the rig's `truth` socket; None if it is invalid."""
    try:
        return _TRUTH.decode(payload)
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None


class TruthSubscriber:
    """Receives the newest ground truth. For one thread."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], directory: Path) -> None:
        self._last: Truth | None = None
        self._socket = context.socket(zmq.SUB)
        self._socket.linger = 0
        self._socket.conflate = True
        self._socket.subscribe(b"")
        self._socket.connect(f"ipc://{directory / 'truth'}")

    def newest(self, t_ns: int) -> Truth | None:
        """Return the newest message, None if it is older than FRESH_NS."""
        while self._socket.poll(0):
            self._last = decode_truth(self._socket.recv())
        return self._last if self._last is not None and t_ns - self._last.t_ns < FRESH_NS else None

    def close(self) -> None:
        self._socket.close()


class PadSender:
    """Holds fingers on the simulated pad. For one thread; messages are dropped, not delayed, without a receiver."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], directory: Path) -> None:
        self._socket = context.socket(zmq.PUSH)
        self._socket.linger = 0
        self._socket.immediate = True
        self._socket.sndhwm = 4
        self._socket.connect(f"ipc://{directory / 'fingers'}")

    def hold(self, touches: Mapping[str, SimulatedTouch]) -> None:
        """Send all fingers that are held now."""
        self._send({name: list(astuple(touch)) for name, touch in touches.items()})

    def lift_scripted(self) -> None:
        """Lift the scenario's fingers; to be repeated while they must not touch."""
        self._send(None)

    def _send(self, fingers: dict[str, list[float]] | None) -> None:
        with contextlib.suppress(zmq.Again):
            self._socket.send(msgpack.packb({"fingers": fingers}), zmq.NOBLOCK)

    def close(self) -> None:
        """Close the socket; the rig releases the fingers after a timeout."""
        self._socket.close()
