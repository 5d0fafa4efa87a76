"""Layers under each finger, and the instants at which it will cross their edges until the next frame begins."""

from __future__ import annotations

from functools import partial
from typing import Final, NamedTuple

from ..values import Finger
from .targets.effects import Held
from .targets.layer import Layer
from .targets.surfaces import MAX_EDGES, SurfaceSet, crossing_ns, meeting
from .touch.fingers import Fingers
from .trajectory.gate import GRAIN_NS

MAX_FOLLOWED: Final = 32  # crossings in one pass, of all fingers; of further layers only what has changed at its end


class TouchedContents:
    """A finger that was down in the last pass: where, what it is on, for which effects it presses hard enough, and for
    which of these it began to where they are."""

    def __init__(self, finger: Finger, t_ns: int, t_device_ns: int) -> None:
        self.finger = finger
        self.t_ns = t_ns  # of its newest sample, on the host's axis and on the pad's
        self.t_device_ns = t_device_ns
        self.on: dict[Layer, None] = {}  # in the order in which it came to them, as are the others
        self.hard: dict[Held, None] = {}
        self.pressed: dict[Held, None] = {}
        self.t_checked_ns = 0
        self.is_seen = False


class Change(NamedTuple):
    """A layer that a finger enters or leaves at an instant: across its edge, or because one of both appeared, moved or
    vanished."""

    t_ns: int
    layer: Layer
    is_on: bool
    is_crossing: bool


class Crossings:
    """Follows fingers over the layers in force."""

    def __init__(self, surfaces: SurfaceSet, fingers: Fingers, period_ns: int) -> None:
        """`period_ns`: from one frame to the next."""
        self._surfaces: Final = surfaces
        self._fingers: Final = fingers
        self.period_ns = period_ns
        self.layers: list[Layer] = []  # of the last pass
        self._known: set[Layer] = set()  # the same
        self._new: set[Layer] = set()
        self._named: dict[tuple[str, str], Layer] = {}
        self._left = MAX_FOLLOWED

    def begin(self) -> None:
        """Begin a pass."""
        self._left, layers = MAX_FOLLOWED, self._surfaces.layers
        if layers is not self.layers:
            self.layers = layers
            self._new = set(layers) - self._known
            self._known = set(layers)
            self._named = {(layer.owner, layer.name): layer for layer in layers}
        elif self._new:
            self._new = set()

    def changes(self, touched: TouchedContents, t_now_ns: int, t_plate_ns: int) -> list[Change]:
        """Return what has changed for a finger by now, then the edges that it will cross, in order."""
        found: list[Change] = []
        if touched.on:
            self._take_changed_layers(touched, t_now_ns, found)
        finger_id = touched.finger.finger_id
        t_from_ns = max(t_plate_ns, touched.t_checked_ns)
        t_to_ns = max(t_plate_ns + self.period_ns, t_from_ns + GRAIN_NS)
        place_mm = self._fingers.predicted_mm(finger_id, t_from_ns)
        to_place_mm = self._fingers.predicted_mm(finger_id, t_to_ns)
        way_mm = abs(to_place_mm[0] - place_mm[0]) + abs(to_place_mm[1] - place_mm[1])
        span_s = (t_to_ns - t_from_ns) * 1e-9
        t_change_ns = t_now_ns if touched.is_seen else touched.t_ns
        crossed: list[Change] = []
        for layer in self.layers:
            was_on = layer in touched.on
            if layer.is_whole and was_on:
                continue
            if not was_on and layer.is_far(place_mm[0], place_mm[1], t_from_ns, way_mm + layer.speed_mm_s * span_s):
                continue
            if not touched.is_seen or layer in self._new:
                is_on = layer.covers(place_mm[0], place_mm[1], t_from_ns)
                if is_on != was_on:
                    found.append(Change(t_change_ns, layer, is_on, False))
                    was_on = is_on
            if not layer.is_whole:
                crossed += self._crossed(finger_id, layer, was_on, place_mm, to_place_mm, t_from_ns, t_to_ns)
        touched.t_checked_ns = t_to_ns
        crossed.sort(key=lambda change: change.t_ns)
        return found + crossed

    def _crossed(
        self,
        finger_id: int,
        layer: Layer,
        is_on: bool,
        place_mm: tuple[float, float],
        to_place_mm: tuple[float, float],
        t_from_ns: int,
        t_to_ns: int,
    ) -> list[Change]:
        end_mm = layer.local_mm(to_place_mm[0], to_place_mm[1], t_to_ns)
        if self._left <= 0:  # where it will be is enough
            is_off = layer.holds(end_mm[0], end_mm[1]) != is_on
            return [Change(t_from_ns, layer, not is_on, True)] if is_off else []
        start_mm = layer.local_mm(place_mm[0], place_mm[1], t_from_ns)
        span_ns = t_to_ns - t_from_ns
        turns_ns = layer.turns_ns(t_from_ns, span_ns, MAX_EDGES)
        predicted_mm = partial(self._fingers.predicted_mm, finger_id)
        _, met = meeting(layer, start_mm, end_mm, turns_ns, predicted_mm, t_from_ns, span_ns)
        found: list[Change] = []
        for at_ns, after_ns, before_ns in met[:MAX_EDGES]:
            since_ns = crossing_ns(layer, predicted_mm, t_from_ns, after_ns, before_ns)
            since_ns = since_ns + GRAIN_NS if since_ns >= 0 else int(at_ns)
            is_on = not is_on
            found.append(Change(t_from_ns + since_ns, layer, is_on, True))
        self._left -= len(found)
        if layer.holds(end_mm[0], end_mm[1]) != is_on:  # it was predicted otherwise before
            found.append(Change(found[-1].t_ns if found else t_from_ns, layer, not is_on, True))
        return found

    def _take_changed_layers(self, touched: TouchedContents, t_now_ns: int, found: list[Change]) -> None:
        """Replace layers that a message has changed, which have another object, and leave those that are gone."""
        if self._known.issuperset(touched.on):
            return
        still_on: dict[Layer, None] = {}
        for layer in touched.on:
            same = self._named.get((layer.owner, layer.name))
            if same is None:
                found.append(Change(t_now_ns, layer, False, False))
            still_on[layer if same is None else same] = None
        touched.on = still_on
