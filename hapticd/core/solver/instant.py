"""The plate at one instant: the fingers' places and targets, and the modal amplitudes that serve them.

Amplitudes are plain floats while at most one finger slips: friction depends on |w_i| only, so a sign is enough. With
two or more slipping fingers, signs alone cannot avoid zero crossings where the best pattern of signs changes: the phase
between fingers turns instead (`phase`), and amplitudes are complex until the plate has been silent.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from ...values import FingerKey, TouchPoint
from ..friction import DEFAULT_FRICTION_CURVE, FrictionCurve
from ..phasors import ModeRows, Row, magnitude
from ..plate.contact import Disc, EllipseForm, Shapes, grown, many_points
from ..plate.mode_shapes import ModeShapes
from ..plate.parasitic_modes import WIRE_FRAC, ParasiticModes
from ..trajectory.knots import SHORTEST_NS
from .derating import derated, is_near_node, least_share, slopes_at
from .felt import COLD_ITERATIONS, ITERATIONS, felt_points, is_any_slippery, solve_felt, step_towards
from .felt_descent import components, contact_shapes, contacts_rms_um, phasors
from .points.general import solve_fast
from .points.phase import solve_phased_fast
from .reach import ReachProblem, reach

AskedPlace = tuple[float, float, float]  # x_mm, y_mm and target_um: where a finger is, and what it should feel there
PointSolver = Callable[[ModeRows, tuple[float, ...], tuple[float, ...], tuple[float, ...] | None], tuple[Row, bool]]

SLEW_UM_NS: Final = 0.5e-6  # what the plate follows: 2 um in 4 ms; landing and lifting turn amplitudes at this speed
LEAST_STEP_UM: Final = 1.0  # from one frame to the next: what a report may tell of a finger in motion
TURN_RAD_NS: Final = 50e-9  # speed of the phase between fingers: faster helps no finger and makes larger steps


class ModalSolution:
    """The plate at one instant: the fingers' places, the amplitudes that serve them, and what each finger gets.

    `achieved_um` (N,) is |w_i| at a point, the RMS over a contact. Not a named tuple: a compiled class is created in a
    quarter of the time.
    """

    __slots__ = ("achieved_um", "limited", "modal_um", "places")

    def __init__(self, places: list[AskedPlace], achieved_um: list[float], modal_um: Row, limited: bool) -> None:
        self.places: Final = places
        self.achieved_um: Final = achieved_um
        self.modal_um: Final = modal_um
        self.limited: Final = limited


class InstantSolver:
    """Solver of one plate.

    `derating_mm2_um2`: the price of `derating`, 0 to switch it off; `phase_rotation`: phases may turn;
    `parasitic_modes`: undriven modes to compensate, which makes all amplitudes complex; `contact_radius_mm` above 0:
    fingers are contacts, discs where their forms are not known, and amplitudes complex; `friction_curve` is what they
    feel.
    """

    def __init__(
        self,
        modes: ModeShapes,
        w_limit_um: tuple[float, ...],
        *,
        derating_mm2_um2: float,
        phase_rotation: bool,
        parasitic_modes: ParasiticModes | None = None,
        contact_radius_mm: float = 0.0,
        friction_curve: FrictionCurve = DEFAULT_FRICTION_CURVE,
        solve: PointSolver = solve_fast,
    ) -> None:
        self.set_modes(modes)
        self._w_limit_um = w_limit_um
        self._contact_limit_um = tuple([limit_um * WIRE_FRAC for limit_um in w_limit_um])
        self._solve = solve
        self._derating_mm2_um2 = derating_mm2_um2
        self._rotates = phase_rotation
        self._parasitic_modes = parasitic_modes
        self.set_contact_radius(contact_radius_mm)
        self._log_weights: list[float] = []
        self._curve = friction_curve
        self._is_turned = self._is_crowded = False

    def set_modes(self, modes: ModeShapes) -> None:
        """Solve for this map from now on."""
        self._modes = modes
        self._steepest_1_mm = modes.steepest_1_mm()

    def set_contact_radius(self, radius_mm: float) -> None:
        """Take contacts to be discs of this radius where their forms are not known; 0 for points."""
        self.contact_radius_mm = radius_mm
        self._disc: Disc = felt_points() if radius_mm > 0.0 else []
        self._disc_weights = [weight for _, _, weight in self._disc]

    def cost_ns(self, fingers: int) -> float:
        """Return an estimate of what one solve for so many fingers takes at most, fitted to machine code: for contacts
        one and a half times its time in a row."""
        modes = len(self._w_limit_um)
        if len(self._disc) > 0:
            return 5_000.0 + 550.0 * fingers * modes
        if fingers <= 2 and modes <= 2:
            return 13_300.0
        return 18_600.0 + 1_000.0 * fingers * modes + 89.0 * modes * modes * modes

    def cold_ns(self, fingers: int) -> float:
        """Return what the first solve from silence takes more, by the same estimate."""
        if len(self._disc) == 0:
            return 0.0
        return (COLD_ITERATIONS / ITERATIONS - 1.0) * self.cost_ns(fingers)

    @property
    def has_contacts(self) -> bool:
        """Whether fingers are contacts, whose places are taken with their variance."""
        return len(self._disc) > 0

    def solve(
        self,
        places: list[AskedPlace],
        previous_um: Row,
        since_ns: int,
        variances_mm2: list[float] | None = None,
        stretches: list[float] | None = None,
        priorities: list[int] | None = None,
        forms: list[EllipseForm | None] | None = None,
    ) -> ModalSolution:
        """The solution for these places; `previous_um` (M,) are the amplitudes `since_ns` before. For contacts:
        `variances_mm2` (N,) of the places on each axis, by how much more amplitude each sliding finger needs, the
        fingers' `priorities`, without them equal, and the contacts' `forms`, None for discs."""
        if len(self._disc) > 0:
            return self._solve_contacts(places, previous_um, since_ns, variances_mm2, stretches, priorities, forms)
        rows, targets, still = list[tuple[float, ...]](), list[float](), 0
        for x_mm, y_mm, target_um in places:  # once: each time around makes floats of all three
            rows.append(self._modes.at(x_mm, y_mm))
            targets.append(target_um)
            still += target_um == 0.0
        phi, targets_um = tuple(rows), tuple(targets)
        modal_um: Row
        if self._turns(len(places) - still, previous_um):
            turn_rad = TURN_RAD_NS * max(since_ns, SHORTEST_NS)
            phasors_um = tuple(map(complex, previous_um))
            descends = self._descends(len(places) - still, previous_um)
            modal_um, limited = solve_phased_fast(
                phi, targets_um, self._w_limit_um, phasors_um, turn_rad, descends=descends
            )
        else:
            real_um = tuple([w_um if isinstance(w_um, float) else w_um.real for w_um in previous_um])
            modal_um, limited = self._solve(phi, targets_um, self._w_limit_um, real_um)
        if self._derating_mm2_um2 > 0.0 and still > 0:
            modal_um = self._derated(places, phi, targets_um, modal_um, limited)
        if self._parasitic_modes is not None:
            modal_um = self._parasitic_modes.silenced(places, phi, modal_um, self._w_limit_um)
        return ModalSolution(places, _amplitudes_um(phi, modal_um), modal_um, limited)

    def _solve_contacts(
        self,
        places: list[AskedPlace],
        previous_um: Row,
        since_ns: int,
        variances_mm2: list[float] | None,
        stretches: list[float] | None,
        priorities: list[int] | None,
        forms: list[EllipseForm | None] | None,
    ) -> ModalSolution:
        d_um, q_um = components(previous_um)
        before_d_um, before_q_um = d_um.copy(), q_um.copy()
        if variances_mm2 is None:
            variances_mm2 = [0.0] * len(places)
        targets_um = tuple([target_um for _, _, target_um in places])
        contacts = grown(self.contact_radius_mm, variances_mm2, forms)
        shapes = self._contact_shapes(self._disc, places, contacts)
        if len(self._log_weights) != len(places):
            self._log_weights = [0.0] * len(places)
        ranks = [0] * len(places) if priorities is None else priorities
        slides = [1.0] * len(places) if stretches is None else stretches
        limits_um, weights, logs = self._contact_limit_um, self._disc_weights, self._log_weights
        achieved_um, limited = solve_felt(
            shapes, weights, self._curve, targets_um, limits_um, d_um, q_um, logs, slides, ranks
        )
        most_um = LEAST_STEP_UM + SLEW_UM_NS * since_ns
        if is_any_slippery(targets_um) and step_towards(before_d_um, before_q_um, d_um, q_um, most_um):
            achieved_um = contacts_rms_um(shapes, self._disc_weights, d_um, q_um)
        return ModalSolution(places, achieved_um, phasors(d_um, q_um), limited)

    def _contact_shapes(self, disc: Disc, places: list[AskedPlace], contacts: list[EllipseForm]) -> Shapes:
        radius_mm = self.contact_radius_mm
        ellipses = [
            (x_mm, y_mm, xx * radius_mm, xy * radius_mm, yy * radius_mm)
            for (x_mm, y_mm, _), (xx, xy, yy) in zip(places, contacts, strict=True)
        ]
        return contact_shapes(self._modes, disc, ellipses)

    def reach(
        self,
        places: list[AskedPlace],
        variances_mm2: list[float],
        stretches: list[float],
        priorities: list[int],
        calls: int,
        forms: list[EllipseForm | None] | None = None,
    ) -> tuple[float, float] | None:
        """Return the interval of friction (0 .. 1) that the last finger can feel beside the others, by so many calls
        of the solver; None if it can feel none as asked."""
        contacts = grown(self.contact_radius_mm, variances_mm2, forms)
        targets_um = [target_um for _, _, target_um in places[:-1]]
        judging = many_points()
        problem = ReachProblem(
            self._contact_shapes(self._disc, places, contacts),
            self._disc_weights,
            self._contact_shapes(judging, places, contacts),
            [weight for _, _, weight in judging],
            self._curve,
            targets_um,
            self._contact_limit_um,
            stretches,
            priorities,
        )
        return reach(problem, calls)

    def _turns(self, slipping: int, previous_um: Row) -> bool:
        """Phases turn while two fingers slip, and after that until the plate has been silent."""
        if not self._rotates:
            return False
        if slipping >= 2:
            self._is_turned = True
        elif self._parasitic_modes is None:
            return not isinstance(previous_um[0], float)
        elif not any(previous_um):
            self._is_turned = False
        return self._is_turned

    def _descends(self, slipping: int, previous_um: Row) -> bool:
        """More than two fingers slip, or did since the plate was silent: what their phases have become is no turn."""
        self._is_crowded = slipping > 2 or (self._is_crowded and any(previous_um))
        return self._is_crowded

    def _derated(
        self,
        places: list[AskedPlace],
        phi: tuple[tuple[float, ...], ...],
        targets_um: tuple[float, ...],
        modal_um: Row,
        limited: bool,
    ) -> Row:
        """Derate the amplitudes; slopes are evaluated only where they could matter."""
        if not limited and not self._is_near_node(phi, targets_um, modal_um):
            return modal_um
        share = least_share(_amplitudes_um(phi, modal_um), targets_um) if limited else 1.0
        return derated(modal_um, share, slopes_at(self._modes, places), self._derating_mm2_um2, limited=limited)

    def _is_near_node(self, phi: tuple[tuple[float, ...], ...], targets_um: tuple[float, ...], modal_um: Row) -> bool:
        """Some still finger may be near a common node."""
        for finger in range(len(phi)):
            if targets_um[finger] == 0.0 and is_near_node(phi[finger], modal_um, self._steepest_1_mm):
                return True
        return False


def points(keys: Sequence[FingerKey], first: ModalSolution, last: ModalSolution) -> tuple[TouchPoint, ...]:
    """The fingers at a frame's first knot, with the amplitude that each gets there."""
    found: list[TouchPoint] = []
    for n in range(len(first.places)):
        (x_mm, y_mm, target_um), (end_x_mm, end_y_mm, _) = first.places[n], last.places[n]
        point = (keys[n], x_mm, y_mm, target_um, first.achieved_um[n], end_x_mm, end_y_mm)
        found.append(tuple.__new__(TouchPoint, point))
    return tuple(found)


def _amplitudes_um(phi: ModeRows, modal_um: Row) -> list[float]:
    """Each finger's amplitude |w_i|."""
    modal_d_um, modal_q_um = components(modal_um)  # once for all fingers
    amplitudes_um: list[float] = []
    for row in phi:
        w_d_um = w_q_um = 0.0
        for mode in range(len(row)):
            w_d_um += row[mode] * modal_d_um[mode]
            w_q_um += row[mode] * modal_q_um[mode]
        amplitudes_um.append(magnitude(w_d_um, w_q_um))
    return amplitudes_um
