"""All targets of one client, sent as one message that replaces the previous one."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import msgpack

from .errors import RefusedError
from .messages import PROTOCOL_VERSION
from .targets import Fields

Key = int | str

# --- message order ----------------------------------------------------------------------------------------------


def stamp_now() -> Fields:
    """Return a new stamp, by which the daemon drops older messages; refreshes repeat the stamp of their targets."""
    return {"stamp": time.monotonic_ns()}


def no_stamp() -> Fields:
    """Return no stamp, for an older daemon."""
    return {}


# --- targets ----------------------------------------------------------------------------------------------------

MAX_TARGETS = 16
MAX_VIRTUALS = 16
MAX_SURFACES = 16
MAX_EFFECTS = 16
MAX_POINTS = 1024  # of all envelopes
MAX_MESSAGE_BYTES = 65536
DEFAULT_TTL_S = 0.5


@dataclass(frozen=True, slots=True)
class TargetSet:
    """Targets by finger, paths, surfaces and effects by name, as message fields, with the time to live of each."""

    targets: Mapping[Key, Fields] = field(default_factory=dict)
    virtuals: Mapping[str, Fields] = field(default_factory=dict)
    ttls_s: Mapping[Key, float] = field(default_factory=dict)
    surfaces: Mapping[str, Fields] = field(default_factory=dict)
    surface_ttls_s: Mapping[str, float] = field(default_factory=dict)
    effects: Mapping[str, Fields] = field(default_factory=dict)
    effect_ttls_s: Mapping[str, float] = field(default_factory=dict)

    @property
    def is_empty(self) -> bool:
        """Whether there is no target, no path, no surface and no effect."""
        return not self.targets and not self.virtuals and not self.surfaces and not self.effects

    @property
    def fingers(self) -> set[Key]:
        """The fingers with a target or an effect."""
        return {
            *self.targets,
            *[key for effect in self.effects.values() if isinstance(key := effect.get("finger"), int)],
        }

    @property
    def assets(self) -> set[bytes]:
        """The hashes of the assets that maps use."""
        images = [one.get("map") for one in (*self.targets.values(), *self.surfaces.values())]
        return {image["asset"] for image in images if isinstance(image, dict) and "asset" in image}

    @property
    def ttl_s(self) -> float:
        """Time to live of the message: the shortest of all."""
        ttls_s = [*self.ttls_s.values(), *self.surface_ttls_s.values(), *self.effect_ttls_s.values()]
        return min(ttls_s, default=DEFAULT_TTL_S)

    def with_target(self, key: Key, target: Fields, ttl_s: float) -> TargetSet:
        """Return a copy with a new target for one finger."""
        if key not in self.targets and len(self.targets) >= MAX_TARGETS:
            raise RefusedError(f"set: a client may own {MAX_TARGETS} fingers at once: release one first.")
        return replace(self, targets={**self.targets, key: target}, ttls_s={**self.ttls_s, key: ttl_s})

    def with_virtual(self, name: str, path: Fields, ttl_s: float) -> TargetSet:
        """Return a copy with a new path for one virtual finger."""
        if name not in self.virtuals and len(self.virtuals) >= MAX_VIRTUALS:
            raise RefusedError(f"virtual: a client may have {MAX_VIRTUALS} virtual fingers: release one first.")
        return replace(self, virtuals={**self.virtuals, name: path}, ttls_s={**self.ttls_s, name: ttl_s})

    def with_surface(self, name: str, surface: Fields, ttl_s: float) -> TargetSet:
        """Return a copy with a new or changed surface."""
        if name not in self.surfaces and len(self.surfaces) >= MAX_SURFACES:
            raise RefusedError(f"surface: a client may have {MAX_SURFACES} surfaces: remove one first.")
        surfaces, ttls_s = {**self.surfaces, name: surface}, {**self.surface_ttls_s, name: ttl_s}
        return replace(self, surfaces=surfaces, surface_ttls_s=ttls_s)

    def with_effect(self, name: str, effect: Fields, ttl_s: float) -> TargetSet:
        """Return a copy with a new or changed effect. Raises RefusedError for a surface that there is not."""
        if name not in self.effects and len(self.effects) >= MAX_EFFECTS:
            raise RefusedError(f"effect: a client may have {MAX_EFFECTS} effects: stop one first.")
        for surface in _surfaces_of(effect):
            if surface not in self.surfaces:
                raise RefusedError(f"effect: this client has no surface {surface!r}: lay it first.")
        effects = {**self.effects, name: effect}
        if sum(map(_points_of, effects.values())) > MAX_POINTS:
            raise RefusedError(f"effect: the envelopes of a client may have {MAX_POINTS} points in all.")
        return replace(self, effects=effects, effect_ttls_s={**self.effect_ttls_s, name: ttl_s})

    def without(self, *keys: Key) -> TargetSet:
        """Return a copy without these fingers and the effects on them."""
        ended = [name for name, effect in self.effects.items() if effect.get("finger") in keys]
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
            self.without_effect(*[one for one, effect in self.effects.items() if name in _surfaces_of(effect)]),
            surfaces={other: surface for other, surface in self.surfaces.items() if other != name},
            surface_ttls_s={other: ttl_s for other, ttl_s in self.surface_ttls_s.items() if other != name},
        )

    def fields(self, client: str, stamp: Fields) -> Fields:
        """Return the message's fields except its version; `stamp` is the stamp's field, or empty."""
        return {
            "client": client,
            **stamp,
            "ttl_s": self.ttl_s,
            "targets": [{"finger": key, **target} for key, target in self.targets.items()],
            "virtuals": [{"name": name, **path} for name, path in self.virtuals.items()],
            **_named("surfaces", self.surfaces),
            **_named("effects", self.effects),
        }

    def payload(self, client: str, stamp: Fields) -> bytes:
        """Encode the message for the `targets` socket. Raises RefusedError if it is too large for the daemon."""
        payload = bytes(msgpack.packb({"v": PROTOCOL_VERSION, **self.fields(client, stamp)}))
        # A request wraps the same fields in an envelope of less than a hundred bytes.
        if len(payload) > MAX_MESSAGE_BYTES - 100:
            raise RefusedError(
                f"All targets together take {len(payload)} of {MAX_MESSAGE_BYTES} bytes: use smaller maps."
            )
        return payload


def _named(field_name: str, ones: Mapping[str, Fields]) -> Fields:
    """Return an optional field of the message; an older daemon knows it only by name."""
    return {field_name: [{"name": name, **one} for name, one in ones.items()]} if ones else {}


def _surfaces_of(effect: Fields) -> list[object]:
    start = effect["start"]
    named = [effect.get("surface"), start.get("surface") if isinstance(start, dict) else None]
    return [name for name in named if name is not None]


def _points_of(effect: Fields) -> int:
    envelope = effect.get("envelope")
    return len(envelope["points"]) if isinstance(envelope, dict) else 0
