"""The touch path: from a trackpad frame to a reference polyline, in one pass and with no queue.

    touch():  track the contacts and give each finger's predictor its sample (`core.touch.fingers`)
    drive():  touch() each frame that came; find the fingers that take part in the solve; for each knot time predict
              their positions, look up their targets there, evaluate the mode matrix and solve for the modal
              amplitudes; then gate the polyline. The number of knots follows from the tolerance
              (`core.trajectory.knots`)

Pure: all instants are arguments, and the same calls give the same drives bit for bit. What a scene does not need is
skipped and counted: no finger, no target, or fingers so still that the last reference still holds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from ..values import (
    Aim,
    Drive,
    Finger,
    FingerFrame,
    FingerKey,
    Knot,
    LimitReason,
    SafeDrive,
    Tick,
    TouchFrame,
    TouchPoint,
)
from .budget import MOST_SLOWNESS, PassBudget
from .phasors import Row
from .plate.contact import Form
from .plate.mode_shapes import ModeShapes
from .plate.parasitic_modes import ParasiticModes
from .solver.instant import InstantSolver, ModalSolution, Place, PointSolver, interpolated_um, moved, points, settles_ns
from .solver.points.general import solve_fast
from .solver.reach import LEAST_CALLS
from .targets.scene import Scene
from .touch.contact_form import EllipseScale
from .touch.fingers import FingerPredictor, Fingers
from .trajectory.gate import gate, silence
from .trajectory.knots import refine
from .trajectory.readings import Matrix, as_read, as_they_are
from .triggers import Triggers
from .ways import Ways, moved_mm

_STEP_NS: Final = 1_000_000  # over which a predicted speed is taken
_COVER_STEP_NS: Final = 1_500_000  # of a slow pad's frames, so that they do not change with each estimate of its period
_LONGEST_COVER_NS: Final = 30_000_000  # a pad of 50 Hz: farther ahead nothing is known
_KEPT_REFERENCES: Final = 6  # in force at the newest sample: it is up to three passes old


@dataclass(frozen=True, slots=True)
class PipelineSettings:
    """Pipeline settings.

    `derating_mm2_um2` is how far amplitude is derated where a limit keeps a slippery finger from its target anyway (see
    `core.solver.derating`; 0 also removes the bound on the reference's slope). `phase_rotation`: two slipping fingers
    change their signs by turning their phase (see `core.solver.instant`). `contact_radius_mm` above 0 makes
    fingers discs, and where `ellipse_scale` is not 0 what the pad reports of them (see `core.touch.contact_form`);
    `feels`: their friction is as asked, else their contrast is most. `cover_ns` is how long one frame
    must last: one and a half report periods, to bridge a lost report; a slower pad gets frames of one and a half of its
    own periods. While an effect plays, a frame may have `effect_knots`,
    and be shorter: 1.1 report periods.
    `loop_delay_ns` is by how much the plate follows its reference late.
    """

    w_limit_um: tuple[float, ...]
    make_predictor: Callable[[], FingerPredictor]
    derating_mm2_um2: float = 0.0
    phase_rotation: bool = True
    contact_radius_mm: float = 0.0
    ellipse_scale: float = 0.0
    ellipse_offset_mm: float = 0.0
    feels: bool = False
    tolerance_um: float = 0.02
    max_knots: int = 16
    effect_knots: int = 24
    sensor_latency_ns: int = 10_000_000
    loop_delay_ns: int = 0
    cover_ns: int = 17_000_000
    silence_ns: int = 40_000_000
    solve: PointSolver = solve_fast


@dataclass(slots=True)
class PipelineCounters:
    """How often each thing was done or spared; shown in `status`."""

    frames: int = 0
    passes: int = 0
    solves: int = 0
    limited: int = 0
    gated: int = 0
    knots: int = 0
    skipped_knots: int = 0
    left_out_knots: int = 0
    left_out_fingers: int = 0
    skipped_no_finger: int = 0
    skipped_no_target: int = 0
    skipped_standing: int = 0


class Instant:
    """The fingers at one instant: where each will be with which target, and, where friction depends on the speed, by
    how much more amplitude it needs as it slides."""

    __slots__ = ("places", "stretches")

    def __init__(self, places: list[Place], stretches: list[float] | None) -> None:
        self.places: Final = places
        self.stretches: Final = stretches


class Participants:
    """The fingers that take part in a pass, the priority of each, and the forms of their contacts: None where all are
    discs, or points."""

    __slots__ = ("forms", "keys", "priorities")

    def __init__(self, keys: list[FingerKey], priorities: list[int], forms: list[Form | None] | None) -> None:
        self.keys: Final = keys
        self.priorities: Final = priorities
        self.forms: Final = forms

    def are(self, others: Participants) -> bool:
        """Return whether these are the same, as they were."""
        return self.keys == others.keys and self.priorities == others.priorities and self.forms == others.forms


NO_FINGERS: Final = Participants([], [], None)


class FramePlan:
    """A frame before it is solved: for whom, from when on the plate, how long, with how many knots by how many solves,
    and the corners of effects in it."""

    __slots__ = ("corners_ns", "fingers", "most_knots", "most_solves", "span_ns", "t_ns")

    def __init__(
        self,
        fingers: Participants,
        t_ns: int,
        span_ns: int,
        most_knots: int,
        most_solves: int,
        corners_ns: list[int],
    ) -> None:
        self.fingers: Final = fingers
        self.t_ns: Final = t_ns
        self.span_ns: Final = span_ns
        self.most_knots: Final = most_knots
        self.most_solves: Final = most_solves
        self.corners_ns: Final = corners_ns


class Past:
    """The plate at an instant that has passed: its amplitudes (M,), and for each finger its place with its target, by
    how much more amplitude it needs as it slides, and the form of its contact, where that is known."""

    __slots__ = ("forms", "modal_um", "places", "stretches")

    def __init__(
        self, modal_um: Row, places: list[Place], stretches: list[float], forms: list[Form | None] | None = None
    ) -> None:
        self.modal_um: Final = modal_um
        self.places: Final = places
        self.stretches: Final = stretches
        self.forms: Final = forms


class Pipeline:
    """The touch path for one plate. Holds the fingers and the references that were in force last."""

    def __init__(
        self,
        modes: ModeShapes,
        scene: Scene,
        settings: PipelineSettings,
        *,
        parasitic_modes: ParasiticModes | None = None,
    ) -> None:
        self.counters = PipelineCounters()
        self._scene = scene
        self._surfaces = scene.surfaces
        self._settings = settings
        self._effects = scene.effects
        self._cover_ns = settings.cover_ns
        self.fit(settings.max_knots, settings.effect_knots)
        self._solver = InstantSolver(
            modes,
            settings.w_limit_um,
            derating_mm2_um2=settings.derating_mm2_um2,
            phase_rotation=settings.phase_rotation,
            parasitic_modes=parasitic_modes,
            contact_radius_mm=settings.contact_radius_mm,
            friction_curve=scene.friction_curve,
            feels=settings.feels,
            solve=settings.solve,
        )
        self._budget = PassBudget(scene, self._solver)
        self.estimated_ns = 0.0  # for what the last pass did
        ellipses = EllipseScale(settings.ellipse_scale, settings.ellipse_offset_mm)
        self._fingers = Fingers(
            settings.make_predictor,
            sensor_latency_ns=settings.sensor_latency_ns,
            silence_ns=settings.silence_ns,
            ellipse_scale=ellipses if settings.ellipse_scale > 0.0 else None,
        )
        self._triggers = Triggers(scene, self._fingers, settings.cover_ns * 2 // 3)
        self.events = self._triggers.events
        self._readings: Matrix | None = None
        self.set_modes(modes)
        self._active = silence(0, modes.M)
        self._recent = [self._active]
        self._active_fingers = NO_FINGERS
        self._active_places: list[Place] = []
        self._is_sent = True
        self._t_settled_ns = 0
        self._active_points: tuple[tuple[TouchPoint, ...], bool] = ((), False)

    def fit(self, max_knots: int, effect_knots: int) -> None:
        """Set how many knots a frame may have, and while an effect plays: a faster line carries more."""
        self.max_knots = max_knots
        self._effect_knots = max(max_knots, effect_knots)
        self._effects.fit(self._effect_knots, self._cover_ns * 11 // 15)

    def _follow_period(self, period_s: float) -> None:
        """Make frames last one and a half of the pad's periods, in steps of 1.5 ms, where it is slow."""
        slow_ns = _COVER_STEP_NS * int(period_s * 1e3)
        cover_ns = max(self._settings.cover_ns, min(slow_ns, _LONGEST_COVER_NS))
        if cover_ns != self._cover_ns:
            self._cover_ns = cover_ns
            self._triggers.set_period(cover_ns * 2 // 3)
            self.fit(self.max_knots, self._effect_knots)

    @property
    def fingers(self) -> tuple[Finger, ...]:
        """The fingers that are down, by the last accepted report."""
        return self._fingers.down

    @property
    def modes(self) -> ModeShapes:
        """The shapes that the plate is taken to have."""
        return self._modes

    @property
    def newest_finger_id(self) -> int:
        """The largest finger id so far; 0 before the first finger."""
        return self._fingers.newest_id

    @property
    def modal_um(self) -> tuple[complex, ...]:
        """The modal phasors at the first knot of the reference in force."""
        return self._active.knots[0].modal_um

    # --- from the trackpad ---

    def touch(self, frame: TouchFrame, t_read_ns: int) -> FingerFrame:
        """Take one report: track its contacts and feed the predictors, on the host's time axis."""
        self.counters.frames += 1
        tracked = self._fingers.touch(frame, t_read_ns)
        self._follow_period(self._fingers.period_s)
        self._triggers.take(tracked)
        return tracked

    def set_sensor_latency(self, latency_ns: int) -> None:
        """Take the pad's own latency to be this from the next report on."""
        self._fingers.set_latency(latency_ns)

    def set_modes(self, modes: ModeShapes) -> None:
        """Take the plate to have these shapes from the next pass on."""
        self._modes = modes
        self._solver.set_modes(modes)
        self._steepness_1_mm = modes.steepest_1_mm()
        self._ways = Ways(self._scene, self._fingers, self._steepness_1_mm, self._settings.tolerance_um)

    @property
    def slowness(self) -> float:
        """How much longer passes are taken to last than estimated."""
        return self._budget.slowness

    def set_slowness(self, slowness: float) -> None:
        """Take passes to last so many times longer than estimated for machine code: from 1 to MOST_SLOWNESS."""
        self._budget.slowness = min(max(slowness, 1.0), MOST_SLOWNESS)

    def set_parasitic_modes(self, parasitic_modes: ParasiticModes) -> None:
        """Compensate these undriven modes from the next pass on."""
        self._solver.set_parasitic_modes(parasitic_modes)

    def set_readings(self, readings: Sequence[Row]) -> None:
        """Take the board's sensors to read `readings` (M, M) times the true amplitudes, from the next pass on."""
        matrix = tuple([tuple(row) for row in readings])
        self._readings = None if matrix == as_they_are(self._modes.M) else matrix
        if self._active_fingers.keys:
            self.resend()

    def sensor_lost(self) -> None:
        """Lift all fingers: the pad is gone or silent."""
        self._fingers.lift_all()
        self._triggers.lift_all()

    def sensor_is_silent(self, t_now_ns: int) -> bool:
        """Whether fingers are down and no report came for too long (then call `sensor_lost`)."""
        return self._fingers.are_silent(t_now_ns)

    def release(self, keys: Sequence[FingerKey]) -> None:
        """Hold these fingers at 0 um while they stay down: their targets ended."""
        self._fingers.release(keys)

    # --- to the plate ---

    def drive(self, t_now_ns: int, aim: Aim, frames: Sequence[tuple[TouchFrame, int]] = ()) -> Tick:
        """One pass: take the frames that came, each with when it was read; return the reference polyline that takes
        effect `aim.ahead_ns` from now, or none if the last one still holds."""
        for frame, t_read_ns in frames:
            self.touch(frame, t_read_ns)
        link_ns, may_drive, is_followed = aim
        self.counters.passes += 1
        self.estimated_ns = 0.0
        if self._surfaces.layers:
            self._surfaces.expire(t_now_ns)
            self._fingers.hold_all()
        t_apply_ns = t_now_ns + link_ns
        t_plate_ns = t_apply_ns + self._settings.loop_delay_ns
        self._triggers.check(t_now_ns, t_plate_ns)
        keys = self._scene.requested(self._fingers.predictors, self._fingers.released, t_now_ns) if may_drive else []
        if not keys:
            return self.rest(t_now_ns, link_ns)
        if not is_followed:
            self._is_sent = False
        if self._effects.playing or self._effects.felt:
            t_end_ns = t_plate_ns + self._cover_ns
            self._effects.find_felt(keys, self._scene.owner_of, self._fingers.predicted_mm, t_plate_ns, t_end_ns)
        is_silent = not any(self._active.knots[-1].modal_um)
        priorities = self._scene.priorities(keys)
        allotted = self._budget.allot(keys, priorities, len(self._fingers.down), is_silent=is_silent)
        self.estimated_ns = allotted.fixed_ns
        if len(allotted.keys) < len(keys):
            self.counters.left_out_fingers += len(keys) - len(allotted.keys)
            keys, priorities = allotted.keys, self._scene.priorities(allotted.keys)
        fingers = Participants(keys, priorities, self._forms(keys))
        plan = self._plan(fingers, t_plate_ns, allotted.solves)
        may_stand = self._has_settled(fingers, t_apply_ns)
        begin = self._at(keys, t_plate_ns)
        end = self._at(keys, t_plate_ns + plan.span_ns) if may_stand or plan.most_knots > 1 else begin
        if may_stand and self._stands(plan, begin.places, end.places):
            self.counters.skipped_standing += 1
            standing, limited = self._active_points
            return self._tick(t_now_ns, t_plate_ns, None, tuple(map(moved, standing, begin.places)), limited)

        solved = self.counters.solves
        first, last, knots = self._polyline(plan, begin, end, interpolated_um(self._active, t_apply_ns))
        solves = self.counters.solves - solved
        self.estimated_ns += solves * allotted.solve_ns
        if solves >= allotted.solves:
            self.counters.left_out_knots += max(self.max_knots - len(knots), 0)
        drive = gate(Drive(t_apply_ns, tuple(knots)), self._settings.w_limit_um)

        limited = first.limited or last.limited
        self.counters.knots += len(knots)
        self.counters.skipped_knots += max(self.max_knots - len(knots), 0)
        self.counters.limited += limited
        self.counters.gated += drive.reasons is not LimitReason.NONE
        self._activate(drive, fingers, last.places)
        self._t_settled_ns = settles_ns(drive, self._settings.tolerance_um)
        self._active_points = points(keys, first, last), limited
        return self._tick(t_now_ns, t_plate_ns, self._as_read(drive), *self._active_points)

    def rest(self, t_now_ns: int, link_ns: int) -> Tick:
        """Nothing is requested or allowed: send one zero frame, then none."""
        if self._fingers.down:
            self.counters.skipped_no_target += 1
        else:
            self.counters.skipped_no_finger += 1
        is_silent = len(self._active.knots) == 1 and not any(self._active.knots[0].modal_um)
        drive = None if is_silent and self._is_sent else silence(t_now_ns + link_ns, self._modes.M)
        if drive is not None:
            self._activate(drive, NO_FINGERS, [])
        return self._tick(t_now_ns, t_now_ns + link_ns, drive, (), False)

    def resend(self) -> None:
        """The board does not have the last reference: the next pass sends one."""
        self._is_sent = False

    def past(self, keys: Sequence[FingerKey], t_ns: int) -> Past:
        """What the plate did, and where these fingers were with which targets, at an instant not before the newest
        sample: there a finger's place is known best, and the plate has followed its reference."""
        t_reference_ns = t_ns - self._settings.loop_delay_ns
        active = self._recent[0]
        for drive in self._recent:
            if drive.t_apply_ns <= t_reference_ns:
                active = drive
        at, modal_um = self._at(keys, t_ns), interpolated_um(active, t_reference_ns)
        return Past(modal_um, at.places, at.stretches or [1.0] * len(keys), self._fingers.forms(keys))

    def reach(self, key: FingerKey | None, place_mm: tuple[float, float], t_now_ns: int) -> tuple[float, float] | None:
        """The interval of friction (0 .. 1) that a finger, or without `key` one that touched this place, could feel now
        beside the others with their targets; None for none. Raises ValueError where it cannot be computed: without
        such a finger, for points, or with too many fingers for the time of a pass."""
        if not self._solver.feels:
            raise ValueError(
                "what fingers can feel is known only where the plate is driven for friction over contacts."
            )
        requested = self._scene.requested(self._fingers.predictors, self._fingers.released, t_now_ns)
        others = [one for one in requested if one != key]
        keys = others if key is None else [*others, key]
        calls = self._budget.solves_of_request(len(others) + 1)
        if calls < LEAST_CALLS:
            raise ValueError(f"{len(keys)} fingers on the plate are too many to compute it in the time of a pass.")
        if isinstance(key, int) and key not in self._fingers.predictors:
            raise ValueError(f"finger {key} does not touch the plate.")
        at, variances_mm2 = self._at(keys, t_now_ns), self._fingers.variances_mm2(keys, t_now_ns)
        places, stretches, forms = at.places, at.stretches or [1.0] * len(keys), self._forms(keys)
        if key is None:
            places, variances_mm2, stretches = [*places, (*place_mm, 0.0)], [*variances_mm2, 0.0], [*stretches, 1.0]
            forms = None if forms is None else [*forms, None]
        priorities = [*self._scene.priorities(keys), *([0] if key is None else [])]
        return self._solver.reach(places, variances_mm2, stretches, priorities, calls, forms)

    def _activate(self, drive: SafeDrive, fingers: Participants, places: list[Place]) -> None:
        self._active, self._active_fingers, self._active_places, self._is_sent = drive, fingers, places, True
        self._recent = [*self._recent[1 - _KEPT_REFERENCES :], drive]

    # --- the steps of a pass ---

    def _plan(self, fingers: Participants, t_plate_ns: int, solves: int) -> FramePlan:
        """Return the frame to be: while an effect is felt it may be shorter, and have more knots."""
        if not self._effects.felt:
            return FramePlan(fingers, t_plate_ns, self._cover_ns, min(self.max_knots, solves), solves, [])
        most = min(self._effect_knots, solves)
        span_ns, corners_ns = self._effects.frame(t_plate_ns, self._cover_ns, most)
        return FramePlan(fingers, t_plate_ns, span_ns, most, solves, corners_ns)

    def _polyline(
        self, plan: FramePlan, begin: Instant, end: Instant, previous_um: Row
    ) -> tuple[ModalSolution, ModalSolution, list[Knot]]:
        """Return the solutions at the frame's beginning and end, and the knots from one to the other."""
        fingers, span_ns, tolerance_um = plan.fingers, plan.span_ns, self._settings.tolerance_um
        first = self._solve(fingers, plan.t_ns, begin, previous_um, 0)
        if plan.most_knots == 1:
            return first, first, [Knot(0, first.modal_um)]
        last = self._solve(fingers, plan.t_ns + span_ns, end, first.modal_um, span_ns)
        knots = [tuple.__new__(Knot, (0, first.modal_um)), tuple.__new__(Knot, (span_ns, last.modal_um))]
        ways_mm = moved_mm(first.places, last.places)
        room = plan.most_knots - len(plan.corners_ns)
        pieces, smooth, edges_ns = self._ways.pieces(fingers.keys, ways_mm, plan.t_ns, span_ns, room)
        is_plain = pieces == 1 and smooth and not edges_ns
        is_plain = is_plain and self._ways.bend_um(knots, ways_mm) <= tolerance_um

        def solve(dt_ns: int, before: Knot) -> Row:
            t_ns = plan.t_ns + dt_ns
            at = self._at(fingers.keys, t_ns)
            return self._solve(fingers, t_ns, at, before.modal_um, dt_ns - before.dt_ns).modal_um

        times_ns: Sequence[int] = [span_ns * piece // pieces // 1000 * 1000 for piece in range(1, pieces)]
        if edges_ns or plan.corners_ns:
            times_ns = sorted({*times_ns, *edges_ns, *plan.corners_ns})
        for dt_ns in times_ns:
            knots.insert(-1, Knot(dt_ns, solve(dt_ns, knots[-2])))
        if not is_plain:
            solves = plan.most_solves - len(knots)
            knots = refine(solve, knots, tolerance_um, plan.most_knots, solves, smooth=smooth)
        return first, last, knots

    def _as_read(self, drive: SafeDrive) -> SafeDrive:
        """Return the drive in what the board's sensors read, within its limits there too."""
        if self._readings is None:
            return drive
        return gate(as_read(drive, self._readings), self._settings.w_limit_um)

    def _solve(self, fingers: Participants, t_ns: int, at: Instant, previous_um: Row, since_ns: int) -> ModalSolution:
        """Evaluate the modes and solve, for one instant `since_ns` after another."""
        self.counters.solves += 1
        if not self._solver.has_contacts:
            return self._solver.solve(at.places, previous_um, since_ns)
        variances_mm2, ranks = self._fingers.variances_mm2(fingers.keys, t_ns), fingers.priorities
        return self._solver.solve(at.places, previous_um, since_ns, variances_mm2, at.stretches, ranks, fingers.forms)

    def _forms(self, keys: Sequence[FingerKey]) -> list[Form | None] | None:
        """Return the forms of contacts that the plate is driven for; None where all are discs, or points."""
        return self._fingers.forms(keys) if self._solver.has_contacts else None

    def _at(self, keys: Sequence[FingerKey], t_ns: int) -> Instant:
        """Predict the fingers, and look up what each should feel where it will be."""
        scene = self._scene
        stretches: list[float] | None = [] if scene.depends_on_speed else None
        places: list[Place] = []
        for key in keys:
            x_mm, y_mm = self._predicted_mm(key, t_ns)
            if stretches is not None:
                was_x_mm, was_y_mm = self._predicted_mm(key, t_ns - _STEP_NS)
                speed_mm_s = math.hypot(x_mm - was_x_mm, y_mm - was_y_mm) / (_STEP_NS * 1e-9)
                stretches.append(scene.slide(speed_mm_s))
            target_um = scene.amplitude_um(key, x_mm, y_mm)
            if target_um is None:
                target_um = self._surfaces.amplitude_um(x_mm, y_mm, t_ns)
            if self._effects.felt:
                target_um = self._effects.felt_um(key, scene.owner_of(key), (x_mm, y_mm), t_ns, target_um)
            places.append((x_mm, y_mm, target_um))
        return Instant(places, stretches)

    def _predicted_mm(self, key: FingerKey, t_ns: int) -> tuple[float, float]:
        """Return where a finger will be."""
        if isinstance(key, str):
            return self._scene.virtual_position_mm(key, t_ns)
        return self._fingers.predicted_mm(key, t_ns)

    def _has_settled(self, fingers: Participants, t_apply_ns: int) -> bool:
        """Return whether the last reference was for these fingers, and no longer changes: it may hold on."""
        if not self._is_sent or t_apply_ns < self._t_settled_ns or self._effects.felt:
            return False
        return fingers.are(self._active_fingers)

    def _stands(self, plan: FramePlan, begin: list[Place], end: list[Place]) -> bool:
        """Return whether the last reference, which has settled, still holds: from the frame's beginning to its end the
        fingers stay where it was made for."""
        steepness_um_mm = self._steepness_1_mm * sum(abs(w_um) for w_um in self._active.knots[-1].modal_um)
        for places in (begin, end):
            for (x_mm, y_mm, target_um), (was_x_mm, was_y_mm, was_um) in zip(places, self._active_places, strict=True):
                moved_um = steepness_um_mm * math.hypot(x_mm - was_x_mm, y_mm - was_y_mm)
                if target_um != was_um or not moved_um <= self._settings.tolerance_um:
                    return False
        if steepness_um_mm > 0.0 and not self._surfaces.layers:
            return True  # while the plate is silent, fingers may move far: over stripes, to the same target
        ways_mm = moved_mm(begin, end)
        pieces, _, edges_ns = self._ways.pieces(plan.fingers.keys, ways_mm, plan.t_ns, plan.span_ns, self.max_knots)
        return pieces == 1 and not edges_ns

    def _tick(
        self, t_now_ns: int, t_plate_ns: int, drive: SafeDrive | None, points: tuple[TouchPoint, ...], limited: bool
    ) -> Tick:
        t_sample_ns = self._fingers.t_sample_ns if self._fingers.down else t_now_ns
        return Tick(t_now_ns, t_now_ns - t_sample_ns, t_plate_ns - t_sample_ns, drive, points, limited)
