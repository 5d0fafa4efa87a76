"""A daemon without a plate: the real sockets, the real decoder and the real scene, on a thread of its own."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Mapping
from pathlib import Path

from hapticd.content_values import ClientTargets
from hapticd.core.targets.client_registry import ClientRegistry
from hapticd.core.targets.scene import Scene
from hapticd.daemon.layers import described
from hapticd.errors import RequestError
from hapticd.io.clients.server import ClientServer
from hapticd.io.clients.sockets import Remote
from hapticd.values import EventKind, PlateEvent
from hapticd.wire import client as wire
from hapticd.wire.assets import AssetPart

TICK_S = 0.005


class FakeDaemon:
    """Fingers are at `fingers`, and achieve exactly their targets."""

    def __init__(self, directory: Path, remote: Remote | None = None) -> None:
        self.directory = directory
        self.remote = remote
        self.size_mm = (137.5, 137.5)
        self.fingers: dict[int, tuple[float, float]] = {}
        self.protocol = wire.PROTOCOL_VERSION
        self.messages = 0
        self.overtaken = 0
        self.stamps: list[int | None] = []
        self.reach = [0.25, 0.75]
        self.optional = tuple(map(str, wire.CAPABILITIES["optional"]))
        self.refusals: list[str] = []
        self.released: list[int | str] = []
        self.fault_cleared = False
        self.markers: list[wire.Marker] = []
        self.happens: list[EventKind] = []  # one event in each state
        self._instance = 0
        self._seq = self._events = 0

    def start(self) -> None:
        """Begin to serve, as a new instance with an empty scene."""
        self._instance += 1
        self.scene = Scene(w_limit_um=4.0)
        self.client_registry = ClientRegistry()
        self.server = ClientServer(self.directory, self.remote)
        self._loop = asyncio.new_event_loop()
        ready = threading.Event()
        self._thread = threading.Thread(target=self._serve, args=(ready,))
        self._thread.start()
        assert ready.wait(5.0)

    def stop(self) -> None:
        """Stop as if killed, without notice."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join(5.0)

    def felt_um(self, x_mm: float, y_mm: float = 0.0) -> float:
        """What the surfaces give a finger there now."""
        return self.scene.surfaces.amplitude_um(x_mm, y_mm, time.monotonic_ns())

    def _serve(self, ready: threading.Event) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.call_soon(self._begin, ready)
        self._loop.run_forever()
        self.server.close()
        self._loop.run_until_complete(asyncio.sleep(0))  # whatever was cancelled ends
        self._loop.close()

    def _begin(self, ready: threading.Event) -> None:
        self.server.start(
            self._loop,
            self._on_message,
            lambda payload, user: wire.answer(payload, lambda request: self._handle(request, user)),
        )
        self._tick()
        ready.set()

    def _tick(self) -> None:
        self.server.sweep()
        self.released += self.scene.expire(time.monotonic_ns())
        if self.server.has_subscribers:
            self.server.publish(wire.encode_state(self._state(time.monotonic_ns())))
        self._loop.call_later(TICK_S, self._tick)

    def _on_message(self, payload: bytes, user: str) -> None:
        self.messages += 1
        try:
            targets = wire.decode_targets(payload)
            if self._is_newest(targets, user):
                self.refusals += self._apply(targets)
        except RequestError as error:
            self.refusals.append(str(error))

    def _apply(self, targets: ClientTargets) -> tuple[str, ...]:
        t_ns = time.monotonic_ns()
        refusals = self.scene.apply(targets, t_ns)
        self.released += self.scene.expire(t_ns)
        return refusals

    def _is_newest(self, message: ClientTargets | wire.Release, user: str) -> bool:
        self.stamps.append(message.stamp)
        is_newest = self.client_registry.is_newest(message.client, user, message.stamp, 0, time.monotonic_ns())
        self.overtaken += not is_newest
        return is_newest

    def _handle(self, request: wire.Request, user: str) -> Mapping[str, object]:
        if isinstance(request.body, wire.Marker):
            self.markers.append(request.body)
            return {"t_ns": time.monotonic_ns()}
        if isinstance(request.body, AssetPart):
            one, t_ns = request.body, time.monotonic_ns()
            return {"have": self.scene.upload(one.client, one.digest, one.size, one.offset, one.part, t_ns)}
        if isinstance(request.body, wire.ReachQuery):
            return {"friction": self.reach if request.body.finger in (None, *self.fingers) else None}
        if request.body is not None and not self._is_newest(request.body, user):
            raise RequestError("A newer message came before.")
        match request.op, request.body:
            case "hello", _:
                known = {"protocol": self.protocol, "optional": self.optional}
                return {**wire.CAPABILITIES, **known, "version": "0.0", "instance": self._instance}
            case "capabilities", _:
                return wire.CAPABILITIES
            case "status", _:
                return {"messages": self.messages, "t_ns": time.monotonic_ns()}
            case "surfaces", _:
                surfaces, assets = self.scene.surfaces, self.scene.assets
                return {"version": surfaces.version, "surfaces": [described(one, assets) for one in surfaces.layers]}
            case "plate", _:
                return {"size_mm": self.size_mm}
            case "clear_fault", _:
                self.fault_cleared = True
            case "set", ClientTargets() as targets:
                refusals = self._apply(targets)
                if refusals:
                    raise RequestError(" ".join(refusals))
            case "release", wire.Release(client, finger, _):
                if finger is None:
                    self.scene.release_client(client)
                return {"released": finger is None or self.scene.release(client, finger)}
        return {}

    def _state(self, t_ns: int) -> wire.PlateState:
        self._seq += 1
        places: dict[int | str, tuple[float, float]] = dict(self.fingers.items())
        for name in self.scene.virtual_names(t_ns):
            places[name] = self.scene.virtual_position_mm(name, t_ns)
        fingers = []
        for key, (x_mm, y_mm) in places.items():
            wanted_um = self.scene.amplitude_um(key, x_mm, y_mm)
            fingers.append(wire.FingerState(key, x_mm, y_mm, x_mm, y_mm, wanted_um, wanted_um, isinstance(key, str)))
        state = wire.PlateState(
            self._instance, self._seq, t_ns, "ACTIVE", tuple(fingers), (1.0, 2.0), False, 10.0, 16.0
        )
        return state._replace(events=tuple(self._event(self.happens.pop(0), t_ns) for _ in self.happens[:1]))

    def _event(self, kind: EventKind, t_ns: int) -> PlateEvent:
        self._events += 1
        return PlateEvent(self._events, kind, t_ns, t_ns - 10, 1, (2.0, 3.0), "me", "", "click")
