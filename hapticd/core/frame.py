"""One frame of the reference: the fingers that take part, the instants of its knots, where the fingers will be then,
and the amplitudes, all solved for by one call of the kernel; and the reference in force, which may still hold.

Between knots the board interpolates linearly. A chord of span h errs by h^2 W''/8, so that knots are needed where
fingers move over the plate's waves, by KNOT_SPACING, over textures, and at edges. To look where chords miss the
solution is no better: with a knot wherever one missed by 0.04 um the same was felt with 1.2 to 1.6 times the solves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Final, NamedTuple

from ..values import FingerKey, Knot, SafeDrive, TouchPoint
from .phasors import Phasors
from .plate.contact import Ellipses
from .solver.instant import AskedPlace, FingerTargets, InstantSolver, ModalSolution
from .targets.scene import Scene
from .targets.surfaces import Crossing
from .touch.fingers import Fingers
from .trajectory.gate import SHORTEST_NS, silence

KNOT_SPACING: Final = 0.23  # of a finger's way times the plate's steepness: a chord errs by 0.7 % of W
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
    ellipses: Ellipses


NO_FINGERS: Final = DrivenFingers([], [], None)


class FramePlan(NamedTuple):
    """A frame before it is solved: for whom, from when on the plate, how long, with how many knots, and the corners of
    effects in it."""

    fingers: DrivenFingers
    t_ns: int
    span_ns: int
    most_knots: int
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
    ) -> tuple[int, Sequence[int]]:
        """Return into how many spans textures divide the fingers' way, and the instants before and after each edge of a
        surface; `most` knots in all."""
        pieces, edges_ns = 1.0, _NO_EDGES
        for finger, way_mm in enumerate(moved_mm):
            pieces = max(pieces, way_mm / self._scene.finest_mm(keys[finger]))
        if self.surfaces.layers:
            surface_pieces, edges_ns = self._edges(keys, t_plate_ns, span_ns, most)
            pieces = max(pieces, surface_pieces)
        room = max(most - 1 - len(edges_ns), 1)
        return math.ceil(min(pieces, room, span_ns / SHORTEST_NS)), edges_ns

    def times_ns(self, plan: FramePlan, moved_mm: Sequence[float]) -> list[int]:
        """Return the instants of a frame's knots, from its beginning on."""
        if plan.most_knots == 1:
            return [0]
        room, span_ns = plan.most_knots - len(plan.corners_ns), plan.span_ns
        pieces, edges_ns = self.pieces(plan.fingers.keys, moved_mm, plan.t_ns, span_ns, room)
        over_waves = min(room - 1 - len(edges_ns), self.steepness_1_mm * max(moved_mm) / KNOT_SPACING)
        pieces = max(pieces, math.ceil(over_waves))
        times_ns = [span_ns * piece // pieces // 1000 * 1000 for piece in range(pieces)]
        return sorted({*times_ns, *edges_ns, *plan.corners_ns, span_ns})

    def _edges(
        self, keys: Sequence[FingerKey], t_plate_ns: int, span_ns: int, most: int
    ) -> tuple[float, Sequence[int]]:
        """Return what the surfaces add to `pieces`; where there are too many edges, the earliest."""
        pieces, crossed = 1.0, list[Crossing]()
        for key in keys:
            if isinstance(key, int) and self._scene.target_of(key) is None:
                predicted_mm = partial(self._fingers.predicted_mm, key)
                way = self.surfaces.along(predicted_mm, t_plate_ns, span_ns)
                pieces = max(pieces, way.pieces)
                crossed += way.crossings
        edges_ns = [edge_ns for edge_ns in self.surfaces.edges_ns(crossed, t_plate_ns, self._tolerance_um) if edge_ns]
        return pieces, edges_ns[: max(most - 2, 0) // 2 * 2]


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
        counters: PipelineCounters,
    ) -> None:
        self._scene: Final = scene
        self._surfaces: Final = scene.surfaces
        self._effects: Final = scene.effects
        self._fingers: Final = fingers
        self._solver: Final = solver
        self._planner: Final = planner
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

    def ellipses(self, keys: Sequence[FingerKey]) -> Ellipses:
        """Return the ellipses of contacts that the plate is driven for; None where all are discs, or points."""
        return self._fingers.ellipses(keys) if self._solver.has_contacts else None

    def polyline(
        self, plan: FramePlan, begin: FingerTargets, end: FingerTargets, previous_um: Phasors
    ) -> tuple[ModalSolution, ModalSolution, list[Knot]]:
        """Return the solutions at the frame's beginning and end, and the knots from one to the other."""
        keys, priorities, ellipses = plan.fingers
        times_ns = self._planner.times_ns(plan, moved_mm(begin.places, end.places))
        instants = [begin, *[self.at(keys, plan.t_ns + dt_ns) for dt_ns in times_ns[1:-1]], end][: len(times_ns)]
        since_ns = [0, *[after_ns - before_ns for before_ns, after_ns in pairwise(times_ns)]]
        solutions = self._solver.along(instants, since_ns, previous_um, priorities, ellipses)
        self._counters.solves += len(solutions)
        knots = [Knot(times_ns[n], solutions[n].modal_um) for n in range(len(solutions))]
        return solutions[0], solutions[-1], knots


# --- the reference in force ---


class PlayedReference:
    """The plate at an instant that has passed: its amplitudes (M,), and for each finger its place with its target, the
    gain of the amplitude that it needs as it slides, and the ellipse of its contact, where that is known."""

    def __init__(
        self,
        modal_um: Phasors,
        places: list[AskedPlace],
        speed_gains: list[float],
        ellipses: Ellipses = None,
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
        pieces, edges_ns = self._planner.pieces(plan.fingers.keys, ways_mm, plan.t_ns, plan.span_ns, most_knots)
        return pieces == 1 and not edges_ns

    def points_at(self, places: list[AskedPlace]) -> tuple[TouchPoint, ...]:
        """Return its fingers' points, at their present places."""
        found: list[TouchPoint] = []
        for n in range(len(places)):
            (x_mm, y_mm, _), point = places[n], self.points[n]
            found.append(TouchPoint(point.key, x_mm, y_mm, point.target_um, point.achieved_um, x_mm, y_mm))
        return tuple(found)

    def past_um(self, t_ns: int) -> Phasors:
        """Return the amplitudes of the reference that was in force at `t_ns`, there."""
        active = self._recent[0]
        for drive in self._recent:
            if drive.t_apply_ns <= t_ns:
                active = drive
        return interpolated_um(active, t_ns)


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
