"""Requests on the `control` socket, each with its body."""

from __future__ import annotations

import math
from typing import Annotated, Final, Literal, get_args

from msgspec import Meta, field

from .base import MAX_ID, MAX_PART_BYTES, Contract, Digest, Key, Mm, Name, Whole, problem_of_name
from .targets import ClientTargets

MAX_ASSET_BYTES: Final = 2**20
MAX_MARKER_CHARACTERS: Final = 100
MAX_MARKER_FIELDS: Final = 16
MOST_EXACT: Final = 2**53  # beyond it JSON's readers round whole numbers
UNREAD_REQUEST_ID: Final = 0  # in the reply to a request whose own id could not be read

RequestId = Annotated[int, Meta(ge=1, le=MAX_ID)]
MarkerValue = (
    bool
    | Annotated[int, Meta(ge=-MOST_EXACT, le=MOST_EXACT)]
    | float
    | Annotated[str, Meta(max_length=MAX_MARKER_CHARACTERS)]
)

# --- bodies -----------------------------------------------------------------------------------------------------


class Nothing(Contract, frozen=True):
    """No fields."""


class Release(Contract, frozen=True):
    """Release one finger (its id, or a virtual finger's name), or without one all fingers, surfaces and effects of the
    client. `stamp` as in a `targets` message."""

    client: Name
    finger: Key | None = None
    """default: all fingers, surfaces and effects of the client"""
    stamp: Whole | None = None
    """as in a `targets` message"""

    def problem(self) -> str:
        return problem_of_name(self.client, ".client")


class MarkerRequest(Contract, frozen=True):
    """A label for an instant of an experiment. With `pulse` the board's sync output rises for 5 ms with the next
    reference that takes effect."""

    client: Name
    """a name that is free or the user's own"""
    text: Annotated[str, Meta(min_length=1, max_length=MAX_MARKER_CHARACTERS)]
    pulse: bool = False
    """lets the board's sync output rise for 5 ms as the next reference takes effect, at most every 20 ms"""
    fields: Annotated[dict[Name, MarkerValue], Meta(max_length=MAX_MARKER_FIELDS)] = field(default_factory=dict)
    """the same as values by name, at most 16: texts of up to 100 printable characters, finite numbers, true, false;
    `hello` lists it as `marker_fields`"""

    def problem(self) -> str:
        for name, value in self.fields.items():
            is_sound = value.isprintable() if isinstance(value, str) else math.isfinite(value)
            if not (name.isprintable() and is_sound):
                return ".fields: must have printable texts and finite numbers."
        if not self.text.isprintable():
            return f".text: must have 1 .. {MAX_MARKER_CHARACTERS} printable characters."
        return problem_of_name(self.client, ".client")


class AssetPart(Contract, frozen=True):
    """A part of an asset, from `offset` on; without one it only asks how much of it is here.

    `asset` is the SHA-256 of the whole asset of `size` bytes.
    """

    client: Name
    asset: Digest
    """SHA-256 of all levels"""
    size: Annotated[int, Meta(ge=1, le=MAX_ASSET_BYTES)]
    """bytes of the whole asset"""
    offset: Annotated[int, Meta(ge=0, le=MAX_ASSET_BYTES - 1)] | None = None
    """where the part begins"""
    part: Annotated[bytes, Meta(min_length=1, max_length=MAX_PART_BYTES)] | None = None
    """without one the request only asks"""

    def problem(self) -> str:
        if self.part is None and self.offset is not None:
            return ".offset: without a part there is none."
        if self.part is not None and self.offset is None:
            return ".offset: is missing."
        end = (self.offset or 0) + len(self.part or b"")
        if end > self.size:
            return f".part: ends at byte {end}, the asset has {self.size}."
        return problem_of_name(self.client, ".client")


class ReachQuery(Contract, frozen=True):
    """Which friction a finger can feel now: its id, a virtual finger's name, or instead one that touched a place."""

    finger: Key | None = None
    """an id or the name of a virtual finger"""
    x_mm: Mm | None = None
    """or instead a place on the plate"""
    y_mm: Mm | None = None

    def problem(self) -> str:
        if self.finger is None and (self.x_mm is None or self.y_mm is None):
            return f".{'x_mm' if self.x_mm is None else 'y_mm'}: is missing."
        if self.finger is not None and (self.x_mm, self.y_mm) != (None, None):
            return ".finger: a query has a finger or a place, not both."
        return ""


class PersonQuery(Contract, frozen=True):
    """Who touches the plate, by the name of a participant; without one whoever the configuration's curve is of."""

    name: Name | None = None
    """of a participant; without one the configuration's friction curve"""


# --- requests ---------------------------------------------------------------------------------------------------


class _Request(Contract, frozen=True, kw_only=True, tag_field="op"):
    """A request: `id` is of the client's choice, and its reply has the same."""

    v: Literal[1]
    id: RequestId


class _Bare(_Request, frozen=True, kw_only=True):
    body: Nothing = Nothing()


class HelloRequest(_Bare, frozen=True, tag="hello"):
    """Greets the daemon."""


class CapabilitiesRequest(_Bare, frozen=True, tag="capabilities"):
    """Asks what the daemon knows, and for its bounds."""


class SetRequest(_Request, frozen=True, tag="set"):
    """A `targets` message with an answer: an error if anything was refused; the rest is active."""

    body: ClientTargets

    def problem(self) -> str:
        return _within(self.body)


class ReleaseRequest(_Request, frozen=True, tag="release"):
    """Releases one finger, or all."""

    body: Release

    def problem(self) -> str:
        return _within(self.body)


class StatusRequest(_Bare, frozen=True, tag="status"):
    """Asks for the daemon's health."""


class PlateRequest(_Bare, frozen=True, tag="plate"):
    """Asks for what a picture of the plate needs."""


class ClearFaultRequest(_Bare, frozen=True, tag="clear_fault"):
    """Clears a latched fault of the board."""


class MarkRequest(_Request, frozen=True, tag="marker"):
    """Adds a marker to recordings and to the next state."""

    body: MarkerRequest

    def problem(self) -> str:
        return _within(self.body)


class AssetRequest(_Request, frozen=True, tag="asset"):
    """Uploads a part of an asset, or asks how much of it is here."""

    body: AssetPart

    def problem(self) -> str:
        return _within(self.body)


class SurfacesRequest(_Bare, frozen=True, tag="surfaces"):
    """Asks for all surfaces in force."""


class PersonRequest(_Request, frozen=True, tag="person"):
    """Says who touches the plate."""

    body: PersonQuery

    def problem(self) -> str:
        return _within(self.body)


class ReachRequest(_Request, frozen=True, tag="reach"):
    """Asks which friction a finger can feel."""

    body: ReachQuery

    def problem(self) -> str:
        return _within(self.body)


Request = (
    HelloRequest
    | CapabilitiesRequest
    | SetRequest
    | ReleaseRequest
    | StatusRequest
    | PlateRequest
    | ClearFaultRequest
    | MarkRequest
    | AssetRequest
    | SurfacesRequest
    | PersonRequest
    | ReachRequest
)
OPS: Final = tuple(str(kind.__struct_config__.tag) for kind in get_args(Request))


def _within(body: Contract) -> str:
    problem = body.problem()
    return f".body{problem}" if problem else ""
