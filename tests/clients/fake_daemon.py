"""A daemon without a plate: the real sockets, the real decoder and the real scene, on a thread of its own."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Mapping
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from hapticd import __version__
from hapticd.core.targets.scene import Scene
from hapticd.daemon.client_gateway import described
from hapticd.daemon.client_registry import ClientRegistry
from hapticd.errors import RequestError
from hapticd.io.clients.server import ClientServer
from hapticd.io.clients.sockets import Remote
from hapticd.wire import client as wire
from hapticd_contract import requests
from hapticd_contract.base import PROTOCOL_VERSION
from hapticd_contract.replies import Capabilities, Have, Hello, Reach, Released, Surfaces
from hapticd_contract.states import EventKind, FingerState, PlateEvent, PlateState
from hapticd_contract.targets import ClientTargets

TICK_S = 0.005


class FakeDaemon:
    """Fingers are at `fingers`, and achieve exactly their targets."""

    def __init__(self, directory: Path, remote: Remote | None = None) -> None:
        self.directory = directory
        self.remote = remote
        self.size_mm = (137.5, 137.5)
        self.modal_um: tuple[float, ...] = (1.0, 2.0)
        self.status: Mapping[str, object] = {}  # more than its own
        self.fingers: dict[int, tuple[float, float]] = {}
        self.protocol = PROTOCOL_VERSION
        self.messages = 0
        self.overtaken = 0
        self.stamps: list[int | None] = []
        self.reach = (0.25, 0.75)
        self.persons: dict[str | None, str] = {None: "", "anna": "It is old."}
        self.person: str | None = None
        self.optional = Capabilities().optional
        self.refusals: list[str] = []
        self.released: list[int | str] = []
        self.fault_cleared = False
        self.markers: list[requests.MarkerRequest] = []
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
            lambda payload, user, _: wire.answer(payload, lambda request: self._handle(request, user)),
        )
        self._tick()
        ready.set()

    def _tick(self) -> None:
        self.server.sweep()
        self.released += self.scene.expire(time.monotonic_ns())
        if self.server.has_subscribers:
            self.server.publish(wire.encode_state(self._state(time.monotonic_ns())))
        self._loop.call_later(TICK_S, self._tick)

    def _on_message(self, payload: bytes, user: str, _waited_ns: int) -> None:
        self.messages += 1
        try:
            targets = wire.decode_targets(payload)
            if self._is_newest(targets, user):
                self.refusals += self._apply(targets)
        except RequestError as error:
            self.refusals.append(str(error))

    def _apply(self, targets: ClientTargets) -> tuple[str, ...]:
        t_ns = time.monotonic_ns()
        refusals = self.scene.set_targets(targets, t_ns)
        self.released += self.scene.expire(t_ns)
        return refusals

    def _is_newest(self, message: ClientTargets | requests.Release, user: str) -> bool:
        self.stamps.append(message.stamp)
        is_newest = self.client_registry.is_newest(message.client, user, message.stamp, 0, time.monotonic_ns())
        self.overtaken += not is_newest
        return is_newest

    def _handle(self, request: requests.Request, user: str) -> Struct | Mapping[str, object]:
        t_ns = time.monotonic_ns()
        match request:
            case requests.MarkRequest(body=marker):
                self.markers.append(marker)
                return {"t_ns": t_ns}
            case requests.AssetRequest(body=one):
                have = self.scene.upload(one.client, one.asset, one.size, one.offset or 0, one.part or b"", t_ns)
                return Have(have)
            case requests.PersonRequest(body=person):
                if person.name not in self.persons:
                    raise RequestError(f"There is no {person.name}.")
                self.person = person.name
                return {"note": self.persons[person.name]}
            case requests.ReachRequest(body=query):
                return Reach(self.reach if query.finger in (None, *self.fingers) else None)
            case requests.HelloRequest():
                hello = Hello(version=__version__, instance=self._instance, optional=self.optional)
                return replace(hello, protocol=self.protocol)
            case requests.CapabilitiesRequest():
                return Capabilities()
            case requests.StatusRequest():
                return {"messages": self.messages, "t_ns": t_ns, **self.status}
            case requests.SurfacesRequest():
                surfaces, assets = self.scene.surfaces, self.scene.assets
                return Surfaces(surfaces.version, tuple(described(one, assets) for one in surfaces.layers))
            case requests.PlateRequest():
                return {"size_mm": self.size_mm}
            case requests.ClearFaultRequest():
                self.fault_cleared = True
                return {}
            case requests.SetRequest() | requests.ReleaseRequest():
                if not self._is_newest(request.body, user):
                    raise RequestError("A newer message came before.")
                return self._change(request)

    def _change(self, request: requests.SetRequest | requests.ReleaseRequest) -> Struct | Mapping[str, object]:
        if isinstance(request, requests.SetRequest):
            if refusals := self._apply(request.body):
                raise RequestError(" ".join(refusals))
            return {}
        client, finger = request.body.client, request.body.finger
        if finger is None:
            self.scene.release_client(client)
        return Released(finger is None or self.scene.release(client, finger))

    def _state(self, t_ns: int) -> PlateState:
        self._seq += 1
        places: dict[int | str, tuple[float, float]] = dict(self.fingers.items())
        for name in self.scene.virtual_names(t_ns):
            places[name] = self.scene.virtual_position_mm(name, t_ns)
        fingers = []
        for key, (x_mm, y_mm) in places.items():
            wanted_um = self.scene.amplitude_um(key, x_mm, y_mm)
            fingers.append(FingerState(key, x_mm, y_mm, x_mm, y_mm, wanted_um, wanted_um, isinstance(key, str)))
        events = tuple(self._event(self.happens.pop(0), t_ns) for _ in self.happens[:1])
        return PlateState(
            *(self._instance, self._seq, t_ns, "ACTIVE", tuple(fingers), self.modal_um, False, 10.0, 16.0),
            modal_q_um=(0.0,) * len(self.modal_um),
            measured_d_q_um=(),
            events=events,
        )

    def _event(self, kind: EventKind, t_ns: int) -> PlateEvent:
        self._events += 1
        return PlateEvent(self._events, kind, t_ns, t_ns - 10, 1, 2.0, 3.0, "me", "", "click")
