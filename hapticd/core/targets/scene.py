"""The targets in force: what each finger should feel, which client owns it, and until when.

A finger has one owner, from the message that first requested it until that client's time to live runs out or it
releases the finger. A client that stops sending leaves a still plate.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Iterator
from dataclasses import dataclass
from typing import Final

from hapticd_contract.contents import Content
from hapticd_contract.surfaces import VirtualPath
from hapticd_contract.targets import ClientTargets

from ...values import FingerKey
from ..friction import DEFAULT_FRICTION_CURVE, FrictionCurve
from .effects import Effects
from .surfaces import NEVER_NS, SurfaceSet
from .textures import AmplitudeAt, Textures, finest_mm
from .virtual_paths import Walk

MAX_CLIENTS = 16  # names cost a client nothing, so their number is bounded
MAX_VIRTUALS = 16  # each takes part in every solve
NOISE_MM_S = 5.0  # of a predicted speed at rest, which would keep references from standing


@dataclass(slots=True)
class _Held:
    """One finger with its owner's target. `target` is None for a virtual finger that only moves."""

    owner: str
    t_expires_ns: int
    target: Content | None
    priority: int
    texture: AmplitudeAt | float | None  # None without a target
    finest_mm: float
    walk: Walk | None


_UNHELD: Final = _Held("", t_expires_ns=0, target=None, priority=0, texture=None, finest_mm=math.inf, walk=None)


