"""The touch path: from a trackpad frame to a reference polyline, in one pass and with no queue.

    touch():  track the contacts and give each finger's predictor its sample (`core.touch.fingers`)
    drive():  touch() each frame that came; find the fingers that take part in the solve; for each knot time predict
              their positions, look up their targets there, evaluate the mode matrix and solve for the modal
              amplitudes; then gate the polyline. The knots follow from the fingers' way (`core.frame`)

Pure: all instants are arguments, and the same calls give the same drives bit for bit. What a scene does not need is
skipped and counted: no finger, no target, or fingers so still that the last reference still holds.

A pass must end long before the next report (8 ms), whatever clients ask for. Beyond the budget its reference gets fewer
knots, and where two are too many, fewer fingers take part: those of the lowest priority are left out first, of these
the virtual ones, of these the newest. Figures are ns of machine code with warm caches; cold ones take up to twice as
long. On a slower machine `PassTimes` lowers the share of the budget by what passes took, an input like all others, so
that replay decides the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from ..values import Drive, Finger, FingerFrame, FingerKey, LinkTiming, SafeDrive, Tick, TouchFrame, TouchPoint
from .frame import (
    NO_FINGERS,
    ActiveReference,
    DrivenFingers,
    FramePlan,
    FrameSolver,
    KnotPlanner,
    PipelineCounters,
    PlayedReference,
    interpolated_um,
    touch_points,
)
from .friction import FrictionCurve
from .phasors import Phasors
from .plate.mode_shapes import ModeShapes
from .solver.felt_descent import COLD, EVEN_FRAC, UNCERTAIN_FRAC
from .solver.instant import InstantSolver
from .solver.reach import LEAST_CALLS, ReachSearch
from .targets.scene import Scene
from .touch.contact_ellipse import EllipseScale
from .touch.fingers import FingerPredictor, Fingers
from .trajectory.gate import UNTOUCHED, gate, silence
from .triggers import Triggers

_DURATION_STEP_NS: Final = 1_500_000  # of a slow pad's frames: they do not change with each estimate of its period
_USUAL_PERIOD_S: Final = 0.011  # of the Magic Trackpad, which EVEN_FRAC is for
_LONGEST_DURATION_NS: Final = 30_000_000  # a pad of 50 Hz: farther ahead nothing is known

TOLERANCE_UM: Final = 0.02  # of a reference that stays in force, and of steps at edges
BUDGET_NS: Final = 3_500_000.0
OVERRUN_NS: Final = 8_000_000
LONG_NS: Final = 5_000_000  # of a pass: then the share is halved
SHORT_PASSES: Final = 100  # in a row, of less than half of that: then it is doubled
LEAST_FRAC: Final = 1.0 / 64.0
LEAST_SOLVES: Final = 2  # the frame's beginning and its end

_PASS_NS: Final = 40_000.0  # decoding, tracking, gate, frame, status
_FINGER_NS: Final = 35_000.0  # of a finger that takes part: what it perceives, its telemetry
_TOUCHED_NS: Final = 3_000.0  # of a finger that is down: its report and its events
_PLACE_NS: Final = 2_000.0  # of a finger at one instant: its prediction and its own target
_LAYER_WAY_NS: Final = 1_500.0  # of a layer on a finger's way
_LAYER_PLACE_NS: Final = 300.0  # of a layer at one of its places
_SOLVE_NS: Final = 5_000.0  # of one solve, and for each finger and mode: one and a half times its time in a row
_SOLVE_EACH_NS: Final = 550.0  # the first one from silence takes COLD times as long
_EFFECT_NS: Final = 250.0  # of an effect that is felt, at one place, or may start, in a pass


@dataclass(frozen=True, slots=True)
class PipelineSettings:
    """Pipeline settings.

    `contact_radius_mm` above 0 makes fingers discs, and where `ellipse_scale` is not 0 what the pad reports of them
    (see `core.touch.contact_ellipse`). `uncertain_frac` is the relative standard deviation of a mode's amplitude.
    `frame_duration_ns` is one and a half report periods, to bridge a lost report; a slower pad gets frames of one and a
    half of its own, one of twice the rate half as long. While an effect plays, a frame may have `effect_knots`, and be
    shorter: 1.1 report periods. `loop_delay_ns` is the plate's delay behind its reference.
    """

    w_limit_um: tuple[float, ...]
    make_predictor: Callable[[], FingerPredictor]
    contact_radius_mm: float = 0.0
    ellipse_scale: float = 0.0
    ellipse_offset_mm: float = 0.0
    uncertain_frac: float = UNCERTAIN_FRAC
    tolerance_um: float = TOLERANCE_UM
    max_knots: int = 16
    effect_knots: int = 24
    sensor_latency_ns: int = 10_000_000
    loop_delay_ns: int = 0
    frame_duration_ns: int = 17_000_000
    silence_ns: int = 40_000_000
    make_solver: Callable[..., InstantSolver] = InstantSolver


class PassTimes:
    """The share of BUDGET_NS that passes may use on this machine, from the processor time that they took."""

    def __init__(self) -> None:
        self.budget_frac = 1.0
        self._short = 0

    def measured(self, ran_ns: float) -> bool:
        """Take a pass; return whether the share changes."""
        before, self._short = self.budget_frac, self._short + 1 if ran_ns < LONG_NS / 2 else 0
        if ran_ns > LONG_NS:
            self.budget_frac = max(0.5 * before, LEAST_FRAC)
        elif self._short >= SHORT_PASSES:
            self.budget_frac, self._short = min(2.0 * before, 1.0), 0
        return self.budget_frac != before


class Pipeline:
    """The touch path for one plate. Holds the fingers and the references that were in force last."""

    def __init__(
        self,
        modes: ModeShapes,
        scene: Scene,
        settings: PipelineSettings,
    ) -> None:
        self.counters = PipelineCounters()
        self.modes = modes
        self._scene = scene
        self._surfaces = scene.surfaces
        self._settings = settings
        self._effects = scene.effects
        self._frame_duration_ns = settings.frame_duration_ns
        self.set_knot_limits(settings.max_knots, settings.effect_knots)
        self._solver = settings.make_solver(
            modes,
            settings.w_limit_um,
            contact_radius_mm=settings.contact_radius_mm,
            friction_curve=scene.friction_curve,
            uncertain_frac=settings.uncertain_frac,
        )
        self.budget_frac = 1.0  # of the time that a pass may take: less on a slow machine
        self._fingers = Fingers(
            settings.make_predictor,
            sensor_latency_ns=settings.sensor_latency_ns,
            silence_ns=settings.silence_ns,
            ellipse_scale=_ellipse_scale(settings.ellipse_scale, settings.ellipse_offset_mm),
        )
        self._triggers = Triggers(scene, self._fingers, settings.frame_duration_ns * 2 // 3)
        self.events = self._triggers.events
        self._planner = KnotPlanner(scene, self._fingers, modes.steepest_1_mm(), settings.tolerance_um)
        self._frame = FrameSolver(scene, self._fingers, self._solver, self._planner, self.counters)
        self._active = ActiveReference(modes.M, self._planner, settings.tolerance_um)
        self._holdable_frac: tuple[float, ...] = ()

    def set_knot_limits(self, max_knots: int, effect_knots: int) -> None:
        """Set how many knots a frame may have, and while an effect plays: a faster line carries more."""
        self.max_knots = max_knots
        self._effect_knots = max(max_knots, effect_knots)
        self._effects.set_knot_limits(self._effect_knots, self._frame_duration_ns * 11 // 15)

    def _follow_period(self, period_s: float) -> None:
        """Make frames last one and a half of the pad's periods, in steps of 1.5 ms, where it is slow. On a fast pad the
        next report comes soon: vibrations need be less even, and frames half as long."""
        self._solver.even_frac = EVEN_FRAC * min((period_s or _USUAL_PERIOD_S) / _USUAL_PERIOD_S, 1.0)
        own_ns, usual_ns = _DURATION_STEP_NS * int(period_s * 1e3), self._settings.frame_duration_ns
        least_ns = usual_ns // 2 if 0 < own_ns < usual_ns // 2 else usual_ns
        frame_duration_ns = max(least_ns, min(own_ns, _LONGEST_DURATION_NS))
        if frame_duration_ns != self._frame_duration_ns:
            self._frame_duration_ns = frame_duration_ns
            self._triggers.set_period(frame_duration_ns * 2 // 3)
            self.set_knot_limits(self.max_knots, self._effect_knots)

    @property
    def fingers(self) -> tuple[Finger, ...]:
        """The fingers that are down, by the last accepted report."""
        return self._fingers.down

    @property
    def contact_radius_mm(self) -> float:
        """That of contacts whose ellipse is not known; 0 where fingers are points."""
        return self._solver.contact_radius_mm

    @property
    def newest_finger_id(self) -> int:
        """The largest finger id so far; 0 before the first finger."""
        return self._fingers.newest_id

    @property
    def modal_um(self) -> tuple[complex, ...]:
        """The modal phasors at the first knot of the reference in force."""
        return self._active.drive.knots[0].modal_um

    # --- from the trackpad ---

    def touch(self, frame: TouchFrame, t_read_ns: int) -> FingerFrame:
        """Take one report: track its contacts and feed the predictors, on the host's time axis."""
        self.counters.frames += 1
        before = self._fingers.down
        tracked = self._fingers.touch(frame, t_read_ns)
        self._follow_period(self._fingers.period_s)
        if tracked.lifted or len(tracked.fingers) > len(before):
            self._triggers.take(tracked, before)
        return tracked

    def sensor_lost(self) -> None:
        """Lift all fingers: the pad is gone or silent."""
        self._triggers.lift_all()
        self._fingers.lift_all()

    def sensor_is_silent(self, t_now_ns: int) -> bool:
        """Whether fingers are down and no report came for too long (then call `sensor_lost`)."""
        return self._fingers.are_silent(t_now_ns)

    def release(self, keys: Sequence[FingerKey]) -> None:
        """Hold these fingers at 0 um while they stay down: their targets ended."""
        self._fingers.release(keys)

    # --- to the plate ---

    def set_friction_curve(self, curve: FrictionCurve) -> None:
        """From now on another person touches the plate, and the next pass sends a reference for that one."""
        self._scene.set_friction_curve(curve)
        self._solver.curve = curve
        self.invalidate_reference()

    def drive(self, t_now_ns: int, timing: LinkTiming, frames: Sequence[tuple[TouchFrame, int]] = ()) -> Tick:
        """One pass: take the frames that came, each with when it was read; return the reference polyline that takes
        effect `timing.ahead_ns` from now, or none if the last one still holds."""
        for frame, t_read_ns in frames:
            self.touch(frame, t_read_ns)
        link_ns, may_drive, is_followed, holdable_frac = timing
        self.counters.passes += 1
        if self._surfaces.layers:
            self._surfaces.expire(t_now_ns)
            self._fingers.hold_all()
        t_apply_ns = t_now_ns + link_ns
        t_plate_ns = t_apply_ns + self._settings.loop_delay_ns
        effects = self._effects
        if self._triggers.is_due or self._surfaces.layers or effects.held or effects.playing:
            self._triggers.check(t_now_ns, t_plate_ns)
        keys = self._scene.requested(self._fingers.predictors, self._fingers.released, t_now_ns) if may_drive else []
        if not keys:
            return self.silence(t_now_ns, link_ns)
        if holdable_frac != self._holdable_frac:
            self._holdable_frac = holdable_frac
            self._solver.hold(holdable_frac if len(holdable_frac) == self.modes.M else (1.0,) * self.modes.M)
        if not is_followed:
            self.invalidate_reference()
        if effects.playing or effects.felt:
            t_end_ns = t_plate_ns + self._frame_duration_ns
            effects.find_felt(keys, self._scene.owner_of, self._fingers.predicted_mm, t_plate_ns, t_end_ns)
        priorities = self._scene.priorities(keys)
        kept, most_solves = allot(
            *(self._scene, self.modes.M, keys, priorities, len(self._fingers.down), BUDGET_NS * self.budget_frac),
            is_silent=self._active.is_silent,
        )
        if len(kept) < len(keys):
            self.counters.left_out_fingers += len(keys) - len(kept)
            keys, priorities = kept, self._scene.priorities(kept)
        fingers = DrivenFingers(keys, priorities, self._frame.ellipses(keys))
        plan = self._plan(fingers, t_plate_ns, most_solves)
        active = self._active
        may_stand = not effects.felt and active.has_settled(fingers, t_apply_ns)
        begin = self._frame.at(keys, t_plate_ns)
        end = self._frame.at(keys, t_plate_ns + plan.span_ns) if may_stand or plan.most_knots > 1 else begin
        if may_stand and active.still_holds(plan, begin.places, end.places, self.max_knots):
            self.counters.skipped_standing += 1
            return self._tick(t_now_ns, t_plate_ns, None, active.points_at(begin.places), active.limited)

        first, last, knots = self._frame.polyline(plan, begin, end, interpolated_um(active.drive, t_apply_ns))
        if len(knots) >= most_solves:
            self.counters.left_out_knots += max(self.max_knots - len(knots), 0)
        drive = gate(Drive(t_apply_ns, tuple(knots)), self._settings.w_limit_um)

        limited = first.limited or last.limited
        self.counters.knots += len(knots)
        self.counters.skipped_knots += max(self.max_knots - len(knots), 0)
        self.counters.limited += limited
        self.counters.gated += drive.reasons is not UNTOUCHED
        touched = touch_points(keys, first, last)
        active.activate(drive, fingers, last.places, touched, limited=limited)
        return self._tick(t_now_ns, t_plate_ns, drive, touched, limited)

    def silence(self, t_now_ns: int, link_ns: int) -> Tick:
        """Nothing is requested or allowed: send one zero frame, then none."""
        if self._fingers.down:
            self.counters.skipped_no_target += 1
        else:
            self.counters.skipped_no_finger += 1
        active, drive = self._active, None
        if not (active.is_silent and len(active.drive.knots) == 1 and active.is_sent):
            drive = silence(t_now_ns + link_ns, self.modes.M)
            active.activate(drive, NO_FINGERS, [], (), limited=False)
        return self._tick(t_now_ns, t_now_ns + link_ns, drive, (), False)

    def invalidate_reference(self) -> None:
        """The board does not have the last reference: the next pass sends one."""
        self._active.is_sent = False

    def past(self, keys: Sequence[FingerKey], t_ns: int) -> PlayedReference:
        """The plate's amplitudes, and the places and targets of these fingers, at an instant not before the newest
        sample: there a finger's place is known best, and the plate has followed its reference."""
        at, modal_um = self._frame.at(keys, t_ns), self._active.past_um(t_ns - self._settings.loop_delay_ns)
        return PlayedReference(modal_um, at.places, at.speed_gains, self._fingers.ellipses(keys))

    def motions(self, keys: Sequence[FingerKey], t_ns: int) -> list[tuple[float, float]]:
        """Return each finger's variance of place at an instant, in mm^2 on each axis, and the speed for its friction,
        in mm/s."""
        variances_mm2 = self._fingers.variances_mm2(keys, t_ns)
        return [(variances_mm2[n], self._frame.speed_mm_s(keys[n], t_ns)) for n in range(len(keys))]

    def asked_um(self, t_ns: int) -> Phasors:
        """Reading that the board's sensors should have shown at an instant not long ago."""
        return self._active.past_um(t_ns - self._settings.loop_delay_ns)

    def reach(self, key: FingerKey | None, place_mm: tuple[float, float], t_now_ns: int) -> tuple[float, float] | None:
        """The interval of friction (0 .. 1) that a finger, or without `key` one that touched this place, could feel now
        beside the others with their targets; None for none. Raises ValueError where it cannot be computed: without
        such a finger, for points, or with too many fingers for the time of a pass."""
        if not self._solver.has_contacts:
            raise ValueError(
                "what fingers can feel is known only where the plate is driven for friction over contacts."
            )
        requested = self._scene.requested(self._fingers.predictors, self._fingers.released, t_now_ns)
        others = [one for one in requested if one != key]
        keys = others if key is None else [*others, key]
        cost_ns = 1.5 * _solve_ns(len(others) + 1, self.modes.M)  # what each gives is judged too, in half the time
        calls = int(BUDGET_NS * self.budget_frac / cost_ns)
        if calls < LEAST_CALLS:
            raise ValueError(f"{len(keys)} fingers on the plate are too many to compute it in the time of a pass.")
        if isinstance(key, int) and key not in self._fingers.predictors:
            raise ValueError(f"finger {key} does not touch the plate.")
        at = self._frame.at(keys, t_now_ns)
        places, speed_gains, ellipses = at.places, at.speed_gains, self._frame.ellipses(keys)
        if key is None:
            places, speed_gains = [*places, (*place_mm, 0.0)], [*speed_gains, 1.0]
            ellipses = None if ellipses is None else [*ellipses, None]
        priorities = [*self._scene.priorities(keys), *([0] if key is None else [])]
        return ReachSearch(self._solver, places, speed_gains, priorities, ellipses).interval(calls)

    # --- the steps of a pass ---

    def _plan(self, fingers: DrivenFingers, t_plate_ns: int, solves: int) -> FramePlan:
        """Return the frame to be: while an effect is felt it may be shorter, and have more knots."""
        if not self._effects.felt:
            return FramePlan(fingers, t_plate_ns, self._frame_duration_ns, min(self.max_knots, solves), [])
        most = min(self._effect_knots, solves)
        span_ns, corners_ns = self._effects.frame(t_plate_ns, self._frame_duration_ns, most)
        return FramePlan(fingers, t_plate_ns, span_ns, most, corners_ns)

    def _tick(
        self, t_now_ns: int, t_plate_ns: int, drive: SafeDrive | None, points: tuple[TouchPoint, ...], limited: bool
    ) -> Tick:
        t_sample_ns = self._fingers.t_sample_ns if self._fingers.down else t_now_ns
        age_ns, horizon_ns = t_now_ns - t_sample_ns, t_plate_ns - t_sample_ns
        return Tick(t_now_ns, age_ns, horizon_ns, drive, points, limited)


