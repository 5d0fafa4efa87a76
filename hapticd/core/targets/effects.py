"""The effects in force, and those that play: what they make of a finger's amplitude, and the knots that they need.

Ownership and time to live are those of surfaces. What starts an effect is found in `core.triggers`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

from hapticd_contract.effects import At, Effect, Now, OnEdge, Start
from hapticd_contract.targets import ClientTargets

from ...values import FingerKey
from ..trajectory.gate import GRAIN_NS
from .forms import ENDLESS_NS, SINE_CORNERS, Course
from .layer import Layer
from .surfaces import NEVER_NS, SurfaceSet

Cause = type[Start]

MAX_EFFECTS: Final = 64  # of all clients
MAX_PLAYING: Final = 32  # each is looked at for every finger at every knot
MAX_START_IDS: Final = 1024  # remembered; 64 clients have as many effects
EVERYONE: Final = 0  # no finger's id: all fingers where the effect is
OwnerOf = Callable[[FingerKey], str | None]
_Predicted = Callable[[int, int], tuple[float, float]]  # a finger and an instant: where it will be


class Held:
    """One effect with its owner. `layer` is the surface it is on, `trigger` the one that starts it, None without."""

    def __init__(self, owner: str, effect: Effect, t_ns: int) -> None:
        self.name: Final = effect.name
        self.owner: Final = owner
        self.effect: Final = effect
        self.on: Final = effect.on
        self.cause: Final[Cause] = type(effect.start)
        self.is_wave: Final = effect.loops or effect.modulation is not None  # needs knots again and again
        self.course: Final = Course(effect.form, effect.loops)
        self.t_from_ns: Final = t_ns
        self.t_expires_ns = t_ns
        self.corners = 0  # at most in one frame
        self.is_due = self.cause is Now or self.cause is At
        self.is_gone = False
        self.is_new = True
        self.layer: Layer | None = None
        self.trigger: Layer | None = None
        self.started_ns: dict[int, int] = {}  # by finger


class Playing:
    """An effect that plays, for one finger or for EVERYONE where it is; instants are whole grains."""

    def __init__(self, held: Held, finger_id: int, begin_ns: int) -> None:
        self.held: Final = held
        self.finger_id: Final = finger_id
        self.begin_ns: Final = begin_ns
        self.end_ns: Final = begin_ns + held.course.length_ns


class Effects:
    """All effects of all clients. Instants are arguments in ns on one monotonic axis."""

    def __init__(self, w_limit_um: float, surfaces: SurfaceSet) -> None:
        self.held: list[Held] = []
        self.playing: list[Playing] = []
        self.felt: list[Playing] = []  # of those, what a finger feels in the frame that is being made
        self.t_expires_ns = NEVER_NS  # the next one does
        self.begun = 0
        self.skipped = 0  # starts for which there was no room
        self._w_limit_um: Final = w_limit_um
        self._surfaces: Final = surfaces
        self._layers: list[Layer] = []
        self._start_ids: dict[tuple[str, str], int] = {}  # of the newest start by owner and name, oldest first
        self._max_knots = 24
        self._least_span_ns = 12_000_000

    def set_knot_limits(self, max_knots: int, least_span_ns: int) -> None:
        """Set what a frame carries: so many knots, over a span that lasts to the next frame at least."""
        self._max_knots = max_knots
        self._least_span_ns = least_span_ns

    # --- requests of clients ---

    def set_effects(self, message: ClientTargets, t_ns: int, owner_of: OwnerOf) -> list[str]:
        """Replace all earlier effects of the client. Returns one error message per refused effect."""
        if not message.effects and not self.held:
            return []
        self.expire(t_ns)
        before = {held.name: held for held in self.held if held.owner == message.client}
        others = [held for held in self.held if held.owner != message.client]
        mine: list[Held] = []
        refusals: list[str] = []
        for effect in message.effects:
            name = effect.name
            held = before.get(name)
            if held is None or held.effect != effect:
                held = Held(message.client, effect, t_ns)
                held.corners = held.course.most_corners(self._least_span_ns)
            refusal = self._refusal(held, owner_of)
            if len(others) + len(mine) >= MAX_EFFECTS:
                refusal = f"is one too many: the plate has at most {MAX_EFFECTS} effects."
            if refusal:
                refusals.append(f"effect {name!r} {refusal}")
                continue
            if held is not before.get(name):
                held.is_due = held.is_due and not self._has_been_played(held)
            held.t_expires_ns = t_ns + message.ttl_ns
            mine.append(held)
        self._keep(others + mine)
        return refusals

    def release_client(self, client: str) -> None:
        """Remove all effects of a client."""
        if self.held:
            self._keep([held for held in self.held if held.owner != client])

    def expire(self, t_ns: int) -> None:
        """Remove what has expired by `t_ns`."""
        if t_ns >= self.t_expires_ns:
            self._keep([held for held in self.held if t_ns < held.t_expires_ns])

    def _has_been_played(self, held: Held) -> bool:
        """Whether a message started this with the same id before: one that is refreshed after it expired is old."""
        start = held.effect.start
        start_id = start.id if isinstance(start, Now) else 0
        if start_id == 0 or held.course.length_ns == ENDLESS_NS:
            return False
        key = (held.owner, held.name)
        if self._start_ids.pop(key, 0) == start_id:
            self._start_ids[key] = start_id
            return True
        self._start_ids[key] = start_id
        if len(self._start_ids) > MAX_START_IDS:
            del self._start_ids[next(iter(self._start_ids))]
        return False

    def _keep(self, kept: list[Held]) -> None:
        for held in self.held:
            held.is_gone = held not in kept
        self.held = kept
        self.t_expires_ns = min([held.t_expires_ns for held in kept], default=NEVER_NS)
        self._layers = []

    def _refusal(self, held: Held, owner_of: OwnerOf) -> str:
        """Return why an effect is refused; empty if it is not."""
        effect = held.effect
        for name in effect.surfaces:
            if self._surfaces.layer(held.owner, name) is None:
                return f"names surface {name!r}, which was refused."
        owner = None if effect.finger is None else owner_of(effect.finger)
        if owner is not None and owner != held.owner:
            return f"is on finger {effect.finger}, which is held by {owner!r}: wait until that client releases it."
        asked_um = 0.0 if held.course.is_factor else held.course.largest()
        if asked_um > self._w_limit_um:
            return f"cannot have {asked_um:g} um: ask for at most {self._w_limit_um:g} um."
        room = self._max_knots - 2
        if held.corners <= room:
            return ""
        span_ms = self._least_span_ns * 1e-6
        hint = f"make it {held.corners - room} corners less dense."
        if effect.modulation is not None:
            most_hz = room / (SINE_CORNERS * self._least_span_ns * 1e-9)
            hint = f"a sine has at most {math.floor(most_hz)} Hz."
        return f"needs {held.corners} knots in {span_ms:.3g} ms, a frame on this link has {max(room, 0)}: {hint}"

    # --- playing ---

    def start(self, held: Held, finger_id: int, begin_ns: int) -> bool:
        """Begin to play an effect, from its beginning if it plays already; False where there is no room."""
        playing = [one for one in self.playing if one.held is not held or one.finger_id != finger_id]
        waves = [one.held.corners for one in playing if one.held.is_wave]
        is_full = held.is_wave and len(waves) > 0 and sum(waves) + held.corners > self._max_knots - 2
        if is_full or len(playing) >= MAX_PLAYING:  # of waves no more than their knots
            self.skipped += 1
            return False
        playing.append(Playing(held, finger_id, begin_ns))
        self.playing = playing
        self.begun += 1
        return True

    def resolve(self) -> None:
        """Find the layers that effects name, where the layers have changed."""
        layers = self._surfaces.layers
        if self._layers is layers:
            return
        self._layers = layers
        named = {(layer.owner, layer.name): layer for layer in layers}
        for held in self.held:
            on, start = held.on, held.effect.start
            held.layer = named.get((held.owner, on)) if isinstance(on, str) else None
            held.trigger = named.get((held.owner, start.surface)) if isinstance(start, OnEdge) else None

    def caused(self, cause: Cause, layer: Layer | None) -> list[Held]:
        """Return the effects that this cause starts; `layer` is the one entered, left or crossed, else None."""
        return [held for held in self.held if held.cause is cause and held.trigger is layer]

    # --- reading, for the touch path ---

    def find_felt(
        self, keys: Sequence[FingerKey], owner_of: OwnerOf, predicted_mm: _Predicted, from_ns: int, to_ns: int
    ) -> None:
        """Find what any of these fingers will feel between two instants."""
        self.felt = []
        for one in self.playing:
            for key in keys:
                if isinstance(key, int) and _is_met(one, key, owner_of(key), predicted_mm, from_ns, to_ns):
                    self.felt.append(one)
                    break

    def felt_um(
        self, key: FingerKey, owner: str | None, place_mm: tuple[float, float], t_ns: int, base_um: float
    ) -> float:
        """Return what a finger feels at an instant: its amplitude, plus what is added, times the factors."""
        if isinstance(key, str):
            return base_um
        factor = 1.0
        for one in self.felt:
            held = one.held
            if (owner is not None and owner != held.owner) or not _reaches(one, key, place_mm, t_ns):
                continue
            value = held.course.value(t_ns - one.begin_ns)
            if held.course.is_factor:
                factor *= value
            else:
                base_um += value
        felt_um = base_um * factor
        if not felt_um > 0.0:
            return 0.0
        return felt_um if felt_um < self._w_limit_um else self._w_limit_um

    def frame(self, t_ns: int, frame_duration_ns: int, most: int) -> tuple[int, list[int]]:
        """Return how long a frame of `most` knots from `t_ns` may be, at most `frame_duration_ns`, and the corners
        within it, since its beginning. Where they are too many, those of waves come first."""
        waves, others = set[int](), set[int]()
        for one in self.felt:
            after_ns = t_ns - one.begin_ns
            found_ns = one.held.course.corners_ns(after_ns, after_ns + frame_duration_ns - GRAIN_NS)
            (waves if one.held.is_wave else others).update([corner_ns - after_ns for corner_ns in found_ns])
        room = most - 2
        merged = sorted(waves | others)
        if len(merged) <= room:
            return frame_duration_ns, merged
        if merged[room] >= self._least_span_ns:
            return merged[room], merged[:room]
        if len(waves) > room:
            merged = sorted(waves)
            return max(merged[room], self._least_span_ns), merged[:room]
        merged = sorted(waves) + sorted(others - waves)[: room - len(waves)]
        return self._least_span_ns, sorted([corner for corner in merged if corner < self._least_span_ns])


def _reaches(one: Playing, finger_id: int, place_mm: tuple[float, float], t_ns: int) -> bool:
    """Return whether a finger feels what plays."""
    if one.finger_id != EVERYONE:
        return one.finger_id == finger_id
    on = one.held.on
    if isinstance(on, int):
        return on == finger_id
    if on is None:
        return True
    layer = one.held.layer
    return layer is not None and layer.covers(place_mm[0], place_mm[1], t_ns)


def _is_met(
    one: Playing, finger_id: int, owner: str | None, predicted_mm: _Predicted, from_ns: int, to_ns: int
) -> bool:
    """Return whether a finger feels what plays at any instant of its way."""
    held = one.held
    if owner is not None and owner != held.owner:
        return False
    if one.finger_id != EVERYONE or not isinstance(held.on, str):
        return _reaches(one, finger_id, (0.0, 0.0), from_ns)
    layer = held.layer
    if layer is None:
        return False
    x_mm, y_mm = predicted_mm(finger_id, from_ns)
    to_x_mm, to_y_mm = predicted_mm(finger_id, to_ns)
    way_mm = abs(to_x_mm - x_mm) + abs(to_y_mm - y_mm) + layer.speed_mm_s * (to_ns - from_ns) * 1e-9
    if layer.is_far(x_mm, y_mm, from_ns, way_mm):
        return False
    u_mm, v_mm = layer.local_mm(x_mm, y_mm, from_ns)
    to_u_mm, to_v_mm = layer.local_mm(to_x_mm, to_y_mm, to_ns)
    return layer.holds(u_mm, v_mm) or len(layer.crossings(u_mm, v_mm, to_u_mm, to_v_mm)) > 0