class Scene:
    """The targets in force. Instants are arguments in ns on one monotonic axis; amplitudes um, positions plate mm."""

    def __init__(
        self,
        w_limit_um: float,
        friction_curve: FrictionCurve = DEFAULT_FRICTION_CURVE,
        plate_size_mm: tuple[float, float] = (137.5, 137.5),
    ) -> None:
        self.friction_curve = friction_curve
        self.depends_on_speed = friction_curve.speed_mm_s < math.inf
        self._plate_size_mm = plate_size_mm
        self._textures = Textures(friction_curve, plate_size_mm, w_limit_um)
        self.assets = self._textures.assets
        self.surfaces = SurfaceSet(self._textures)
        self.effects = Effects(w_limit_um, self.surfaces)
        self._held: dict[FingerKey, _Held] = {}
        self._released: dict[FingerKey, None] = {}  # in the order in which they were released

    # --- requests of clients ---

    def set_targets(self, message: ClientTargets, t_ns: int) -> tuple[str, ...]:
        """Replace all earlier targets, surfaces and effects of the client. Returns one sentence per refused one."""
        self._drop_expired(t_ns)
        requested: dict[FingerKey, _Held] = {}
        refusals: list[str] = []
        room = MAX_VIRTUALS - sum([held.owner != message.client for _, held, _ in self._walking()])
        targets = {one.finger: one for one in message.targets}
        paths = {one.name: one.path for one in message.virtuals}
        for key in dict.fromkeys((*paths, *targets)):
            target, path = targets.get(key), paths.get(key) if isinstance(key, str) else None
            content = None if target is None else target.content
            refusal = self._refusal(message.client, key, path, content, room)
            if refusal is not None:
                refusals.append(refusal)
                continue
            requested[key] = self._hold(message, key, path, content, 0 if target is None else target.priority, t_ns)
            room -= isinstance(key, str)
        self._drop([key for key in self._keys_of(message.client) if key not in requested])
        for key, held in requested.items():
            self._held[key] = held
            self._released.pop(key, None)
        refusals += self.surfaces.set_surfaces(message, t_ns)
        return (*refusals, *self.effects.set_effects(message, t_ns, self.owner_of))

    def upload(self, client: str, digest: bytes, size: int, offset: int, part: bytes, t_ns: int) -> int:
        """Take a part of an asset, as `Assets.upload`, which makes room for a new one where nothing is used."""
        if part and offset == 0:
            self.assets.look(self._in_force(), t_ns)
        return self.assets.upload(client, digest, size, offset, part, t_ns)

    def release(self, client: str, key: FingerKey) -> bool:
        """Release one finger; False if the client does not own it."""
        held = self._held.get(key)
        if held is None or held.owner != client:
            return False
        self._drop((key,))
        return True

    def release_client(self, client: str) -> None:
        """Release all fingers of a client, and remove its surfaces and effects."""
        self._drop(self._keys_of(client))
        self.surfaces.release_client(client)
        self.effects.release_client(client)

    def expire(self, t_ns: int) -> tuple[FingerKey, ...]:
        """Release what has expired by `t_ns`. Returns all fingers released since the last call, for any reason."""
        self.surfaces.expire(t_ns)
        self.effects.expire(t_ns)
        if self.assets.is_due(t_ns):
            self.assets.look(self._in_force(), t_ns)
        if not self._held and not self._released:
            return ()
        self._drop_expired(t_ns)
        released = tuple(self._released)
        self._released.clear()
        return released

    def set_friction_curve(self, curve: FrictionCurve) -> None:
        """From now on another person touches the plate: all targets and surfaces mean that person's friction."""
        self.friction_curve = self._textures.curve = curve
        self.depends_on_speed = curve.speed_mm_s < math.inf
        for held in self._held.values():
            held.texture = None if held.target is None else self._textures.of_target(held.target)
        self.surfaces.make_textures()

    # --- reading, for the touch path ---

    @property
    def next_expiry_ns(self) -> int | None:
        """Instant at which the next target, surface or effect expires; None while there is none."""
        next_ns = min(self.surfaces.t_expires_ns, self.effects.t_expires_ns)
        for held in self._held.values():  # no generator: each tick of the timer asks, and mostly there is nothing
            next_ns = min(next_ns, held.t_expires_ns)
        return None if next_ns == NEVER_NS else next_ns

    def target_of(self, key: FingerKey) -> Content | None:
        """The target of a finger, or None."""
        return self._held.get(key, _UNHELD).target

    def priorities(self, keys: Iterable[FingerKey]) -> list[int]:
        """Return the priority of each finger's target; 0 without one."""
        return [self._held.get(key, _UNHELD).priority for key in keys]

    def owner_of(self, key: FingerKey) -> str | None:
        """The client that owns a finger, or None."""
        held = self._held.get(key)
        return None if held is None else held.owner

    def speed_gain(self, speed_mm_s: float) -> float:
        """From now on look up amplitudes for a finger of this predicted speed; return by how much more amplitude it
        needs. The speed of one that hardly moves is noise."""
        self._textures.speed_gain = self.friction_curve.speed_gain(max(speed_mm_s - NOISE_MM_S, 0.0))
        return self._textures.speed_gain

    def amplitude_um(self, key: FingerKey, x_mm: float, y_mm: float) -> float | None:
        """The target amplitude of a finger at this position; None if it has no target."""
        texture = self._held.get(key, _UNHELD).texture
        return texture(x_mm, y_mm) if callable(texture) else texture

    def finest_mm(self, key: FingerKey) -> float:
        """How far apart samples of a finger's texture may be."""
        return self._held.get(key, _UNHELD).finest_mm

    def virtual_names(self, t_ns: int) -> tuple[str, ...]:
        """The names of the virtual fingers at `t_ns`, in the order in which they came."""
        return tuple(name for name, held, _ in self._walking() if t_ns < held.t_expires_ns)

    def requested(self, finger_ids: Iterable[int], released: Container[FingerKey], t_ns: int) -> list[FingerKey]:
        """Return the fingers that take part in the solve at `t_ns`: those of `finger_ids` with a target or released
        from one, and the virtual fingers with a target, in the order in which they came."""
        held = self._held
        keys: list[FingerKey] = []
        held_down = 0
        for finger_id in finger_ids:
            mine = held.get(finger_id)
            held_down += mine is not None
            if (mine is not None and mine.target is not None) or finger_id in released:
                keys.append(finger_id)
        if len(held) > held_down:  # virtual fingers, or fingers that have lifted
            for name, virtual, _ in self._walking():
                if virtual.target is not None and t_ns < virtual.t_expires_ns:
                    keys.append(name)
        return keys

    def virtual_position_mm(self, name: str, t_ns: int) -> tuple[float, float]:
        """Return a virtual finger's place at any instant, also one to come. Raises KeyError where there is none."""
        walk = self._held[name].walk
        if walk is None:
            raise KeyError(name)
        return walk.position_mm(t_ns)

    def holds_place(self, x_mm: float, y_mm: float) -> bool:
        """Whether a place lies on the plate."""
        width_mm, depth_mm = self._plate_size_mm
        return abs(x_mm) <= 0.5 * width_mm and abs(y_mm) <= 0.5 * depth_mm

    # --- ownership ---

    def _refusal(
        self, client: str, key: FingerKey, path: VirtualPath | None, content: Content | None, room: int
    ) -> str | None:
        """Return why the client's request for this finger is refused, None if it is not."""
        owner = self.owner_of(key)
        owners = {held.owner for held in self._held.values()}
        if client not in owners and len(owners) >= MAX_CLIENTS and owner is None:
            return f"{_spoken(key)}: {MAX_CLIENTS} clients hold fingers, which is the most: one must release its own."
        if owner is not None and owner != client:
            return f"{_spoken(key)} is held by {owner!r}: wait until that client releases it."
        if isinstance(key, str) and path is None:
            return f"{_spoken(key)} has a target but no path: send its path in the same message."
        if path is not None and not all(self.holds_place(x_mm, y_mm) for x_mm, y_mm in path.path_mm):
            width_mm, depth_mm = self._plate_size_mm
            return (
                f"{_spoken(key)} leaves the plate: its path must lie within ±{0.5 * width_mm:g} mm in x and "
                f"±{0.5 * depth_mm:g} mm in y."
            )
        if isinstance(key, str) and room < 1:
            return f"{_spoken(key)} is one too many: the plate has at most {MAX_VIRTUALS} virtual fingers."
        why = "" if content is None else self._textures.refusal(content)
        return f"{_spoken(key)} {why}" if why else None

    def _hold(
        self,
        message: ClientTargets,
        key: FingerKey,
        path: VirtualPath | None,
        target: Content | None,
        priority: int,
        t_ns: int,
    ) -> _Held:
        """Return the finger's new entry; what did not change is kept, so that a refreshed path keeps its phase."""
        before = self._held.get(key, _UNHELD)
        texture, piece_mm, walk = before.texture, before.finest_mm, before.walk
        if target != before.target:
            texture = None if target is None else self._textures.of_target(target)
            piece_mm = math.inf if target is None else finest_mm(target, self._plate_size_mm)
        if path is None or walk is None or walk.path != path:
            walk = None if path is None else Walk(path, t_ns)
        return _Held(message.client, t_ns + message.ttl_ns, target, priority, texture, piece_mm, walk)

    def _in_force(self) -> list[Content]:
        """Return all targets and contents in force."""
        targets = [held.target for held in self._held.values() if held.target is not None]
        return targets + [layer.content for layer in self.surfaces.layers]

    def _walking(self) -> Iterator[tuple[str, _Held, Walk]]:
        for key, held in self._held.items():
            if isinstance(key, str) and held.walk is not None:
                yield key, held, held.walk

    def _keys_of(self, client: str) -> list[FingerKey]:
        return [key for key, held in self._held.items() if held.owner == client]

    def _drop_expired(self, t_ns: int) -> None:
        self._drop([key for key, held in self._held.items() if t_ns >= held.t_expires_ns])

    def _drop(self, keys: Iterable[FingerKey]) -> None:
        for key in keys:
            del self._held[key]
            self._released[key] = None


def _spoken(key: FingerKey) -> str:
    return f"finger {key}" if isinstance(key, int) else f"virtual finger {key!r}"
