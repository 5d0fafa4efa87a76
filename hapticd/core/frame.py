"""One frame of the reference: the fingers that take part, where they will be at each of its knots, into how many spans
textures and edges divide their ways, and the amplitudes at each knot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Final

from ..values import FingerKey, Knot
from .phasors import Phasors
from .pipeline_settings import PipelineCounters
from .plate.contact import EllipseForm
from .solver.instant import AskedPlace, InstantSolver, ModalSolution
from .targets.scene import Scene
from .targets.surfaces import Crossing
from .touch.fingers import Fingers
from .trajectory.knots import SHORTEST_NS, refine

_STEP_NS: Final = 1_000_000  # over which a predicted speed is taken
_NO_EDGES: Final[Sequence[int]] = ()


class Participants:
    """The fingers that take part in a pass, the priority of each, and the forms of their contacts: None where all are
    discs, or points."""

    def __init__(self, keys: list[FingerKey], priorities: list[int], forms: list[EllipseForm | None] | None) -> None:
        self.keys: Final = keys
        self.priorities: Final = priorities
        self.forms: Final = forms

    def are(self, others: Participants) -> bool:
        """Return whether these are the same, as they were."""
        return self.keys == others.keys and self.priorities == others.priorities and self.forms == others.forms


NO_FINGERS: Final = Participants([], [], None)


class Instant:
    """The fingers at one instant: where each will be with which target, and, where friction depends on the speed, by
    how much more amplitude it needs as it gains."""

    def __init__(self, places: list[AskedPlace], speed_gains: list[float] | None) -> None:
        self.places: Final = places
        self.speed_gains: Final = speed_gains


class FramePlan:
    """A frame before it is solved: for whom, from when on the plate, how long, with how many knots by how many solves,
    and the corners of effects in it."""

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


class KnotPlanner:
    """Planner of a frame's knots: what they depend on, apart from the solutions themselves."""

    def __init__(self, scene: Scene, fingers: Fingers, steepness_1_mm: float, tolerance_um: float) -> None:
        self._scene: Final = scene
        self._surfaces: Final = scene.surfaces
        self._fingers: Final = fingers
        self.steepness_1_mm: Final = steepness_1_mm  # of the plate's shapes
        self._tolerance_um: Final = tolerance_um

    @property
    def has_surfaces(self) -> bool:
        """Whether surfaces lie on the plate."""
        return len(self._surfaces.layers) > 0

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
        if self._surfaces.layers:
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
                way = self._surfaces.along(predicted_mm, t_plate_ns, span_ns)
                pieces, smooth = max(pieces, way.pieces), smooth and way.is_smooth
                crossed += way.crossings
        edges_ns = [edge_ns for edge_ns in self._surfaces.edges_ns(crossed, t_plate_ns, self._tolerance_um) if edge_ns]
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

    def at(self, keys: Sequence[FingerKey], t_ns: int) -> Instant:
        """Predict the fingers, and look up what each should feel where it will be."""
        scene = self._scene
        speed_gains: list[float] | None = [] if scene.depends_on_speed else None
        places: list[AskedPlace] = []
        for key in keys:
            x_mm, y_mm = self._predicted_mm(key, t_ns)
            if speed_gains is not None:
                speed_gains.append(scene.speed_gain(self._speed_mm_s(key, t_ns, x_mm, y_mm)))
            target_um = scene.amplitude_um(key, x_mm, y_mm)
            if target_um is None:
                target_um = self._surfaces.amplitude_um(x_mm, y_mm, t_ns)
            if self._effects.felt:
                target_um = self._effects.felt_um(key, scene.owner_of(key), (x_mm, y_mm), t_ns, target_um)
            places.append((x_mm, y_mm, target_um))
        return Instant(places, speed_gains)

    def speed_mm_s(self, key: FingerKey, t_ns: int) -> float:
        """Return how fast a finger will slide."""
        return self._speed_mm_s(key, t_ns, *self._predicted_mm(key, t_ns))

    def _speed_mm_s(self, key: FingerKey, t_ns: int, x_mm: float, y_mm: float) -> float:
        was_x_mm, was_y_mm = self._predicted_mm(key, t_ns - _STEP_NS)
        return math.hypot(x_mm - was_x_mm, y_mm - was_y_mm) / (_STEP_NS * 1e-9)

    def _predicted_mm(self, key: FingerKey, t_ns: int) -> tuple[float, float]:
        """Return where a finger will be."""
        if isinstance(key, str):
            return self._scene.virtual_position_mm(key, t_ns)
        return self._fingers.predicted_mm(key, t_ns)

    def forms(self, keys: Sequence[FingerKey]) -> list[EllipseForm | None] | None:
        """Return the forms of contacts that the plate is driven for; None where all are discs, or points."""
        return self._fingers.forms(keys) if self._solver.has_contacts else None

    def polyline(
        self, plan: FramePlan, begin: Instant, end: Instant, previous_um: Phasors
    ) -> tuple[ModalSolution, ModalSolution, list[Knot]]:
        """Return the solutions at the frame's beginning and end, and the knots from one to the other."""
        fingers, span_ns, tolerance_um = plan.fingers, plan.span_ns, self._tolerance_um
        first = self._solve(fingers, plan.t_ns, begin, previous_um, 0)
        if plan.most_knots == 1:
            return first, first, [Knot(0, first.modal_um)]
        last = self._solve(fingers, plan.t_ns + span_ns, end, first.modal_um, span_ns)
        knots = [Knot(0, first.modal_um), Knot(span_ns, last.modal_um)]
        ways_mm = moved_mm(first.places, last.places)
        room = plan.most_knots - len(plan.corners_ns)
        pieces, smooth, edges_ns = self._planner.pieces(fingers.keys, ways_mm, plan.t_ns, span_ns, room)
        is_plain = pieces == 1 and smooth and not edges_ns
        is_plain = is_plain and self._planner.bend_um(knots, ways_mm) <= tolerance_um

        def solve(dt_ns: int, before: Knot) -> Phasors:
            t_ns = plan.t_ns + dt_ns
            at = self.at(fingers.keys, t_ns)
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

    def _solve(
        self, fingers: Participants, t_ns: int, at: Instant, previous_um: Phasors, since_ns: int
    ) -> ModalSolution:
        """Evaluate the modes and solve, for one instant `since_ns` after another."""
        self._counters.solves += 1
        if not self._solver.has_contacts:
            return self._solver.solve(at.places, previous_um, since_ns)
        variances_mm2, ranks = self._fingers.variances_mm2(fingers.keys, t_ns), fingers.priorities
        return self._solver.solve(at.places, previous_um, since_ns, variances_mm2, at.speed_gains, ranks, fingers.forms)
