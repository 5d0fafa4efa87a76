"""All targets of one client, sent as one message that replaces the previous one."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec

from hapticd_contract.base import MAX_MESSAGE_BYTES
from hapticd_contract.effects import Effect
from hapticd_contract.surfaces import Surface, VirtualFinger
from hapticd_contract.targets import (
    DEFAULT_TTL_S,
    MAX_EFFECTS,
    MAX_POINTS,
    MAX_SURFACES,
    MAX_TARGETS,
    MAX_VIRTUALS,
    ClientTargets,
    FingerTarget,
    TargetsMessage,
)

from .errors import RefusedError

SceneKey = int | str

# --- message order ----------------------------------------------------------------------------------------------


def stamp_now() -> int | None:
    """Return a new stamp, by which the daemon drops older messages; refreshes repeat the stamp of their targets."""
    return time.monotonic_ns()


def no_stamp() -> int | None:
    """Return no stamp, for an older daemon."""
    return None


# --- targets ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class TargetSet:
    """Targets by finger, paths, surfaces and effects by name, with the time to live of each."""

    targets: Mapping[SceneKey, FingerTarget] = field(default_factory=dict)
    virtuals: Mapping[str, VirtualFinger] = field(default_factory=dict)
    ttls_s: Mapping[SceneKey, float] = field(default_factory=dict)
    surfaces: Mapping[str, Surface] = field(default_factory=dict)
    surface_ttls_s: Mapping[str, float] = field(default_factory=dict)
    effects: Mapping[str, Effect] = field(default_factory=dict)
    effect_ttls_s: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, message: ClientTargets) -> TargetSet:
        """Return all that a message has. Raises RefusedError for an effect on a surface that it has not."""
        ttl_s = message.ttl_s
        made = cls()
        for target in message.targets:
            made = made.with_target(target, ttl_s)
        for path in message.virtuals:
            made = made.with_virtual(path, ttl_s)
        for surface in message.surfaces:
            made = made.with_surface(surface, ttl_s)
        for effect in message.effects:
            made = made.with_effect(effect, ttl_s)
        return made

    @property
    def is_empty(self) -> bool:
        """Whether there is no target, no path, no surface and no effect."""
        return not self.targets and not self.virtuals and not self.surfaces and not self.effects

    @property
    def fingers(self) -> set[SceneKey]:
        """The fingers with a target or an effect."""
        return {*self.targets, *[one.finger for one in self.effects.values() if one.finger is not None]}

    @property
    def assets(self) -> set[bytes]:
        """The hashes of the assets that maps use."""
        images = [one.map for one in (*self.targets.values(), *self.surfaces.values())]
        return {image.asset for image in images if image is not None and image.asset is not None}

    @property
    def ttl_s(self) -> float:
        """Time to live of the message: the shortest of all."""
        ttls_s = [*self.ttls_s.values(), *self.surface_ttls_s.values(), *self.effect_ttls_s.values()]
        return min(ttls_s, default=DEFAULT_TTL_S)

    def with_target(self, target: FingerTarget, ttl_s: float) -> TargetSet:
        """Return a copy with a new target for one finger."""
        key = target.finger
        if key not in self.targets and len(self.targets) >= MAX_TARGETS:
            raise RefusedError(f"set: a client may own {MAX_TARGETS} fingers at once: release one first.")
        return replace(self, targets={**self.targets, key: target}, ttls_s={**self.ttls_s, key: ttl_s})

    def with_virtual(self, path: VirtualFinger, ttl_s: float) -> TargetSet:
        """Return a copy with a new path for one virtual finger."""
        name = path.name
        if name not in self.virtuals and len(self.virtuals) >= MAX_VIRTUALS:
            raise RefusedError(f"virtual: a client may have {MAX_VIRTUALS} virtual fingers: release one first.")
        return replace(self, virtuals={**self.virtuals, name: path}, ttls_s={**self.ttls_s, name: ttl_s})

    def with_surface(self, surface: Surface, ttl_s: float) -> TargetSet:
        """Return a copy with a new or changed surface."""
        name = surface.name
        if name not in self.surfaces and len(self.surfaces) >= MAX_SURFACES:
            raise RefusedError(f"surface: a client may have {MAX_SURFACES} surfaces: remove one first.")
        surfaces, ttls_s = {**self.surfaces, name: surface}, {**self.surface_ttls_s, name: ttl_s}
        return replace(self, surfaces=surfaces, surface_ttls_s=ttls_s)

    def with_effect(self, effect: Effect, ttl_s: float) -> TargetSet:
        """Return a copy with a new or changed effect. Raises RefusedError for a surface that there is not."""
        name = effect.name
        if name not in self.effects and len(self.effects) >= MAX_EFFECTS:
            raise RefusedError(f"effect: a client may have {MAX_EFFECTS} effects: stop one first.")
        for surface in effect.surfaces:
            if surface not in self.surfaces:
                raise RefusedError(f"effect: this client has no surface {surface!r}: lay it first.")
        effects = {**self.effects, name: effect}
        if sum(len(one.envelope.points) for one in effects.values() if one.envelope is not None) > MAX_POINTS:
            raise RefusedError(f"effect: the envelopes of a client may have {MAX_POINTS} points in all.")
        return replace(self, effects=effects, effect_ttls_s={**self.effect_ttls_s, name: ttl_s})

    def without(self, *keys: SceneKey) -> TargetSet:
        """Return a copy without these fingers and the effects on them."""
        ended = [name for name, effect in self.effects.items() if effect.finger in keys]
        return replace(
            self.without_effect(*ended) if ended else self,
            targets={key: target for key, target in self.targets.items() if key not in keys},
            virtuals={name: path for name, path in self.virtuals.items() if name not in keys},
            ttls_s={key: ttl_s for key, ttl_s in self.ttls_s.items() if key not in keys},
        )

    def without_effect(self, *names: str) -> TargetSet:
        """Return a copy without these effects."""
        return replace(
            self,
            effects={name: effect for name, effect in self.effects.items() if name not in names},
            effect_ttls_s={name: ttl_s for name, ttl_s in self.effect_ttls_s.items() if name not in names},
        )

    def without_surface(self, name: str) -> TargetSet:
        """Return a copy without a surface and the effects that name it."""
        return replace(
            self.without_effect(*[one for one, effect in self.effects.items() if name in effect.surfaces]),
            surfaces={other: surface for other, surface in self.surfaces.items() if other != name},
            surface_ttls_s={other: ttl_s for other, ttl_s in self.surface_ttls_s.items() if other != name},
        )

    def message(self, client: str, stamp: int | None) -> ClientTargets:
        """Return the body of a request `set`."""
        return ClientTargets(client, **self._fields(stamp))

    def payload(self, client: str, stamp: int | None) -> bytes:
        """Encode the message for the `targets` socket. Raises RefusedError if it is too large for the daemon."""
        payload = msgspec.msgpack.encode(TargetsMessage(client, **self._fields(stamp), v=1))
        # A request wraps the same fields in an envelope of less than a hundred bytes.
        if len(payload) > MAX_MESSAGE_BYTES - 100:
            raise RefusedError(
                f"All targets together take {len(payload)} of {MAX_MESSAGE_BYTES} bytes: use smaller maps."
            )
        return payload

    def _fields(self, stamp: int | None) -> dict[str, Any]:
        names = ("targets", "virtuals", "surfaces", "effects")
        return {"ttl_s": self.ttl_s, "stamp": stamp, **{name: tuple(getattr(self, name).values()) for name in names}}
