"""The `targets` message: all that one client requests."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Final, Literal

import msgspec
from msgspec import Meta

from .base import Contract, Key, Name, Whole, problem_of_name
from .contents import Content, Contents, content_fields
from .effects import Effect
from .surfaces import Surface, VirtualFinger, VirtualPath

MAX_TARGETS: Final = 16
MAX_VIRTUALS: Final = 16
MAX_SURFACES: Final = 16
MAX_EFFECTS: Final = 16
MAX_POINTS: Final = 1024  # of all envelopes of a message
MAX_PRIORITY: Final = 3
MIN_TTL_S: Final = 0.02
MAX_TTL_S: Final = 5.0
DEFAULT_TTL_S: Final = 0.5

TtlS = Annotated[float, Meta(ge=MIN_TTL_S, le=MAX_TTL_S)]
Priority = Annotated[int, Meta(ge=0, le=MAX_PRIORITY)]


class FingerTarget(Contents, frozen=True):
    """What one finger is to feel, wherever it goes: a finger on the plate by its id, or a virtual one by its name.

    Where not all fingers can feel what is asked, those with the highest `priority` come first.
    """

    finger: Key
    """the id from telemetry, or the name of one of the message's own virtual fingers"""
    priority: Priority = 0
    """the highest come first where the plate cannot meet all targets"""


class ClientTargets(Contract, frozen=True):
    """All present targets, surfaces and effects of one client; they replace that client's earlier ones.

    They expire `ttl_s` after their arrival. `stamp` grows with each change of what the client requests. Of surfaces
    with equal `z` the last is on top.
    """

    client: Name
    """owner of these fingers; must be unique"""
    ttl_s: TtlS = DEFAULT_TTL_S
    """for how long the message holds"""
    stamp: Whole | None = None
    """increases with each change of targets; see below"""
    targets: Annotated[tuple[FingerTarget, ...], Meta(max_length=MAX_TARGETS)] = ()
    """of fingers"""
    virtuals: Annotated[tuple[VirtualFinger, ...], Meta(max_length=MAX_VIRTUALS)] = ()
    """virtual fingers"""
    surfaces: Annotated[tuple[Surface, ...], Meta(max_length=MAX_SURFACES)] = ()
    """content that lies on the plate; see [below](#surfaces)"""
    effects: Annotated[tuple[Effect, ...], Meta(max_length=MAX_EFFECTS)] = ()
    """content that depends on time; see [below](#effects)"""

    @classmethod
    def of(
        cls,
        client: str,
        ttl_ns: int,
        targets: Mapping[int | str, Content] | None = None,
        virtuals: Mapping[str, VirtualPath] | None = None,
        stamp: int | None = None,
        surfaces: Mapping[str, Surface] | None = None,
        effects: Mapping[str, Effect] | None = None,
        priorities: Mapping[int | str, int] | None = None,
    ) -> ClientTargets:
        """Return the message of targets by finger, and paths, surfaces and effects by name."""
        return cls(
            client=client,
            ttl_s=ttl_ns * 1e-9,
            stamp=stamp,
            targets=tuple(
                FingerTarget(key, (priorities or {}).get(key, 0), **content_fields(content))
                for key, content in (targets or {}).items()
            ),
            virtuals=tuple(
                VirtualFinger(path.path_mm, path.speed_mm_s, path.loop, name=name)
                for name, path in (virtuals or {}).items()
            ),
            surfaces=tuple(msgspec.structs.replace(one, name=name) for name, one in (surfaces or {}).items()),
            effects=tuple(msgspec.structs.replace(one, name=name) for name, one in (effects or {}).items()),
        )

    @property
    def ttl_ns(self) -> int:
        """For how long it holds."""
        return round(self.ttl_s * 1e9)

    def problem(self) -> str:
        virtuals = [one.name for one in self.virtuals]
        fingers = [one.finger for one in self.targets]
        surfaces = [one.name for one in self.surfaces]
        problem = (
            problem_of_name(self.client, ".client")
            or _first_problem("virtuals", "name", virtuals, self.virtuals)
            or _first_problem("targets", "finger", fingers, self.targets)
            or _first_problem("surfaces", "name", surfaces, self.surfaces)
            or _first_problem("effects", "name", [one.name for one in self.effects], self.effects)
        )
        if problem:
            return problem
        for index, key in enumerate(fingers):
            if isinstance(key, str) and key not in virtuals:
                return f".targets[{index}].finger: this message defines no virtual finger {key!r}."
        points = 0
        for index, effect in enumerate(self.effects):
            for name in effect.surfaces:
                if name not in surfaces:
                    place = "surface" if name == effect.surface else "start.surface"
                    return f".effects[{index}].{place}: this message defines no surface {name!r}."
            points += 0 if effect.envelope is None else len(effect.envelope.points)
            if points > MAX_POINTS:
                return f".effects[{index}].envelope: more than {MAX_POINTS} points in one message."
        return ""


class TargetsMessage(ClientTargets, frozen=True, kw_only=True):
    """The message of the `targets` socket."""

    v: Literal[1]


def _first_problem(field: str, key_field: str, keys: list[Any], ones: Iterable[Contract]) -> str:
    """Return what is wrong with a list: one of its members, or a key that is in it twice."""
    for index, one in enumerate(ones):
        if problem := one.problem():
            return f".{field}[{index}]{problem}"
    if len(set(keys)) != len(keys):
        index = next(index for index, key in enumerate(keys) if key in keys[:index])
        return f".{field}[{index}].{key_field}: {keys[index]!r} is listed twice."
    return ""
