"""States as a daemon publishes them, and a fake of the daemon's sockets."""

from __future__ import annotations

from pathlib import Path

import msgpack
import zmq

from hapticd_client import FingerState, Marker, PlateState


def finger(key: int | str, x_mm: float = 0.0, **more: float | None) -> FingerState:
    """One finger; values not given are None."""
    fields = {"predicted_x_mm": None, "predicted_y_mm": None, "target_um": None, "achieved_um": None, **more}
    return FingerState(id=key, x_mm=x_mm, y_mm=2.0, virtual=isinstance(key, str), **fields)


def plate_state(*fingers: FingerState, markers: tuple[Marker, ...] = ()) -> PlateState:
    """A state of a plate with two modes."""
    return PlateState(
        instance=7,
        seq=1,
        t_ns=5_010_000_000,
        state="ACTIVE",
        fingers=fingers,
        modal_um=(1.5, -0.5),
        limited=False,
        age_ms=10.0,
        horizon_ms=16.5,
        markers=markers,
        modal_q_um=(0.0, 0.25),
        measured_d_q_um=((1.25, 0.5), (-0.5, 0.0)),
    )


class FakeDaemon:
    """The `telemetry` and `control` sockets of a daemon, in a directory of its own."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self.context = zmq.Context()
        self.telemetry = self.context.socket(zmq.XPUB)
        self.control = self.context.socket(zmq.ROUTER)
        for socket, name in ((self.telemetry, "telemetry"), (self.control, "control")):
            socket.linger = 0
            socket.bind(f"ipc://{directory / name}")

    def wait_for_subscriber(self) -> None:
        assert self.telemetry.poll(10_000), "no subscriber"
        self.telemetry.recv()

    def publish(self, fields: dict[str, object]) -> None:
        self.telemetry.send(msgpack.packb({"v": 1, **fields}))

    def answer(self, body: dict[str, object]) -> str:
        """Answer one request; return its operation."""
        assert self.control.poll(10_000), "no request"
        who, payload = self.control.recv_multipart()
        request = msgpack.unpackb(payload)
        self.control.send_multipart([who, msgpack.packb({"v": 1, "id": request["id"], "ok": True, "body": body})])
        return str(request["op"])

    def close(self) -> None:
        self.telemetry.close()
        self.control.close()
        self.context.term()


def state_fields(seq: int = 1, **more: object) -> dict[str, object]:
    """Fields of a telemetry message, except its version."""
    return {
        "instance": 7,
        "seq": seq,
        "t_ns": 5_000_000_000 + seq * 10_000_000,
        "state": "ARMED",
        "fingers": [],
        "modal_um": [0.0, 0.0],
        "limited": False,
        "age_ms": 10.0,
        "horizon_ms": 16.5,
        **more,
    }