def allot(
    scene: Scene,
    modes: int,
    keys: list[FingerKey],
    priorities: list[int],
    touched: int,
    budget_ns: float,
    *,
    is_silent: bool,
) -> tuple[list[FingerKey], int]:
    """Return those of these fingers that take part in a pass, in the order in which they came, and how often it may
    solve for them, while `touched` are down. `is_silent`: the plate has no amplitudes that a solve could begin from."""
    layers, effects = float(scene.surfaces.weight), scene.effects
    way_ns, cold = _LAYER_WAY_NS * layers, COLD - 1.0 if is_silent else 0.0
    fixed_ns = _PASS_NS + touched * (_TOUCHED_NS + way_ns + _EFFECT_NS * len(effects.held))
    places_ns, solve_ns, count = 0.0, 0.0, 0
    ordered = sorted(range(len(keys)), key=lambda n: -priorities[n]) if any(priorities) else list(range(len(keys)))
    for n in ordered:
        place_ns = _PLACE_NS + _EFFECT_NS * len(effects.felt)
        finger_ns = _FINGER_NS + 2.0 * place_ns
        if scene.target_of(keys[n]) is None:
            place_ns += _LAYER_PLACE_NS * layers
            finger_ns += way_ns
        cost_ns = _solve_ns(count + 1, modes)
        then_solve_ns = places_ns + place_ns + cost_ns
        if count > 0 and fixed_ns + finger_ns + cold * cost_ns + LEAST_SOLVES * then_solve_ns > budget_ns:
            break
        fixed_ns, places_ns, solve_ns, count = fixed_ns + finger_ns, places_ns + place_ns, then_solve_ns, count + 1
    solves = int((budget_ns - fixed_ns - cold * _solve_ns(count, modes)) / solve_ns)
    kept = keys if count == len(keys) else [keys[n] for n in sorted(ordered[:count])]  # the solver keeps weights by it
    return kept, max(solves, LEAST_SOLVES)


def _solve_ns(fingers: int, modes: int) -> float:
    return _SOLVE_NS + _SOLVE_EACH_NS * fingers * modes


def _ellipse_scale(scale: float, offset_mm: float) -> EllipseScale | None:
    return EllipseScale(scale, offset_mm) if scale > 0.0 else None
