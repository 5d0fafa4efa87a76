"""Triggers: what fingers do on the plate, as events and as causes of effects.

Landing, lifting and pressure carry the instant of the report that shows them. Crossings of edges are predicted, up to
where the next frame begins: they carry the predicted instant, and an effect begins there. All other effects begin with
the frame of the pass.
"""

from __future__ import annotations

from functools import partial
from typing import Final

from ..values import Cause, EventKind, Finger, FingerFrame
from .events import Events
from .targets.effects import EVERYONE, Held, Playing
from .targets.forms import ENDLESS_NS
from .targets.layer import Layer
from .targets.scene import Scene
from .targets.surfaces import MAX_EDGES, crossing_ns, spans
from .touch.fingers import Fingers
from .trajectory.knots import GRAIN_NS

LEAST_GAP_NS: Final = 10_000_000  # between two starts of an effect by a finger: an edge under a resting finger


class _Touched:
    """A finger that was down at the last look: where, what it is on, and the effects whose button it presses."""

    __slots__ = ("finger", "is_seen", "on", "pressed", "t_device_ns", "t_looked_ns", "t_ns")

    def __init__(self, finger: Finger, t_ns: int, t_device_ns: int) -> None:
        self.finger = finger
        self.t_ns = t_ns
        self.t_device_ns = t_device_ns
        self.on: list[Layer] = []
        self.pressed: list[Held] = []
        self.t_looked_ns = 0
        self.is_seen = False


