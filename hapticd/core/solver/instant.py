"""The plate at one instant: the fingers' places and targets, and the modal amplitudes that serve them.

Fingers are contacts, or points where the contact's radius is 0. The paper's case of points, one slipping and one still
on two modes, has a closed form (`two_modes`); everything else is solved by one descent (`felt`).
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from ...values import FingerKey, FloatArray, TouchPoint
from ..friction import DEFAULT_FRICTION_CURVE, FrictionCurve
from ..phasors import ModeRow, ModeRows, Phasors
from ..plate.contact import EllipseForm, Shapes, grown, many_points
from ..plate.mode_shapes import ModeShapes
from .felt import felt_points, is_any_slippery, solve_felt
from .felt_descent import COLD, contact_shapes
from .reach import Contacts, ReachSearch
from .two_modes import Pair, derated, hold_still, turned

AskedPlace = tuple[float, float, float]  # x_mm, y_mm and target_um: where a finger is, and what it should feel there
PointSolver = Callable[[ModeRows, ModeRow, ModeRow, ModeRow | None], tuple[ModeRow, bool]]

SLEW_UM_NS: Final = 0.5e-6  # what the plate follows: 2 um in 4 ms; landing and lifting turn amplitudes at this speed
LEAST_STEP_UM: Final = 1.0  # from one frame to the next: what a report may tell of a finger in motion
WIRE_FRAC: Final = 1.0 - 2.0**-22  # of a limit: rounding both parts to 32 bits may lengthen a phasor by the rest
POINT: Final = ((0.0, 0.0, 1.0),)


class ModalSolution:
    """The plate at one instant: the fingers' places, the amplitudes that serve them, and what each finger gets.

    `achieved_um` (N,) is |w_i| at a point, the RMS over a contact. Not a named tuple: a compiled class is created in a
    quarter of the time.
    """

    def __init__(self, places: list[AskedPlace], achieved_um: list[float], modal_um: Phasors, limited: bool) -> None:
        self.places: Final = places
        self.achieved_um: Final = achieved_um
        self.modal_um: Final = modal_um
        self.limited: Final = limited


class InstantSolver:
    """Solver of one plate.

    `contact_radius_mm`: fingers are discs of it where their forms are not known, points if it is 0; `friction_curve` is
    what they feel. `derates`: amplitude gives way in the paper's case. `solve` takes the place of all rules for points.
    """

    def __init__(
        self,
        modes: ModeShapes,
        w_limit_um: tuple[float, ...],
        *,
        contact_radius_mm: float = 0.0,
        friction_curve: FrictionCurve = DEFAULT_FRICTION_CURVE,
        derates: bool = True,
        solve: PointSolver | None = None,
    ) -> None:
        self._modes: Final = modes
        self._w_limit_um: Final = w_limit_um
        self._wire_limit_um: Final = np.array(w_limit_um) * WIRE_FRAC
        self.contact_radius_mm: Final = contact_radius_mm
        self.has_contacts: Final = contact_radius_mm > 0.0  # then places are taken with their variance
        self._disc: Final = np.array(felt_points() if self.has_contacts else POINT)
        self._curve: Final = friction_curve
        self._derates: Final = derates
        self._solve: Final = solve
        self._log_weights: list[float] = []

    def cost_ns(self, fingers: int) -> float:
        """Return an estimate of what one solve for so many fingers takes at most, fitted to machine code: one and a
        half times its time in a row."""
        return 5_000.0 + 550.0 * fingers * len(self._w_limit_um)

    def cold_ns(self, fingers: int) -> float:
        """Return what the first solve from silence takes more, by the same estimate."""
        return (COLD - 1.0) * self.cost_ns(fingers)

    def solve(
        self,
        places: list[AskedPlace],
        previous_um: Phasors,
        since_ns: int,
        variances_mm2: list[float] | None = None,
        speed_gains: list[float] | None = None,
        priorities: list[int] | None = None,
        forms: list[EllipseForm | None] | None = None,
    ) -> ModalSolution:
        """The solution for these places; `previous_um` (M,) are the amplitudes `since_ns` before. For contacts:
        `variances_mm2` (N,) of the places on each axis, and the contacts' `forms`, None for discs. `speed_gains` are
        the gains of the amplitude that each finger needs as it slides; `priorities` without them are equal."""
        if not self.has_contacts:
            solution = self._solve_two(places, previous_um) if self._solve is None else self._by(places, previous_um)
            if solution is not None:
                return solution
        fingers, most_step_um = len(places), math.inf
        targets_um = [target_um for _, _, target_um in places]
        if len(self._log_weights) != fingers:
            self._log_weights = [0.0] * fingers
        if self.has_contacts and is_any_slippery(targets_um):
            most_step_um = LEAST_STEP_UM + SLEW_UM_NS * since_ns
        modal_um, achieved_um, limited = solve_felt(
            self._contact_shapes(self._disc, places, variances_mm2, forms),
            self._disc,
            self._curve,
            targets_um,
            self._wire_limit_um,
            previous_um,
            self._log_weights,
            [1.0] * fingers if speed_gains is None else speed_gains,
            [0] * fingers if priorities is None else priorities,
            most_step_um,
        )
        return ModalSolution(places, achieved_um, modal_um, limited)

    def _contact_shapes(
        self,
        disc: FloatArray,
        places: list[AskedPlace],
        variances_mm2: list[float] | None,
        forms: list[EllipseForm | None] | None,
    ) -> Shapes:
        radius_mm = self.contact_radius_mm
        contacts: list[EllipseForm] = [(1.0, 0.0, 1.0)] * len(places)
        if radius_mm > 0.0:
            contacts = grown(radius_mm, [0.0] * len(places) if variances_mm2 is None else variances_mm2, forms)
        ellipses: list[float] = []
        for finger in range(len(places)):
            (x_mm, y_mm, _), (xx, xy, yy) = places[finger], contacts[finger]
            ellipses += [x_mm, y_mm, xx * radius_mm, xy * radius_mm, yy * radius_mm]
        return contact_shapes(self._modes.tables, disc, array("d", ellipses))

    def _solve_two(self, places: list[AskedPlace], previous_um: Phasors) -> ModalSolution | None:
        """The paper's case; None for any other."""
        if not (len(places) == 2 == len(self._w_limit_um)):
            return None
        moved, held = (0, 1) if places[1][2] == 0.0 else (1, 0)
        target_um = places[moved][2]
        if not (target_um > 0.0 and places[held][2] == 0.0):
            return None
        slipping, still = self._pair_at(places[moved]), self._pair_at(places[held])
        if still == (0.0, 0.0):  # on a node of both modes: still, whatever they do
            return None
        limits_um = self._w_limit_um[0], self._w_limit_um[1]
        modal_um, phase, limited = hold_still(slipping, target_um, still, limits_um, (previous_um[0], previous_um[1]))
        if self._derates:
            share = min(1.0, abs(slipping[0] * modal_um[0] + slipping[1] * modal_um[1]) / target_um) if limited else 1.0
            x_mm, y_mm, _ = places[held]
            modal_um = derated(
                modal_um,
                share,
                lambda: self._modes.at_with_gradient(x_mm, y_mm),
                still,
                self._modes.steepest_1_mm(),
                limited=limited,
            )
        got_um = [0.0, 0.0]
        got_um[moved] = abs(slipping[0] * modal_um[0] + slipping[1] * modal_um[1])
        got_um[held] = abs(still[0] * modal_um[0] + still[1] * modal_um[1])
        return ModalSolution(places, got_um, turned(modal_um, phase, limits_um), limited)

    def _pair_at(self, place: AskedPlace) -> Pair:
        row = self._modes.at(place[0], place[1])
        return row[0], row[1]

    def _by(self, places: list[AskedPlace], previous_um: Phasors) -> ModalSolution:
        """The solution by another rule for points, with real amplitudes."""
        assert self._solve is not None
        rows = tuple([self._modes.at(x_mm, y_mm) for x_mm, y_mm, _ in places])
        targets_um = tuple([target_um for _, _, target_um in places])
        modal_um, limited = self._solve(rows, targets_um, self._w_limit_um, tuple([w_um.real for w_um in previous_um]))
        got_um = [abs(sum([phi * w_um for phi, w_um in zip(row, modal_um, strict=True)])) for row in rows]
        return ModalSolution(places, got_um, tuple(map(complex, modal_um)), limited)

    def reach(
        self,
        places: list[AskedPlace],
        variances_mm2: list[float],
        speed_gains: list[float],
        priorities: list[int],
        calls: int,
        forms: list[EllipseForm | None] | None = None,
    ) -> tuple[float, float] | None:
        """Return the interval of friction (0 .. 1) that the last finger can feel beside the others, by so many calls
        of the solver; None if it can feel none as asked."""
        judging = np.array(many_points())
        contacts = Contacts(self._contact_shapes(self._disc, places, variances_mm2, forms), self._disc)
        judged = Contacts(self._contact_shapes(judging, places, variances_mm2, forms), judging)
        targets_um = [target_um for _, _, target_um in places[:-1]]
        problem = ReachSearch(contacts, judged, self._curve, targets_um, self._wire_limit_um, speed_gains, priorities)
        return problem.interval(calls)


def points(keys: Sequence[FingerKey], first: ModalSolution, last: ModalSolution) -> tuple[TouchPoint, ...]:
    """The fingers at a frame's first knot, with the amplitude that each gets there."""
    found: list[TouchPoint] = []
    for n in range(len(first.places)):
        (x_mm, y_mm, target_um), (end_x_mm, end_y_mm, _) = first.places[n], last.places[n]
        found.append(TouchPoint(keys[n], x_mm, y_mm, target_um, first.achieved_um[n], end_x_mm, end_y_mm))
    return tuple(found)
