"""Client gateway: clients' messages become targets of the scene, their requests get an answer.

Who sends targets waits for no answer: what was wrong with them is counted, and so is what a newer message of the same
client has overtaken. What only the machine can report or do is requested from it.
"""

from __future__ import annotations

from collections.abc import Mapping
from operator import itemgetter
from typing import NamedTuple, Protocol

from msgspec import Struct
from msgspec.structs import asdict, replace

from hapticd_contract import requests
from hapticd_contract.contents import LevelMap
from hapticd_contract.replies import Have, Hello, Marked, Plate, Reach, Released, Surfaces
from hapticd_contract.requests import MarkerRequest, ReachQuery, Release, Request
from hapticd_contract.states import Marker
from hapticd_contract.surfaces import Polygon, Surface
from hapticd_contract.targets import ClientTargets

from .. import __version__
from ..core.pipeline import Pipeline
from ..core.targets.assets import Assets
from ..core.targets.layer import Layer
from ..core.targets.scene import Scene
from ..errors import RequestError
from ..wire import client as client_wire
from .board_gateway import BoardGateway
from .client_registry import ClientRegistry
from .observer import Observed

MAX_MARKERS = 64  # in one state; more between two passes are dropped
MAP_SIDE = 32  # of a described map: 64 surfaces of it are a reply of 80 KB


class Host(Protocol):
    """Interface of the machine to the gateway."""

    def wake_if_on_standby(self, t_now_ns: int) -> None:
        """Arm a board on standby: targets are in force."""

    def clear_fault(self, t_now_ns: int) -> None:
        """Clear the board's fault. Raises RequestError where the board cannot be asked."""

    def report_status(self, t_now_ns: int) -> Mapping[str, object]:
        """The answer to `status`."""

    def switch_person(self, name: str, t_now_ns: int) -> Mapping[str, object]:
        """The answer to `person`. Raises RequestError for an unknown name."""

    def describe_plate(self) -> Plate:
        """The answer to `plate`."""


class _Described(NamedTuple):
    """A surface and its description. A layer is not kept, for its texture may hold an asset."""

    surface: Surface
    fields: dict[str, object]


class ClientGateway:
    """All clients: each message names its client, and the socket knows its user."""

    def __init__(
        self,
        scene: Scene,
        registry: ClientRegistry,
        pipeline: Pipeline,
        board: BoardGateway,
        instance: int,
        host: Host,
        observed: Observed,
    ) -> None:
        """`instance` distinguishes one start of the host from the next."""
        self.refused = 0
        self.last_refusal = ""
        self.overtaken = 0
        self.markers: list[Marker] = []  # not yet published
        self._scene = scene
        self._pipeline = pipeline
        self._board = board
        self._instance = instance
        self._host = host
        self._observed = observed
        self._client_registry = registry
        self._described: dict[tuple[str, str], _Described] = {}  # as last read: maps take time to make small

    def targets(self, payload: bytes, t_now_ns: int, user: str, waited_ns: int) -> None:
        """Take a message of the targets socket; an error in it is counted and kept for `status`."""
        try:
            message = _aged(client_wire.decode_targets(payload), waited_ns)
            is_newest = self._is_newest(message.client, user, message.stamp, message.ttl_ns, t_now_ns)
            refusals = self._apply(message, t_now_ns) if is_newest else ()
        except RequestError as error:
            refusals = (str(error),)
        if refusals:
            self.refused += 1
            self.last_refusal = refusals[0]

    def set_targets(self, message: ClientTargets, t_now_ns: int) -> tuple[str, ...]:
        """Apply a client's targets. Returns one error message per refused finger."""
        refusals = self._scene.set_targets(message, t_now_ns)
        self._host.wake_if_on_standby(t_now_ns)
        return refusals

    def _apply(self, message: ClientTargets, t_now_ns: int) -> tuple[str, ...]:
        """Apply targets that a socket received: only for fingers that are or were down.

        Ids count up, so a client could otherwise own each finger before it touches.
        """
        newest = self._pipeline.newest_finger_id
        reached = [*[one.finger for one in message.targets], *[effect.finger for effect in message.effects]]
        unseen = [key for key in dict.fromkeys(reached) if isinstance(key, int) and key > newest]
        if unseen:
            known = tuple([one for one in message.targets if one.finger not in unseen])
            effects = tuple([effect for effect in message.effects if effect.finger not in unseen])
            message = replace(message, targets=known, effects=effects)
        refusals = (f"finger {key} has not touched the plate: use an id from the newest state." for key in unseen)
        return (*refusals, *self.set_targets(message, t_now_ns))

    def request(self, payload: bytes, t_now_ns: int, user: str, waited_ns: int) -> bytes:
        """Return the answer to a message of the control socket."""
        return client_wire.answer(payload, lambda request: self._carry_out(request, t_now_ns, user, waited_ns))

    def _carry_out(self, request: Request, t_now_ns: int, user: str, waited_ns: int) -> Struct | Mapping[str, object]:
        match request:
            case requests.MarkRequest(body=marker):
                return self._mark(marker, t_now_ns, user)
            case requests.AssetRequest(body=one):
                self._client_registry.is_newest(one.client, user, None, 0, t_now_ns)
                have = self._scene.upload(one.client, one.asset, one.size, one.offset or 0, one.part or b"", t_now_ns)
                return Have(have)
            case requests.SetRequest(body=targets):
                targets = _aged(targets, waited_ns)
                self._require_newest(targets.client, user, targets.stamp, targets.ttl_ns, t_now_ns)
                refusals = self._apply(targets, t_now_ns)
                if refusals:
                    raise RequestError(" ".join(refusals))
                return {}
            case requests.ReleaseRequest(body=release):
                self._require_newest(release.client, user, release.stamp, 0, t_now_ns)
                return Released(self._release(release))
            case requests.ReachRequest(body=query):
                return self._reach(query, t_now_ns)
            case requests.ClearFaultRequest():
                self._host.clear_fault(t_now_ns)
                return {}
            case requests.StatusRequest():
                return self._host.report_status(t_now_ns)
            case requests.PlateRequest():
                return self._host.describe_plate()
            case requests.PersonRequest(body=asked):
                return self._host.switch_person(asked.name or "", t_now_ns)
            case requests.SurfacesRequest():
                return self._describe_surfaces(t_now_ns)
            case requests.HelloRequest() | requests.CapabilitiesRequest():
                return Hello(version=__version__, instance=self._instance)

    def _reach(self, query: ReachQuery, t_now_ns: int) -> Reach:
        key, place_mm = query.finger, (query.x_mm or 0.0, query.y_mm or 0.0)
        if isinstance(key, str) and key not in self._scene.virtual_names(t_now_ns):
            raise RequestError(f"there is no virtual finger {key!r}.")
        if key is None and not self._scene.holds_place(*place_mm):
            raise RequestError("x_mm and y_mm: the place must lie on the plate.")
        try:
            return Reach(self._pipeline.reach(key, place_mm, t_now_ns))
        except ValueError as error:
            raise RequestError(str(error)) from None

    def _describe_surfaces(self, t_now_ns: int) -> Surfaces:
        surfaces, assets = self._scene.surfaces, self._scene.assets
        surfaces.expire(t_now_ns)
        kept, self._described = self._described, {}
        for layer in surfaces.layers:
            key = layer.owner, layer.name
            before = kept.get(key)
            if before is None or before.surface is not layer.surface:
                before = _Described(layer.surface, described(layer, assets))
            self._described[key] = before
        return Surfaces(surfaces.version, tuple([one.fields for one in self._described.values()]))

    def _require_newest(self, client: str, user: str, stamp: int | None, ttl_ns: int, t_now_ns: int) -> None:
        if not self._is_newest(client, user, stamp, ttl_ns, t_now_ns):
            raise RequestError("A newer message of this client came before this one: nothing was changed.")

    def _is_newest(self, client: str, user: str, stamp: int | None, ttl_ns: int, t_now_ns: int) -> bool:
        """Return False if a newer message of the client came first. Raises RequestError for another user's name."""
        is_newest = self._client_registry.is_newest(client, user, stamp, ttl_ns, t_now_ns)
        self.overtaken += not is_newest
        return is_newest

    def _mark(self, request: MarkerRequest, t_now_ns: int, user: str) -> Marked:
        self._client_registry.is_newest(request.client, user, None, 0, t_now_ns)
        if request.pulse:
            self._board.pulse(t_now_ns)
        self._observed.put("marker", t_now_ns, request.client, request.text, request.fields)
        if len(self.markers) < MAX_MARKERS:
            self.markers.append(Marker(t_now_ns, request.client, request.text, request.fields))
        return Marked(t_now_ns)

    def _release(self, release: Release) -> bool:
        if release.finger is None:
            self._scene.release_client(release.client)
            return True
        return self._scene.release(release.client, release.finger)