class Triggers:
    """Finds the events of each pass, and starts and ends effects."""

    def __init__(self, scene: Scene, fingers: Fingers, period_ns: int) -> None:
        """`period_ns`: from one frame to the next."""
        self.events: Final = Events()
        self._surfaces: Final = scene.surfaces
        self._effects: Final = scene.effects
        self._fingers: Final = fingers
        self._period_ns: Final = period_ns
        self._touched: dict[int, _Touched] = {}
        self._lifted: list[_Touched] = []
        self._known: set[Layer] = set()
        self._layers: list[Layer] = []

    # --- from reports ---

    def take(self, frame: FingerFrame) -> None:
        """Take the fingers of a report."""
        t_ns, t_device_ns = self._fingers.t_sample_ns, frame.t_ns
        for finger_id in frame.lifted:
            self._lift(finger_id, t_ns, t_device_ns)
        for finger in frame.fingers:
            touched = self._touched.get(finger.finger_id)
            if touched is None:
                touched = self._touched[finger.finger_id] = _Touched(finger, t_ns, t_device_ns)
                self._tell(EventKind.LANDED, touched)
            touched.finger, touched.t_ns, touched.t_device_ns = finger, t_ns, t_device_ns

    def lift_all(self) -> None:
        """Lift all fingers: the pad is gone or silent."""
        for finger_id in list(self._touched):
            touched = self._touched[finger_id]
            self._lift(finger_id, touched.t_ns, touched.t_device_ns)

    def _lift(self, finger_id: int, t_ns: int, t_device_ns: int) -> None:
        touched = self._touched.pop(finger_id, None)
        if touched is not None:
            touched.t_ns, touched.t_device_ns = t_ns, t_device_ns
            self._lifted.append(touched)
            for held in touched.pressed:
                self._tell(EventKind.RELEASED, touched, held=held)
            for layer in touched.on:
                self._tell(EventKind.LEFT, touched, layer=layer)
            self._tell(EventKind.LIFTED, touched)

    # --- in a pass ---

    def look(self, t_now_ns: int, t_plate_ns: int) -> None:
        """Find what has happened by now, and what will until the next frame; begin and end effects for the frame that
        takes effect at `t_plate_ns`."""
        effects = self._effects
        if effects.held:
            effects.expire(t_now_ns)
            effects.resolve()
        if effects.playing:
            self._end(t_now_ns, t_plate_ns)
        if self._surfaces.layers or self._layers:
            self._look_at_layers(t_now_ns, t_plate_ns)
        if effects.held:
            self._look_at_effects(t_plate_ns)
        for touched in self._lifted:
            self._start(Cause.LIFTING, touched, t_plate_ns, finger_id=EVERYONE)
        self._lifted.clear()
        for touched in self._touched.values():
            touched.is_seen = True
        for one in effects.playing:
            if one.finger_id != EVERYONE:
                self._fingers.release((one.finger_id,))
            elif one.held.effect.on is None:
                self._fingers.hold_all()
            elif isinstance(one.held.effect.on, int):
                self._fingers.release((one.held.effect.on,))

    def _look_at_layers(self, t_now_ns: int, t_plate_ns: int) -> None:
        layers = self._surfaces.layers
        if layers is not self._layers:
            self._layers = layers
            for touched in self._touched.values():
                self._replace_layers(touched, t_now_ns, t_plate_ns)
            known, self._known = self._known, set(layers)
        else:
            known = self._known
        for touched in self._touched.values():
            self._follow(touched, known, t_now_ns, t_plate_ns)

    def _replace_layers(self, touched: _Touched, t_now_ns: int, t_plate_ns: int) -> None:
        """Take the layers that a finger is on from those now in force: a changed one has another object."""
        for layer in touched.on.copy():
            same = [one for one in self._layers if one.name == layer.name and one.owner == layer.owner]
            if same:
                touched.on[touched.on.index(layer)] = same[0]
            else:
                self._leave(touched, layer, t_now_ns, t_plate_ns)

    def _follow(self, touched: _Touched, known: set[Layer], t_now_ns: int, t_plate_ns: int) -> None:
        """Find the edges that a finger will cross until the next frame begins."""
        predicted_mm = partial(self._fingers.predicted_mm, touched.finger.finger_id)
        t_from_ns = max(t_plate_ns, touched.t_looked_ns) if touched.is_seen else t_plate_ns
        t_to_ns = max(t_plate_ns + self._period_ns, t_from_ns + GRAIN_NS)
        x_mm, y_mm = predicted_mm(t_from_ns)
        to_x_mm, to_y_mm = predicted_mm(t_to_ns)
        way_mm = abs(to_x_mm - x_mm) + abs(to_y_mm - y_mm)
        span_ns = t_to_ns - t_from_ns
        on = touched.on
        for layer in self._layers:
            was_on = layer in on
            if not was_on and layer.is_far(x_mm, y_mm, t_from_ns, way_mm + layer.speed_mm_s * span_ns * 1e-9):
                continue
            u_mm, v_mm = layer.local_mm(x_mm, y_mm, t_from_ns)
            if not touched.is_seen or layer not in known:
                was_on = self._place(touched, layer, was_on, layer.holds(u_mm, v_mm), t_now_ns, t_plate_ns)
            to_u_mm, to_v_mm = layer.local_mm(to_x_mm, to_y_mm, t_to_ns)
            shares = layer.crossings(u_mm, v_mm, to_u_mm, to_v_mm)
            for share, from_share, to_share in spans(shares)[:MAX_EDGES] if shares else ():
                since_ns = crossing_ns(layer, predicted_mm, t_from_ns, from_share * span_ns, to_share * span_ns)
                t_ns = t_from_ns + (since_ns + GRAIN_NS if since_ns >= 0 else int(share * span_ns))
                was_on = self._cross(touched, layer, was_on, t_ns)
            if layer.holds(to_u_mm, to_v_mm) != was_on:  # it was predicted otherwise before
                self._cross(touched, layer, was_on, t_from_ns)
        touched.t_looked_ns = t_to_ns

    def _place(
        self, touched: _Touched, layer: Layer, was_on: bool, is_on: bool, t_now_ns: int, t_plate_ns: int
    ) -> bool:
        """Take note of a finger that landed on a layer, or of a layer that appeared, moved or vanished under it."""
        t_ns = t_now_ns if touched.is_seen else touched.t_ns
        if is_on and not was_on:
            self._enter(touched, layer, t_ns, t_plate_ns)
        elif was_on and not is_on:
            self._leave(touched, layer, t_ns, t_plate_ns)
        return is_on

    def _cross(self, touched: _Touched, layer: Layer, was_on: bool, t_ns: int) -> bool:
        self._tell(EventKind.CROSSED, touched, t_ns, layer=layer)
        self._start(Cause.CROSSING, touched, t_ns, layer)
        if was_on:
            self._leave(touched, layer, t_ns, t_ns)
        else:
            self._enter(touched, layer, t_ns, t_ns)
        return not was_on

    def _enter(self, touched: _Touched, layer: Layer, t_ns: int, t_begin_ns: int) -> None:
        touched.on.append(layer)
        self._tell(EventKind.ENTERED, touched, t_ns, layer=layer)
        self._end_by(Cause.LEAVING, touched, layer, t_ns)
        self._start(Cause.ENTERING, touched, t_begin_ns, layer, t_ns)

    def _leave(self, touched: _Touched, layer: Layer, t_ns: int, t_begin_ns: int) -> None:
        self._tell(EventKind.LEFT, touched, t_ns, layer=layer)
        self._end_by(Cause.ENTERING, touched, layer, t_ns)
        self._start(Cause.LEAVING, touched, t_begin_ns, layer, t_ns)
        touched.on.remove(layer)

    def _look_at_effects(self, t_plate_ns: int) -> None:
        for held in self._effects.held:
            cause = held.effect.start.cause
            if cause is Cause.PRESSURE:
                for touched in self._touched.values():
                    self._look_at_pressure(held, touched, t_plate_ns)
            elif held.is_due:
                self._look_at_clock(held, t_plate_ns)
        for touched in self._touched.values():
            if not touched.is_seen:
                self._start(Cause.LANDING, touched, t_plate_ns)
            if touched.pressed:
                touched.pressed = [held for held in touched.pressed if not held.is_gone]

    def _look_at_clock(self, held: Held, t_plate_ns: int) -> None:
        """Start an effect that a message started, in time for its instant."""
        t_ns, t_begin_ns = held.t_from_ns, t_plate_ns
        if held.effect.start.cause is Cause.AT:
            t_ns = t_begin_ns = held.effect.start.t_ns
            if t_ns >= t_plate_ns + self._period_ns:
                return
        held.is_due = False
        if t_begin_ns + held.course.length_ns <= t_plate_ns:
            return  # it came too late
        self._begin(held, None, EVERYONE, t_ns, t_begin_ns)

    def _look_at_pressure(self, held: Held, touched: _Touched, t_plate_ns: int) -> None:
        start, pressure_frac = held.effect.start, touched.finger.pressure_frac
        is_pressed = held in touched.pressed
        if is_pressed and pressure_frac <= start.release_frac:
            touched.pressed.remove(held)
            self._tell(EventKind.RELEASED, touched, held=held)
            self._end_one(held, touched, touched.t_ns)
        elif not is_pressed and pressure_frac >= start.threshold_frac and _is_at(held, touched):
            touched.pressed.append(held)
            self._tell(EventKind.PRESSED, touched, held=held)
            self._begin(held, touched, touched.finger.finger_id, touched.t_ns, t_plate_ns)

    # --- beginnings and ends ---

    def _start(
        self,
        cause: Cause,
        touched: _Touched,
        t_begin_ns: int,
        layer: Layer | None = None,
        t_ns: int | None = None,
        finger_id: int | None = None,
    ) -> None:
        """Start all effects that have this cause; `layer` is the one that was entered, left or crossed."""
        for held in self._effects.held:
            if held.effect.start.cause is cause and held.trigger is layer and _is_at(held, touched):
                t_cause_ns = t_ns if t_ns is not None else touched.t_ns if layer is None else t_begin_ns
                whom = touched.finger.finger_id if finger_id is None else finger_id
                self._begin(held, touched, whom, t_cause_ns, t_begin_ns)

    def _begin(self, held: Held, touched: _Touched | None, finger_id: int, t_ns: int, t_begin_ns: int) -> None:
        if touched is not None:
            mine = touched.finger.finger_id
            t_last_ns = held.started_ns.get(mine)
            if t_last_ns is not None and t_begin_ns - t_last_ns < LEAST_GAP_NS:
                self._effects.skipped += 1
                return
            held.started_ns = {one: at_ns for one, at_ns in held.started_ns.items() if one in self._touched}
            held.started_ns[mine] = t_begin_ns
        if self._effects.start(held, finger_id, -(-t_begin_ns // GRAIN_NS) * GRAIN_NS):
            self._tell(EventKind.BEGUN, touched, t_ns, held=held)

    def _end(self, t_now_ns: int, t_plate_ns: int) -> None:
        """End what has played to its end, what is no longer in force, and what played for a finger that has lifted."""
        for one in self._effects.playing:
            if one.end_ns <= t_plate_ns:
                self._stop(one, one.end_ns)
            elif one.held.is_gone or (one.finger_id != EVERYONE and one.finger_id not in self._touched):
                self._stop(one, t_now_ns)

    def _end_by(self, cause: Cause, touched: _Touched, layer: Layer, t_ns: int) -> None:
        """End what this cause started and only its opposite ends."""
        for one in self._effects.playing:
            held = one.held
            if held.effect.start.cause is cause and held.trigger is layer:
                self._end_one(held, touched, t_ns)

    def _end_one(self, held: Held, touched: _Touched, t_ns: int) -> None:
        for one in self._effects.playing:
            if one.held is held and one.finger_id == touched.finger.finger_id and one.end_ns >= ENDLESS_NS:
                self._stop(one, t_ns)

    def _stop(self, one: Playing, t_ns: int) -> None:
        self._effects.playing = [other for other in self._effects.playing if other is not one]
        touched = self._touched.get(one.finger_id)
        if touched is None and one.finger_id != EVERYONE:  # it has lifted
            client, effect = one.held.owner, one.held.name
            self.events.add(EventKind.ENDED, t_ns, finger_id=one.finger_id, client=client, effect=effect)
        else:
            self._tell(EventKind.ENDED, touched, t_ns, held=one.held)

    def _tell(
        self,
        kind: EventKind,
        touched: _Touched | None,
        t_ns: int | None = None,
        layer: Layer | None = None,
        held: Held | None = None,
    ) -> None:
        client = layer.owner if layer is not None else held.owner if held is not None else ""
        surface = "" if layer is None else layer.name
        effect = "" if held is None else held.name
        if touched is None:
            self.events.add(kind, t_ns or 0, client=client, surface=surface, effect=effect)
            return
        finger = touched.finger
        if t_ns is None:
            t_ns = touched.t_ns
        t_device_ns = touched.t_device_ns + t_ns - touched.t_ns
        place_mm = (finger.x_mm, finger.y_mm)
        self.events.add(kind, t_ns, t_device_ns, finger.finger_id, place_mm, client, surface, effect)


def _is_at(held: Held, touched: _Touched) -> bool:
    """Return whether a finger is where an effect is."""
    on = held.effect.on
    if on is None:
        return True
    if isinstance(on, int):
        return on == touched.finger.finger_id
    return held.layer is not None and held.layer in touched.on
