"""One frame of the reference: the fingers that take part, where they will be at each of its knots, into how many spans
textures and edges divide their ways, the amplitudes at each knot; and the reference in force, which may still hold.

Between knots the board interpolates linearly. A chord of span h errs by h^2 W''/8 at most, in the middle of a smooth
piece: so the middle is looked at, and becomes a knot if the chord misses it. A half then errs by a quarter, and is
taken as it is where that is within the tolerance; next to an inflection, or the corner where a mode meets its limit, it
may err by a little more. Where the target itself has corners (a square grating's edges, a map's pixels) every half is
checked in turn, down to the board's control tick.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final, NamedTuple

from ..values import FingerKey, Knot, SafeDrive, TouchPoint
from .phasors import Phasors
from .plate.contact import ContactEllipse
from .solver.instant import AskedPlace, InstantSolver, ModalSolution
from .targets.scene import Scene
from .targets.surfaces import Crossing
from .touch.fingers import Fingers
from .trajectory.gate import GRAIN_NS, SHORTEST_NS, silence

Solve = Callable[[int, Knot], Phasors]  # an instant after the first knot, and the knot before it: the amplitudes there

_Miss = tuple[float, Knot, Knot, Knot]  # by how much a chord misses its middle, in um; left knot, middle, right one
_STEP_NS: Final = 1_000_000  # over which a predicted speed is taken
_NO_EDGES: Final[Sequence[int]] = ()
_KEPT: Final = 6  # of references: the one in force at the newest sample is up to three passes old


@dataclass(slots=True)
class PipelineCounters:
    """Counts of what was done or skipped; shown in `status`."""

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


class DrivenFingers(NamedTuple):
    """The fingers that take part in a pass, the priority of each, and the ellipses of their contacts: None where all
    are discs, or points."""

    keys: list[FingerKey]
    priorities: list[int]
    ellipses: list[ContactEllipse | None] | None


NO_FINGERS: Final = DrivenFingers([], [], None)


class FingerTargets:
    """The fingers at one instant: where each will be with which target, and the gain of the amplitude that it needs as
    it slides."""

    def __init__(self, places: list[AskedPlace], speed_gains: list[float]) -> None:
        self.places: Final = places
        self.speed_gains: Final = speed_gains


class FramePlan(NamedTuple):
    """A frame before it is solved: for whom, from when on the plate, how long, with how many knots by how many solves,
    and the corners of effects in it."""

    fingers: DrivenFingers
    t_ns: int
    span_ns: int
    most_knots: int
    most_solves: int
    corners_ns: list[int]


class KnotPlanner:
    """Planner of a frame's knots: what they depend on, apart from the solutions themselves."""

    def __init__(self, scene: Scene, fingers: Fingers, steepness_1_mm: float, tolerance_um: float) -> None:
        self._scene: Final = scene
        self.surfaces: Final = scene.surfaces
        self._fingers: Final = fingers
        self.steepness_1_mm: Final = steepness_1_mm  # of the plate's shapes
        self._tolerance_um: Final = tolerance_um

    def pieces(
        self, keys: Sequence[FingerKey], moved_mm: Sequence[float], t_plate_ns: int, span_ns: int, most: int
    ) -> tuple[int, bool, Sequence[int]]:
        """Return into how many spans the textures divide the fingers' way at first, whether they are smooth, and the
        instants before and after each edge of a surface; `most` knots in all."""
        pieces, smooth, edges_ns = 1.0, True, _NO_EDGES
        for finger, way_mm in enumerate(moved_mm):
            finest_mm, is_smooth = self._scene.detail(keys[finger])
            if way_mm > pieces * finest_mm:
                pieces = way_mm / finest_mm
            smooth = smooth and is_smooth
        if self.surfaces.layers:
            surface_pieces, are_smooth, edges_ns = self._edges(keys, t_plate_ns, span_ns, most)
            pieces, smooth = max(pieces, surface_pieces), smooth and are_smooth
        room = max(most - 1 - len(edges_ns), 1)
        return math.ceil(min(pieces, room, span_ns / SHORTEST_NS)), smooth, edges_ns

    def _edges(
        self, keys: Sequence[FingerKey], t_plate_ns: int, span_ns: int, most: int
    ) -> tuple[float, bool, Sequence[int]]:
        """Return what the surfaces add to `pieces`; where there are too many edges, the earliest."""
        pieces, smooth, crossed = 1.0, True, list[Crossing]()
        for key in keys:
            if isinstance(key, int) and self._scene.target_of(key) is None:
                predicted_mm = partial(self._fingers.predicted_mm, key)
                way = self.surfaces.along(predicted_mm, t_plate_ns, span_ns)
                pieces, smooth = max(pieces, way.pieces), smooth and way.is_smooth
                crossed += way.crossings
        edges_ns = [edge_ns for edge_ns in self.surfaces.edges_ns(crossed, t_plate_ns, self._tolerance_um) if edge_ns]
        return pieces, smooth, edges_ns[: max(most - 2, 0) // 2 * 2]

    def bend_um(self, ends: Sequence[Knot], moved_mm: Sequence[float]) -> float:
        """Return the largest error of a chord over so short a way: W (steepness * way)^2 / 8."""
        largest_um = max([abs(w_um) for _, modal_um in ends for w_um in modal_um])
        change = self.steepness_1_mm * sum(moved_mm)
        return largest_um * (change * change) / 8.0


def moved_mm(before: Sequence[AskedPlace], after: Sequence[AskedPlace]) -> list[float]:
    """Return how far each finger moves."""
    distances_mm = []
    for finger in range(len(before)):
        (x_mm, y_mm, _), (then_x_mm, then_y_mm, _) = before[finger], after[finger]
        distances_mm.append(math.hypot(then_x_mm - x_mm, then_y_mm - y_mm))
    return distances_mm


def touch_points(keys: Sequence[FingerKey], first: ModalSolution, last: ModalSolution) -> tuple[TouchPoint, ...]:
    """Return the fingers at a frame's first knot, with the amplitude that each gets there."""
    found: list[TouchPoint] = []
    for n in range(len(first.places)):
        (x_mm, y_mm, target_um), (end_x_mm, end_y_mm, _) = first.places[n], last.places[n]
        found.append(TouchPoint(keys[n], x_mm, y_mm, target_um, first.achieved_um[n], end_x_mm, end_y_mm))
    return tuple(found)


class FrameSolver:
    """The fingers of a scene at any instant, and the polyline of a frame through some of them."""

    def __init__(
        self,
        scene: Scene,
        fingers: Fingers,
        solver: InstantSolver,
        planner: KnotPlanner,
        tolerance_um: float,
        counters: PipelineCounters,
    ) -> None:
        self._scene: Final = scene
        self._surfaces: Final = scene.surfaces
        self._effects: Final = scene.effects
        self._fingers: Final = fingers
        self._solver: Final = solver
        self._planner: Final = planner
        self._tolerance_um: Final = tolerance_um
        self._counters: Final = counters

    def at(self, keys: Sequence[FingerKey], t_ns: int) -> FingerTargets:
        """Predict the fingers, and look up what each should feel where it will be."""
        scene = self._scene
        speed_gains = [1.0] * len(keys)
        places: list[AskedPlace] = []
        for key in keys:
            x_mm, y_mm = self._predicted_mm(key, t_ns)
            if scene.depends_on_speed:
                speed_gains[len(places)] = scene.speed_gain(self._speed_mm_s(key, t_ns, x_mm, y_mm))
            target_um = scene.amplitude_um(key, x_mm, y_mm)
            if target_um is None:
                target_um = self._surfaces.amplitude_um(x_mm, y_mm, t_ns)
            if self._effects.felt:
                target_um = self._effects.felt_um(key, scene.owner_of(key), (x_mm, y_mm), t_ns, target_um)
            places.append((x_mm, y_mm, target_um))
        return FingerTargets(places, speed_gains)

    def speed_mm_s(self, key: FingerKey, t_ns: int) -> float:
        """Return how fast a finger will slide."""
        return self._speed_mm_s(key, t_ns, *self._predicted_mm(key, t_ns))

    def _speed_mm_s(self, key: FingerKey, t_ns: int, x_mm: float, y_mm: float) -> float:
        next_x_mm, next_y_mm = self._predicted_mm(key, t_ns + _STEP_NS)  # the newest sample's past is not predicted
        return math.hypot(next_x_mm - x_mm, next_y_mm - y_mm) / (_STEP_NS * 1e-9)

    def _predicted_mm(self, key: FingerKey, t_ns: int) -> tuple[float, float]:
        """Return where a finger will be."""
        if isinstance(key, str):
            return self._scene.virtual_position_mm(key, t_ns)
        return self._fingers.predicted_mm(key, t_ns)

    def ellipses(self, keys: Sequence[FingerKey]) -> list[ContactEllipse | None] | None:
        """Return the ellipses of contacts that the plate is driven for; None where all are discs, or points."""
        return self._fingers.ellipses(keys) if self._solver.has_contacts else None

    def polyline(
        self, plan: FramePlan, begin: FingerTargets, end: FingerTargets, previous_um: Phasors
    ) -> tuple[ModalSolution, ModalSolution, list[Knot]]:
        """Return the solutions at the frame's beginning and end, and the knots from one to the other."""
        fingers, span_ns, tolerance_um = plan.fingers, plan.span_ns, self._tolerance_um
        first = self._solve(fingers, begin, previous_um, 0)
        if plan.most_knots == 1:
            return first, first, [Knot(0, first.modal_um)]
        last = self._solve(fingers, end, first.modal_um, span_ns)
        knots = [Knot(0, first.modal_um), Knot(span_ns, last.modal_um)]
        ways_mm = moved_mm(first.places, last.places)
        room = plan.most_knots - len(plan.corners_ns)
        pieces, smooth, edges_ns = self._planner.pieces(fingers.keys, ways_mm, plan.t_ns, span_ns, room)
        is_plain = pieces == 1 and smooth and not edges_ns
        is_plain = is_plain and self._planner.bend_um(knots, ways_mm) <= tolerance_um

        def solve(dt_ns: int, before: Knot) -> Phasors:
            at = self.at(fingers.keys, plan.t_ns + dt_ns)
            return self._solve(fingers, at, before.modal_um, dt_ns - before.dt_ns).modal_um

        times_ns: Sequence[int] = [span_ns * piece // pieces // 1000 * 1000 for piece in range(1, pieces)]
        if edges_ns or plan.corners_ns:
            times_ns = sorted({*times_ns, *edges_ns, *plan.corners_ns})
        for dt_ns in times_ns:
            knots.insert(-1, Knot(dt_ns, solve(dt_ns, knots[-2])))
        if not is_plain:
            solves = plan.most_solves - len(knots)
            knots = refine(solve, knots, tolerance_um, plan.most_knots, solves, smooth=smooth)
        return first, last, knots

    def _solve(self, fingers: DrivenFingers, at: FingerTargets, previous_um: Phasors, since_ns: int) -> ModalSolution:
        """Evaluate the modes and solve, for one instant `since_ns` after another."""
        self._counters.solves += 1
        if not self._solver.has_contacts:
            return self._solver.solve(at.places, previous_um, since_ns)
        ranks, ellipses = fingers.priorities, fingers.ellipses
        return self._solver.solve(at.places, previous_um, since_ns, at.speed_gains, ranks, ellipses)


# --- knots ---


def refine(
    solve: Solve, start: Sequence[Knot], tolerance_um: float, most: int, solves: int, *, smooth: bool
) -> list[Knot]:
    """`start` (two knots or more, in order) and what must lie between, `most` knots in all, and at most so many solves;
    the worst chords first.

    `solve(dt_ns, knot)` gives the amplitudes at an instant, continuing those of the knot to its left. `smooth`
    promises that no span of `start` hides a corner or a whole wave.
    """
    knots = list(start)
    spans = [(knots[i], knots[i + 1]) for i in range(len(knots) - 1)]
    settled_um = 4.0 * tolerance_um if smooth else 0.0
    while spans and len(knots) < most and solves > 0:
        spans = spans[:solves]
        solves -= len(spans)
        misses = [miss for left, right in spans if (miss := _missed(solve, left, right, tolerance_um)) is not None]
        room = most - len(knots)
        if len(misses) > room:
            misses = sorted(misses, key=_severity)[:room]
        spans = []
        for error_um, left, middle, right in misses:
            knots.append(middle)
            if error_um > settled_um:
                spans += ((left, middle), (middle, right))
    if len(knots) > len(start):
        knots.sort()
    return knots


def _missed(solve: Solve, left: Knot, right: Knot, tolerance_um: float) -> _Miss | None:
    left_ns, before_um = left
    right_ns, after_um = right
    span_ns = right_ns - left_ns
    if span_ns < 2 * SHORTEST_NS:
        return None
    half_ns = span_ns // (2 * GRAIN_NS) * GRAIN_NS
    middle_um = solve(left_ns + half_ns, left)
    share = half_ns / span_ns
    error_um = 0.0
    for mode in range(len(before_um)):
        chord_um = before_um[mode] + share * (after_um[mode] - before_um[mode])
        error_um = max(error_um, abs(middle_um[mode] - chord_um))
    return (error_um, left, Knot(left_ns + half_ns, middle_um), right) if error_um > tolerance_um else None


def _severity(miss: _Miss) -> tuple[float, int]:
    error_um, left, _, _ = miss
    return -error_um, left.dt_ns


# --- the reference in force ---


class PlayedReference:
    """The plate at an instant that has passed: its amplitudes (M,), and for each finger its place with its target, the
    gain of the amplitude that it needs as it slides, and the ellipse of its contact, where that is known."""

    def __init__(
        self,
        modal_um: Phasors,
        places: list[AskedPlace],
        speed_gains: list[float],
        ellipses: list[ContactEllipse | None] | None = None,
    ) -> None:
        self.modal_um: Final = modal_um
        self.places: Final = places
        self.speed_gains: Final = speed_gains
        self.ellipses: Final = ellipses


class ActiveReference:
    """The last reference that was made, and those before it, back to what the plate did at the newest sample."""

    def __init__(self, modes: int, planner: KnotPlanner, tolerance_um: float) -> None:
        self.drive = silence(0, modes)
        self.fingers = NO_FINGERS  # for whom it was made
        self.is_sent = True  # the board has it, or takes it next
        self.points: tuple[TouchPoint, ...] = ()
        self.limited = False
        self._places: list[AskedPlace] = []
        self._t_settled_ns = 0
        self._recent = [self.drive]
        self._planner: Final = planner
        self._tolerance_um: Final = tolerance_um

    @property
    def is_silent(self) -> bool:
        """Whether it ends without any amplitude."""
        return not any(self.drive.knots[-1].modal_um)

    def activate(
        self,
        drive: SafeDrive,
        fingers: DrivenFingers,
        places: list[AskedPlace],
        points: tuple[TouchPoint, ...],
        *,
        limited: bool,
    ) -> None:
        """Put another in its place, made for these fingers, who are at `places` at its end."""
        self.drive, self.fingers, self._places, self.is_sent = drive, fingers, places, True
        self.points, self.limited = points, limited
        self._t_settled_ns = settles_ns(drive, self._tolerance_um)
        self._recent = [*self._recent[1 - _KEPT :], drive]

    def has_settled(self, fingers: DrivenFingers, t_apply_ns: int) -> bool:
        """Return whether it is for these fingers, and no longer changes: it may hold on."""
        return self.is_sent and t_apply_ns >= self._t_settled_ns and fingers == self.fingers

    def still_holds(self, plan: FramePlan, begin: list[AskedPlace], end: list[AskedPlace], most_knots: int) -> bool:
        """Return whether it, having settled, still holds: from a frame's beginning to its end the fingers stay where
        it was made for."""
        steepness_um_mm = self._planner.steepness_1_mm * sum(abs(w_um) for w_um in self.drive.knots[-1].modal_um)
        for places in (begin, end):
            for (x_mm, y_mm, target_um), (was_x_mm, was_y_mm, was_um) in zip(places, self._places, strict=True):
                moved_um = steepness_um_mm * math.hypot(x_mm - was_x_mm, y_mm - was_y_mm)
                if target_um != was_um or not moved_um <= self._tolerance_um:
                    return False
        if steepness_um_mm > 0.0 and not self._planner.surfaces.layers:
            return True  # while the plate is silent, fingers may move far: over stripes, to the same target
        ways_mm = moved_mm(begin, end)
        pieces, _, edges_ns = self._planner.pieces(plan.fingers.keys, ways_mm, plan.t_ns, plan.span_ns, most_knots)
        return pieces == 1 and not edges_ns

    def points_at(self, places: list[AskedPlace]) -> tuple[TouchPoint, ...]:
        """Return its fingers' points, at their present places."""
        return tuple(map(_moved, self.points, places))

    def um(self, t_ns: int) -> Phasors:
        """Return its amplitudes at an instant: another continues them."""
        return interpolated_um(self.drive, t_ns)

    def past_um(self, t_ns: int) -> Phasors:
        """Return the amplitudes of the reference that was in force at `t_ns`, there."""
        active = self._recent[0]
        for drive in self._recent:
            if drive.t_apply_ns <= t_ns:
                active = drive
        return interpolated_um(active, t_ns)


def _moved(point: TouchPoint, now: AskedPlace) -> TouchPoint:
    """A finger's point at its present place, for a reference that stays in force."""
    x_mm, y_mm, _ = now
    return TouchPoint(point.key, x_mm, y_mm, point.target_um, point.achieved_um, x_mm, y_mm)


def interpolated_um(drive: SafeDrive, t_ns: int) -> Phasors:
    """Amplitudes of a polyline at `t_ns` as the board plays it: a new polyline continues them."""
    since_ns = t_ns - drive.t_apply_ns
    before_ns, before_um = drive.knots[0]
    for after_ns, after_um in drive.knots[1:]:
        if since_ns < after_ns:
            share = max((since_ns - before_ns) / (after_ns - before_ns), 0.0)
            return tuple([before_um[n] + (after_um[n] - before_um[n]) * share for n in range(len(before_um))])
        before_ns, before_um = after_ns, after_um
    return before_um


def settles_ns(drive: SafeDrive, tolerance_um: float) -> int:
    """Time from which a polyline is within the tolerance of its last knot: its start or its end."""
    last_ns, last_um = drive.knots[-1]
    for _, modal_um in drive.knots[:-1]:
        for mode in range(len(last_um)):
            if not abs(modal_um[mode] - last_um[mode]) <= tolerance_um:
                return drive.t_apply_ns + last_ns
    return drive.t_apply_ns
