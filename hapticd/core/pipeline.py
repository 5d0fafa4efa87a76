"""A touch's way from a trackpad frame to a reference polyline, in one pass and with no queue.

    touch():  track the contacts, give each finger's predictor its sample
    drive():  for each knot time: predict the positions, ask the scene what each finger should feel, evaluate the
              mode matrix there, solve for the modal amplitudes; then gate the polyline

Pure: all instants are arguments, and the same calls give the same drives bit for bit. What a scene does not need is
skipped and counted: no finger, no target, or fingers so still that the last reference stands.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

from ..values import Drive, Finger, FingerFrame, Knot, LimitReason, SafeDrive, Tick, TouchFrame, TouchPoint
from .limits import gate, silence
from .modes import ModeShapes
from .scene import Scene
from .sensor_clock import SensorClock
from .solver import solve_fast
from .tracking import Tracker

OLD_IN_A_ROW = 3  # a frame out of order comes alone; several in a row: the pad's clock was laid anew
MAX_HORIZON_NS = 50_000_000  # predictors are judged up to here; a knot beyond would be a guess


class Predictor(Protocol):
    """Where a finger will be; see `core.prediction`."""

    def update(self, t_ns: int, x_mm: float, y_mm: float) -> None: ...

    def predict(self, t_ns: int) -> tuple[float, float]: ...

    def velocity(self, t_ns: int) -> tuple[float, float]: ...


@dataclass(frozen=True, slots=True)
class PipelineSettings:
    """What the pipeline is told once.

    `fade` is how far amplitude gives way where a limit keeps a slippery finger from its target anyway (see `_faded`).
    `cover_ns` is how long one frame must carry the plate: one and a half report periods, so that one lost report
    leaves it on known ground. `loop_delay_ns` is by how much the plate follows its reference late.
    """

    w_limit_um: tuple[float, ...]
    make_predictor: Callable[[], Predictor]
    policy: str = "keep_zero"
    effort: float = 0.0
    fade: float = 0.0
    tolerance_um: float = 0.01
    max_knots: int = 16
    sensor_latency_ns: int = 10_000_000
    loop_delay_ns: int = 0
    cover_ns: int = 17_000_000
    silence_ns: int = 40_000_000


class Place(NamedTuple):
    """Where a finger will be at one knot, and the amplitude wanted there."""

    key: int | str
    x_mm: float
    y_mm: float
    target_um: float


@dataclass(slots=True)
class PipelineCounters:
    """How often each thing was done or spared; shown in `status`."""

    frames: int = 0
    passes: int = 0
    solves: int = 0
    limited: int = 0
    gated: int = 0
    skipped_no_finger: int = 0
    skipped_no_target: int = 0
    skipped_standing: int = 0


class Pipeline:
    """The touch path for one plate. Holds the fingers, their predictors and the reference that stands."""

    def __init__(self, modes: ModeShapes, scene: Scene, settings: PipelineSettings) -> None:
        self.counters = PipelineCounters()
        self.fingers: tuple[Finger, ...] = ()
        self._modes = modes
        self._scene = scene
        self._settings = settings
        self._tracker = Tracker()
        self._sensor_clock = SensorClock(settings.sensor_latency_ns)
        self._predictors: dict[int, Predictor] = {}
        self._released: set[int] = set()
        self._t_frame_ns = 0
        self._old_in_a_row = 0
        self._t_sample_ns = 0
        self._t_read_ns = 0
        self._steepness_1_mm = modes.steepest_1_mm()
        self._standing = silence(0, modes.M)
        self._standing_places: tuple[Place, ...] = ()
        self._is_told = True
        self._t_settled_ns = 0
        self._standing_points: tuple[tuple[TouchPoint, ...], bool] = ((), False)

    @property
    def modal_um(self) -> tuple[float, ...]:
        """The modal amplitudes at the first knot of the reference that stands."""
        return tuple(w_um.real for w_um in self._standing.knots[0].modal_um)

    # --- from the trackpad ---

    def touch(self, frame: TouchFrame, t_read_ns: int) -> FingerFrame:
        """Take one report: track its contacts and feed the predictors, on the host's time axis."""
        self.counters.frames += 1
        self._t_read_ns = t_read_ns
        self._old_in_a_row = self._old_in_a_row + 1 if frame.t_ns < self._t_frame_ns else 0
        if self._old_in_a_row == OLD_IN_A_ROW:
            self.sensor_lost()
        t_sample_ns = self._sensor_clock.update(frame.t_ns, t_read_ns)
        tracked = self._tracker.update(frame)
        for finger_id in tracked.lifted:
            self._forget(finger_id)
        if tracked.t_ns != frame.t_ns:
            return tracked  # an old frame: it says nothing new
        self._t_frame_ns = frame.t_ns
        self._t_sample_ns = t_sample_ns
        for finger in tracked.fingers:
            if finger.is_new:
                self._predictors[finger.finger_id] = self._settings.make_predictor()
            self._predictors[finger.finger_id].update(self._t_sample_ns, finger.x_mm, finger.y_mm)
        self.fingers = tracked.fingers
        return tracked

    def sensor_lost(self) -> None:
        """The pad is gone or silent: every finger counts as lifted."""
        for finger in self.fingers:
            self._forget(finger.finger_id)
        self.fingers = ()
        self._tracker.reset()
        self._sensor_clock.reset()
        self._t_frame_ns = self._old_in_a_row = 0

    def sensor_is_silent(self, t_now_ns: int) -> bool:
        """Fingers are down and no report came for too long (then call `sensor_lost`)."""
        return len(self.fingers) > 0 and t_now_ns - self._t_read_ns > self._settings.silence_ns

    def release(self, keys: Sequence[int | str]) -> None:
        """Targets of these fingers ended: while such a finger stays down it is held at 0 um."""
        self._released.update(key for key in keys if isinstance(key, int) and key in self._predictors)

    # --- to the plate ---

    def wanted(self, t_now_ns: int) -> list[int | str]:
        """Fingers to solve for: those with a target, and those whose target ended while they are down."""
        scene, released = self._scene, self._released
        keys: list[int | str] = [
            finger.finger_id
            for finger in self.fingers
            if finger.finger_id in released or scene.target_of(finger.finger_id) is not None
        ]
        keys += [name for name in scene.virtual_names(t_now_ns) if scene.target_of(name) is not None]
        return keys

    def drive(self, t_now_ns: int, link_ns: int) -> Tick:
        """One pass: the reference polyline that takes effect `link_ns` from now, or none where the last one stands."""
        self.counters.passes += 1
        t_apply_ns = t_now_ns + link_ns
        t_plate_ns = t_apply_ns + self._settings.loop_delay_ns
        keys = self.wanted(t_now_ns)
        if not keys:
            return self.rest(t_now_ns, link_ns)
        offsets_ns = self._knot_offsets_ns(keys, t_plate_ns)
        still = self._still(keys, t_apply_ns, (t_plate_ns, t_plate_ns + offsets_ns[-1]))
        if still is not None:
            self.counters.skipped_standing += 1
            points, limited = self._standing_points
            return self._tick(t_now_ns, t_plate_ns, None, tuple(map(_moved, points, still)), limited)

        track = [[self._place(key, t_plate_ns + dt_ns) for key in keys] for dt_ns in offsets_ns]
        phi = [tuple(self._modes.at(place.x_mm, place.y_mm) for place in places) for places in track]
        modal_um, limited = self._solve(phi, track, self._standing_um(t_apply_ns))
        knots = tuple(Knot(dt_ns, tuple(map(complex, w_um))) for dt_ns, w_um in zip(offsets_ns, modal_um, strict=True))
        drive = gate(Drive(t_apply_ns, knots), self._settings.w_limit_um)

        self.counters.gated += drive.reasons is not LimitReason.NONE
        self._standing, self._standing_places, self._is_told = drive, tuple(track[-1]), True
        self._t_settled_ns = _settles_ns(drive, self._settings.tolerance_um)
        self._standing_points = _points(track[0], track[-1], phi[0], modal_um[0]), limited
        return self._tick(t_now_ns, t_plate_ns, drive, *self._standing_points)

    def rest(self, t_now_ns: int, link_ns: int) -> Tick:
        """Nobody wants anything, or nobody may have it: one zero frame, then none."""
        if self.fingers:
            self.counters.skipped_no_target += 1
        else:
            self.counters.skipped_no_finger += 1
        is_silent = len(self._standing.knots) == 1 and not any(self._standing.knots[0].modal_um)
        drive = None if is_silent and self._is_told else silence(t_now_ns + link_ns, self._modes.M)
        if drive is not None:
            self._standing, self._standing_places, self._is_told = drive, (), True
        return self._tick(t_now_ns, t_now_ns + link_ns, drive, (), False)

    def forget_standing(self) -> None:
        """The board does not hold the last reference: the next pass sends one, however still the fingers are."""
        self._is_told = False

    # --- the steps of a pass ---

    def _place(self, key: int | str, t_ns: int) -> Place:
        x_mm, y_mm = self._position_mm(key, t_ns)
        target_um = self._scene.amplitude_um(key, x_mm, y_mm)
        return Place(key, x_mm, y_mm, 0.0 if target_um is None else target_um)

    def _position_mm(self, key: int | str, t_ns: int) -> tuple[float, float]:
        if isinstance(key, str):
            return self._scene.virtual_position_mm(key, t_ns)
        return self._predictors[key].predict(min(t_ns, self._t_sample_ns + MAX_HORIZON_NS))

    def _speed_mm_s(self, key: int | str, t_ns: int) -> float:
        if isinstance(key, str):
            return self._scene.virtual_speed_mm_s(key)
        return math.hypot(*self._predictors[key].velocity(t_ns))

    def _knot_offsets_ns(self, keys: Sequence[int | str], t_plate_ns: int) -> list[int]:
        """As many knots as the tolerance needs: over dt a chord of W sin(rate t) errs by W (rate dt)^2 / 8."""
        settings = self._settings
        rate_1_s = self._steepness_1_mm * sum(self._speed_mm_s(key, t_plate_ns) for key in keys)
        chord_s = math.sqrt(8 * settings.tolerance_um / max(settings.w_limit_um))
        intervals = math.ceil(min(settings.cover_ns * 1e-9 * rate_1_s / chord_s, settings.max_knots - 1))
        if settings.max_knots == 1:
            return [0]
        count = max(intervals, 1)
        return [settings.cover_ns * index // count // 1000 * 1000 for index in range(count + 1)]

    def _still(self, keys: Sequence[int | str], t_apply_ns: int, span_ns: tuple[int, int]) -> list[Place] | None:
        """Where the fingers are when the frame begins, if the last reference has come to rest and they are, from then
        to the frame's end, where it was made for: then it stands."""
        standing = self._standing_places
        if not self._is_told or len(standing) != len(keys) or t_apply_ns < self._t_settled_ns:
            return None
        steepness_um_mm = self._steepness_1_mm * sum(abs(w_um) for w_um in self._standing.knots[-1].modal_um)
        first, last = ([self._place(key, t_ns) for key in keys] for t_ns in span_ns)
        for now, was in zip((*first, *last), (*standing, *standing), strict=True):
            moved_um = steepness_um_mm * math.hypot(now.x_mm - was.x_mm, now.y_mm - was.y_mm)
            if now.key != was.key or now.target_um != was.target_um or not moved_um <= self._settings.tolerance_um:
                return None
        return first

    def _solve(
        self,
        phi: Sequence[tuple[tuple[float, ...], ...]],
        track: Sequence[Sequence[Place]],
        previous_um: tuple[float, ...],
    ) -> tuple[list[tuple[float, ...]], bool]:
        """Modal amplitudes knot by knot, each as near to the one before as its finger's wishes leave free."""
        settings = self._settings
        modal_um, any_limited = [], False
        for rows, places in zip(phi, track, strict=True):
            targets_um = tuple(place.target_um for place in places)
            previous_um, limited = solve_fast(
                rows, targets_um, settings.w_limit_um, previous_um, settings.policy, settings.effort
            )
            if limited and settings.fade > 0.0:
                previous_um = _faded(rows, targets_um, previous_um, settings.fade)
            modal_um.append(previous_um)
            any_limited |= limited
        self.counters.solves += len(modal_um)
        self.counters.limited += any_limited
        return modal_um, any_limited

    def _standing_um(self, t_ns: int) -> tuple[float, ...]:
        """The standing polyline at `t_ns`: what the new one continues."""
        drive = self._standing
        before = drive.knots[0]
        for after in drive.knots[1:]:
            span_ns = after.dt_ns - before.dt_ns
            share = (t_ns - drive.t_apply_ns - before.dt_ns) / span_ns
            if share < 1.0:
                share = max(share, 0.0)
                pairs = zip(before.modal_um, after.modal_um, strict=True)
                return tuple(a.real + (b.real - a.real) * share for a, b in pairs)
            before = after
        return tuple(w_um.real for w_um in before.modal_um)

    def _tick(
        self, t_now_ns: int, t_plate_ns: int, drive: SafeDrive | None, points: tuple[TouchPoint, ...], limited: bool
    ) -> Tick:
        t_sample_ns = self._t_sample_ns if self.fingers else t_now_ns
        return Tick(t_now_ns, t_now_ns - t_sample_ns, t_plate_ns - t_sample_ns, drive, points, limited)

    def _forget(self, finger_id: int) -> None:
        self._predictors.pop(finger_id, None)
        self._released.discard(finger_id)


def _faded(
    rows: Sequence[Sequence[float]], targets_um: Sequence[float], modal_um: tuple[float, ...], fade: float
) -> tuple[float, ...]:
    """Less amplitude where the limit leaves a slippery finger only a share of its target: that share to `fade`.

    Near a singular position the slippery finger gets next to nothing from modes at their limits, and the sticky one
    pays for it: what it feels of a position's error grows with the amplitude. All modes are scaled together, so the
    zero stays; where targets are met nothing changes.
    """
    if 0.0 not in targets_um:
        return modal_um
    shares = [
        abs(sum(phi * w_um for phi, w_um in zip(row, modal_um, strict=True))) / target_um
        for row, target_um in zip(rows, targets_um, strict=True)
        if target_um > 0.0
    ]
    scale = min(min(shares, default=1.0), 1.0) ** fade
    return tuple(w_um * scale for w_um in modal_um)


def _settles_ns(drive: SafeDrive, tolerance_um: float) -> int:
    """From when on a polyline is within the tolerance of its last knot: at once, or when it gets there."""
    last = drive.knots[-1]
    is_flat = all(
        abs(w_um - last_um) <= tolerance_um
        for knot in drive.knots
        for w_um, last_um in zip(knot.modal_um, last.modal_um, strict=True)
    )
    return drive.t_apply_ns if is_flat else drive.t_apply_ns + last.dt_ns


def _moved(point: TouchPoint, now: Place) -> TouchPoint:
    """A finger that moved while the reference stood: by less than matters, or any way while all is still."""
    return replace(point, x_mm=now.x_mm, y_mm=now.y_mm, end_x_mm=now.x_mm, end_y_mm=now.y_mm)


def _points(
    first: Sequence[Place], last: Sequence[Place], rows: Sequence[Sequence[float]], modal_um: Sequence[float]
) -> tuple[TouchPoint, ...]:
    """The fingers at a frame's first knot, with the amplitude that the solved modes give each there."""
    return tuple(
        TouchPoint(
            *start,
            achieved_um=abs(sum(phi * w_um for phi, w_um in zip(row, modal_um, strict=True))),
            end_x_mm=end.x_mm,
            end_y_mm=end.y_mm,
        )
        for start, end, row in zip(first, last, rows, strict=True)
    )