def _aged(message: ClientTargets, waited_ns: int) -> ClientTargets:
    """Return what is left of a message that waited: its life begins at its arrival, and after that it is a release."""
    if waited_ns >= message.ttl_ns:
        return ClientTargets(message.client, stamp=message.stamp)
    return replace(message, ttl_s=message.ttl_s - waited_ns * 1e-9)


def described(layer: Layer, assets: Assets) -> dict[str, object]:
    """Return a layer as a client reads it: its owner and fields, its map small enough for a reply.

    Its pose is that at `t_pose_ns`, a rectangle is a polygon.
    """
    surface: Surface = layer.surface
    content, shape = assets.resolved(layer.content), surface.shape
    changed: dict[str, object] = {"t_pose_ns": layer.t_pose_ns}
    if isinstance(content, LevelMap):
        changed["map"] = _small(content)
    if isinstance(shape, Polygon):
        changed |= {"rectangle_mm": None, "polygon_mm": shape.corners_mm}
    left_out = ("position_mm", "velocity_mm_s") if surface.path_mm else ("speed_mm_s", "loop")
    fields = _whole(replace(surface, **changed))
    return {"client": layer.owner, **{name: value for name, value in fields.items() if name not in left_out}}


def _whole(struct: Struct) -> dict[str, object]:
    """Return all fields, those at their default too: only what there is not is left out."""
    present = {name: value for name, value in asdict(struct).items() if value is not None}
    return {name: _whole(value) if isinstance(value, Struct) else value for name, value in present.items()}


def _small(content: LevelMap) -> LevelMap:
    """Return a map with at most MAP_SIDE pixels per side, of those nearest."""
    columns, rows = _spread(content.width), _spread(content.height)
    pick = itemgetter(*columns) if len(columns) > 1 else bytes
    levels = b"".join(bytes(pick(content.levels[row * content.width : (row + 1) * content.width])) for row in rows)
    return replace(content, width=len(columns), height=len(rows), levels=levels, asset=None)


def _spread(pixels: int) -> list[int]:
    count = min(pixels, MAP_SIDE)
    return [round(index * (pixels - 1) / max(count - 1, 1)) for index in range(count)]
