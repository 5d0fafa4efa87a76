"""Triggers: what fingers do on the plate, as events and as causes of effects.

Landing, lifting and pressure carry the instant of the report that shows them. Crossings of edges are predicted, up to
where the next frame begins: they carry the predicted instant, and an effect begins there. All other effects begin with
the frame of the pass.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Final

from hapticd_contract.effects import At, OnCrossing, OnEntering, OnLanding, OnLeaving, OnLifting, OnPressure
from hapticd_contract.states import EventKind, PlateEvent

from ..values import Finger, FingerFrame
from .crossings import Change, Crossings, TouchedContents
from .targets.effects import EVERYONE, Cause, Held, Playing
from .targets.forms import ENDLESS_NS
from .targets.layer import Layer
from .targets.scene import Scene
from .touch.fingers import Fingers
from .trajectory.gate import GRAIN_NS

LEAST_GAP_NS: Final = 10_000_000  # between two starts of an effect by a finger: an edge under a resting finger
MAX_AT_ONCE: Final = 256  # in one state: further ones wait for the next. 32 effects begin and 32 end in a pass
MAX_CROSSINGS: Final = 64  # waiting: those beyond are lost, which the sequence number shows
MAX_WAITING: Final = 2048  # all fingers' pressure on all effects, and more: a bound that nothing reaches
LOSSY: Final = (EventKind.ENTERED, EventKind.LEFT, EventKind.CROSSED)  # of which layers may cause any number


class Events:
    """Events since they were last taken. Their numbers count all, also the lost ones.

    Only crossings may be lost, beyond MAX_CROSSINGS: all else is bounded by fingers and effects.
    """

    def __init__(self) -> None:
        self.count = 0
        self.lost = 0
        self.waiting: deque[PlateEvent] = deque()
        self._crossings = 0  # waiting

    def add(
        self,
        kind: EventKind,
        touched: TouchedContents | None,
        t_ns: int | None = None,
        layer: Layer | None = None,
        held: Held | None = None,
        finger_id: int | None = None,
    ) -> None:
        """Add one; `t_ns` is when its cause occurred, on the host's axis: without it at the finger's newest sample.
        `finger_id` is that of a finger that has lifted."""
        self.count += 1
        is_crossing = kind in LOSSY
        if (is_crossing and self._crossings >= MAX_CROSSINGS) or len(self.waiting) >= MAX_WAITING:
            self.lost += 1
            return
        self._crossings += is_crossing
        t_device_ns: int | None = None
        x_mm: float | None = None
        y_mm: float | None = None
        if touched is not None:
            t_ns = touched.t_ns if t_ns is None else t_ns
            t_device_ns = touched.t_device_ns + t_ns - touched.t_ns
            finger_id, x_mm, y_mm = touched.finger.finger_id, touched.finger.x_mm, touched.finger.y_mm
        client = layer.owner if layer is not None else held.owner if held is not None else ""
        surface, effect = "" if layer is None else layer.name, "" if held is None else held.name
        event = PlateEvent(self.count, kind, t_ns or 0, t_device_ns, finger_id, x_mm, y_mm, client, surface, effect)
        self.waiting.append(event)

    def take(self) -> tuple[PlateEvent, ...]:
        """Return the events since the last call, up to MAX_AT_ONCE."""
        taken = tuple([self.waiting.popleft() for _ in range(min(len(self.waiting), MAX_AT_ONCE))])
        self._crossings -= sum([event.kind in LOSSY for event in taken])
        return taken


class Triggers:
    """Finds the events of each pass, and starts and ends effects: where fingers land or lift, or the scene has surfaces
    or effects."""

    def __init__(self, scene: Scene, fingers: Fingers, period_ns: int) -> None:
        """`period_ns`: from one frame to the next."""
        self.events: Final = Events()
        self._effects: Final = scene.effects
        self._surfaces: Final = scene.surfaces
        self._fingers: Final = fingers
        self._crossings: Final = Crossings(scene.surfaces, fingers, period_ns)
        self._touched: dict[int, TouchedContents] = {}
        self._lifted: list[TouchedContents] = []
        self.is_due = False  # in the next pass, whatever is in force: fingers landed or lifted, or a surface was there

    def set_period(self, period_ns: int) -> None:
        """Take the time from one frame to the next to be this from now on."""
        self._crossings.period_ns = period_ns

    # --- from reports ---

    def take(self, frame: FingerFrame, before: Iterable[Finger]) -> None:
        """Take the fingers of a report that shows landing or lifting, and those of the report before."""
        t_ns, t_device_ns = self._fingers.t_sample_ns, frame.t_ns
        self._update(before, t_ns, t_device_ns)
        self.is_due = True
        for finger_id in frame.lifted:
            self._lift(finger_id)
        for finger in frame.fingers:
            if finger.finger_id not in self._touched:
                touched = self._touched[finger.finger_id] = TouchedContents(finger, t_ns, t_device_ns)
                self.events.add(EventKind.LANDED, touched)

    def lift_all(self) -> None:
        """Lift all fingers, which are still down: the pad is gone or silent."""
        self._update(self._fingers.down, self._fingers.t_sample_ns, self._fingers.t_device_ns)
        self.is_due = True
        for finger_id in list(self._touched):
            self._lift(finger_id)

    def _update(self, fingers: Iterable[Finger], t_ns: int, t_device_ns: int) -> None:
        for finger in fingers:
            touched = self._touched[finger.finger_id]
            touched.finger, touched.t_ns, touched.t_device_ns = finger, t_ns, t_device_ns

    def _lift(self, finger_id: int) -> None:
        touched = self._touched.pop(finger_id, None)
        if touched is not None:
            self._lifted.append(touched)
            for held in touched.pressed:
                self.events.add(EventKind.RELEASED, touched, held=held)
            for layer in touched.on:
                self.events.add(EventKind.LEFT, touched, layer=layer)
            self.events.add(EventKind.LIFTED, touched)

    # --- in a pass ---

    def check(self, t_now_ns: int, t_plate_ns: int) -> None:
        """Find what has happened by now, and what will until the next frame; begin and end effects for the frame that
        takes effect at `t_plate_ns`."""
        effects = self._effects
        self._update(self._fingers.down, self._fingers.t_sample_ns, self._fingers.t_device_ns)
        if effects.held:
            effects.expire(t_now_ns)
            effects.resolve()
        if effects.playing:
            self._end(t_now_ns, t_plate_ns)
        if self._surfaces.layers or self._crossings.layers:
            self._crossings.begin()
            for touched in self._touched.values():
                for change in self._crossings.changes(touched, t_now_ns, t_plate_ns):
                    self._apply(change, touched, t_plate_ns)
        if effects.held:
            self._check_effects(t_plate_ns)
        for touched in self._lifted:
            self._start(OnLifting, touched, touched.t_ns, t_plate_ns)
        self._lifted.clear()
        for touched in self._touched.values():
            touched.is_seen = True
        self.is_due = len(self._crossings.layers) > 0
        for one in effects.playing:
            on = one.held.on if one.finger_id == EVERYONE else one.finger_id
            if on is None:
                self._fingers.hold_all()
            elif isinstance(on, int):
                self._fingers.release((on,))

    def _apply(self, change: Change, touched: TouchedContents, t_plate_ns: int) -> None:
        """Take note of a layer that a finger enters or leaves."""
        t_ns, layer = change.t_ns, change.layer
        t_begin_ns = t_ns if change.is_crossing else t_plate_ns
        if change.is_crossing:
            self.events.add(EventKind.CROSSED, touched, t_ns, layer=layer)
            self._start(OnCrossing, touched, t_ns, t_ns, layer)
        if change.is_on:
            touched.on[layer] = None
        kind = EventKind.ENTERED if change.is_on else EventKind.LEFT
        cause, opposite = (OnEntering, OnLeaving) if change.is_on else (OnLeaving, OnEntering)
        self.events.add(kind, touched, t_ns, layer=layer)
        for held in [one.held for one in self._effects.playing]:  # what only its opposite ends
            if held.cause is opposite and held.trigger is layer:
                self._end_one(held, touched, t_ns)
        self._start(cause, touched, t_ns, t_begin_ns, layer)
        if not change.is_on:
            touched.on.pop(layer, None)

    def _check_effects(self, t_plate_ns: int) -> None:
        for held in self._effects.held:
            if held.is_due:
                self._check_clock(held, t_plate_ns)
            elif held.cause is OnPressure:
                for touched in self._touched.values():
                    self._check_pressure(held, touched, t_plate_ns)
            held.is_new = False
        for touched in self._touched.values():
            if not touched.is_seen:
                self._start(OnLanding, touched, touched.t_ns, t_plate_ns)
            if touched.hard:
                touched.hard = {held: None for held in touched.hard if not held.is_gone}
                touched.pressed = {held: None for held in touched.pressed if not held.is_gone}

    def _check_clock(self, held: Held, t_plate_ns: int) -> None:
        """Start an effect that a message started, in time for its instant."""
        t_ns, t_begin_ns = held.t_from_ns, t_plate_ns
        start = held.effect.start
        if isinstance(start, At):
            t_ns = t_begin_ns = start.t_ns
            if t_ns >= t_plate_ns + self._crossings.period_ns:
                return
        held.is_due = False
        if t_begin_ns + held.course.length_ns <= t_plate_ns:
            return  # it came too late
        self._begin(held, None, EVERYONE, t_ns, t_begin_ns)

    def _check_pressure(self, held: Held, touched: TouchedContents, t_plate_ns: int) -> None:
        start, pressure_frac = held.effect.start, touched.finger.pressure_frac
        if not isinstance(start, OnPressure):
            return
        if held in touched.hard:
            if pressure_frac <= start.release_frac:
                del touched.hard[held]
                if held in touched.pressed:
                    del touched.pressed[held]
                    self.events.add(EventKind.RELEASED, touched, held=held)
                    self._end_one(held, touched, touched.t_ns)
            return
        if held.is_new and touched.is_seen:
            if pressure_frac > start.release_frac:
                touched.hard[held] = None  # it pressed already
        elif pressure_frac >= start.threshold:
            touched.hard[held] = None
            if _is_at(held, touched):
                touched.pressed[held] = None
                self.events.add(EventKind.PRESSED, touched, held=held)
                self._begin(held, touched, touched.finger.finger_id, touched.t_ns, t_plate_ns)

    # --- beginnings and ends ---

    def _start(
        self, cause: Cause, touched: TouchedContents, t_ns: int, t_begin_ns: int, layer: Layer | None = None
    ) -> None:
        """Start all effects that have this cause; `layer` is the one that was entered, left or crossed."""
        for held in self._effects.caused(cause, layer):
            if _is_at(held, touched):
                playing_id = EVERYONE if cause is OnLifting else touched.finger.finger_id
                self._begin(held, touched, playing_id, t_ns, t_begin_ns)

    def _begin(self, held: Held, touched: TouchedContents | None, finger_id: int, t_ns: int, t_begin_ns: int) -> None:
        if touched is not None:
            mine = touched.finger.finger_id
            t_last_ns = held.started_ns.get(mine)
            if t_last_ns is not None and t_begin_ns - t_last_ns < LEAST_GAP_NS:
                self._effects.skipped += 1
                return
            held.started_ns = {one: at_ns for one, at_ns in held.started_ns.items() if one in self._touched}
            held.started_ns[mine] = t_begin_ns
        if self._effects.start(held, finger_id, -(-t_begin_ns // GRAIN_NS) * GRAIN_NS):
            self.events.add(EventKind.BEGUN, touched, t_ns, held=held)

    def _end(self, t_now_ns: int, t_plate_ns: int) -> None:
        """End what has played to its end, what is no longer in force, and what played for a finger that has lifted."""
        for one in self._effects.playing:
            if one.end_ns <= t_plate_ns:
                self._stop(one, one.end_ns)
            elif one.held.is_gone or (one.finger_id != EVERYONE and one.finger_id not in self._touched):
                self._stop(one, t_now_ns)

    def _end_one(self, held: Held, touched: TouchedContents, t_ns: int) -> None:
        for one in self._effects.playing:
            if one.held is held and one.finger_id == touched.finger.finger_id and one.end_ns >= ENDLESS_NS:
                self._stop(one, t_ns)

    def _stop(self, one: Playing, t_ns: int) -> None:
        self._effects.playing = [other for other in self._effects.playing if other is not one]
        touched, finger_id = self._touched.get(one.finger_id), None if one.finger_id == EVERYONE else one.finger_id
        self.events.add(EventKind.ENDED, touched, t_ns, held=one.held, finger_id=finger_id)


def _is_at(held: Held, touched: TouchedContents) -> bool:
    """Return whether a finger is where an effect is."""
    on = held.on
    if on is None:
        return True
    if isinstance(on, int):
        return on == touched.finger.finger_id
    return held.layer is not None and held.layer in touched.on
