"""The plate at one instant: the fingers' places and targets, and the modal amplitudes that serve them.

Fingers are contacts, or points where the contact's radius is 0. Friction is convex in amplitude: a contact whose RMS is
as asked feels stickier, the more so the less even the vibration is. So what counts is its mean over the contact. With F
the friction curve, phi_q the shapes at the contact's points q, c_q their weights, and F_i* the friction that the
finger's target has when it is the same all over the contact,

    u_i = (F_i - F_i*) / (WEBER_FRAC F_i*),    F_i = sum_q c_q F(r_q)
    r_q^2 = |phi_q W|^2 + uncertain_frac^2 sum_k |phi_qk W_k|^2

are the errors, and max |u_i| is least within |W_k| <= L_k. r_q is what is to be expected: each mode errs by a share of
its amplitude, by map and sensor together. Where not all can be had, the error of a finger that should stick
counts in full, and of any other at most MOST_SLIPPERY of a just noticeable difference: the sticky one is as asked, and
the others get what is left. Priorities come before that: of a finger whose priority is lower than another's, less
counts (`counted_jnd`).

Each iteration

1.  weighs the fingers: the logarithm of alpha_i moves by RATE towards that of |u_i|, less the mean over the fingers
    (multiplicative weights: S. Arora, E. Hazan and S. Kale, Theory of Computing 8, 2012). Below one JND a sticky
    finger's error counts by its square: the slippery one's grows more where places are predicted wrong;
2.  replaces sum alpha_i |F_i - F_i*| by a sum of squares, point by point, that has its slope at the present W. A sticky
    finger's points are pulled to 0, as |r| is (iteratively reweighted least squares); another's to r plus the change
    that would make F_i right if all points changed alike, and in part to the contact's mean, the less the larger u_i
    is: an even vibration is felt at wrong places too (`even_frac`, less on a fast pad). Over the frictions TO_ZERO one
    passes into the other, within what is felt;
3.  sweeps over the modes, each moved to its best, or PAST_FRAC past it, and into its limit (over-relaxation:
    D. M. Young, Trans. AMS 76, 1954).

It starts from the last W and the last weights, so W follows the fingers continuously: phases are free and nothing
flips. From there it stays near the best of many starts (`hapticd bench felt`). `felt_descent.c` is the iteration.

The paper's case, two fingers as points on two modes, one slipping, one still, has a closed form (`hold_still`).
W lies on the line (phi_Y, -phi_X) of the still finger, limited along it (paper, section IV.B): it gets 0. Of the
line's two sides that of the present amplitudes is taken, or their phase. All is scaled down where amplitude costs the
still finger more than it gives the other, near singular positions:

    price   a position is never known to better than a tenth of a millimetre. Of an error e the still finger feels
            e |grad w|, although w is exactly zero at the predicted position. Of all amplitudes that give the slipping
            finger the same mean, those cost the least whose share of the target is in proportion to |grad w|^2.
    slew    where the still finger crosses a common node of the modes any amplitudes are zero there, and those that
            stay so change sign at once. Zero all the way takes |dW/dP| >= |grad w| / |phi|, um per mm of its way.
"""

from __future__ import annotations

import math
from array import array
from struct import Struct
from typing import Final

import numpy as np
from mypy_extensions import mypyc_attr

from ...values import FloatArray
from ..friction import DEFAULT_FRICTION_CURVE, FrictionCurve
from ..phasors import Phasors
from ..plate.bicubic import POINT
from ..plate.contact import SOLVED_DISC, Ellipses
from ..plate.mode_shapes import ModeShapes
from ..plate.splines import evaluate
from .felt_descent import EVEN_FRAC, UNCERTAIN_FRAC, descend

Pair = tuple[float, float]
AskedPlace = tuple[float, float, float]  # x_mm, y_mm and target_um: where a finger is, and what it should feel there

_Asked = tuple[FrictionCurve, list[float], list[float], list[int]]  # targets in um, gains with speed, priorities

ITERATIONS: Final = 7  # of a call
FIRST: Final = (0.7, 0.9)  # frictions from which on errors count in full where not all can be had: in part, altogether
MOST_SLIPPERY: Final = 0.8  # of a just noticeable difference: as much of a slippery finger's error counts
MOST_LOWER: Final = 0.7  # of what counts one priority above: in six calls 48 % of places are felt, with 0.8 36 %
TO_ZERO: Final = (0.9, 0.97)  # frictions from which on a finger's points are pulled to 0, in part and altogether
SLEW_UM_NS: Final = 0.5e-6  # what the plate follows: 2 um in 4 ms; landing and lifting turn amplitudes at this speed
LEAST_STEP_UM: Final = 1.0  # from one frame to the next: what a report may tell of a finger in motion
WIRE_FRAC: Final = 1.0 - 2.0**-22  # of a limit: rounding both parts to 32 bits may lengthen a phasor by the rest
NOISE: Final = 8 * 2.0**-52  # a sum of products below this share of its terms is rounding, not signal
SAFE: Final = 1e100  # squares of larger numbers, or of their inverses, leave the range of floats
DERATING_MM2_UM2: Final = 5.0  # least share of its target for a slipping finger, per slope of 1 um/mm under a still one
STEEPEST_UM_MM: Final = 4.0  # of the reference along a still finger's way: a step of 1.5 um from knot to knot
LEAST_SHARE: Final = 0.3  # a share falls to 0 and rises again within a knot or two: following it fully makes steps
_PLACE: Final = Struct("6d")  # of two modes at a point: shape, and its derivatives along x and y


class FingerTargets:
    """The fingers at one instant: places with targets, and the gain of the amplitude that each needs as it slides."""

    def __init__(self, places: list[AskedPlace], speed_gains: list[float]) -> None:
        self.places: Final = places
        self.speed_gains: Final = speed_gains


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


@mypyc_attr(allow_interpreted_subclasses=True)  # the paper's, in the simulation
class InstantSolver:
    """Solver of one plate.

    `contact_radius_mm`: fingers are discs of it where their ellipses are not known, points if it is 0; `friction_curve`
    is what they feel; `uncertain_frac` is the relative standard deviation of a mode's amplitude. `derates`:
    amplitude gives way in the paper's case.
    """

    def __init__(
        self,
        modes: ModeShapes,
        w_limit_um: tuple[float, ...],
        *,
        contact_radius_mm: float = 0.0,
        friction_curve: FrictionCurve = DEFAULT_FRICTION_CURVE,
        uncertain_frac: float = UNCERTAIN_FRAC,
        derates: bool = True,
    ) -> None:
        self._most_um: Final = np.array(w_limit_um) * WIRE_FRAC
        self.limits_um = self._most_um
        self.contact_radius_mm: Final = contact_radius_mm
        self.has_contacts: Final = contact_radius_mm > 0.0
        self.curve = friction_curve
        self.uncertain_frac: Final = uncertain_frac
        self.even_frac = EVEN_FRAC
        self._modes: Final = modes
        self._w_limit_um: Final = w_limit_um
        self._disc: Final = np.array(SOLVED_DISC) if self.has_contacts else POINT
        self._weights: Final = self._disc[:, 2].copy()
        self._derates: Final = derates
        self._asked: _Asked = friction_curve, [], [], []
        self._table = finger_table(friction_curve, [], [], [], [])  # of those fingers, with the weights that they have

    def hold(self, holdable_frac: tuple[float, ...]) -> None:
        """Leave each mode what the voltage holds of its limit; to the paper's case the board's one factor does it."""
        self.limits_um = self._most_um * np.array(holdable_frac)

    def solve(
        self,
        places: list[AskedPlace],
        previous_um: Phasors,
        since_ns: int,
        speed_gains: list[float] | None = None,
        priorities: list[int] | None = None,
        ellipses: Ellipses = None,
    ) -> ModalSolution:
        """The solution at one instant, `since_ns` after the amplitudes `previous_um` (M,); see `along`."""
        asked = FingerTargets(places, speed_gains or [1.0] * len(places))
        return self.along([asked], [since_ns], previous_um, priorities or [0] * len(places), ellipses)[0]

    def along(
        self, asked: list[FingerTargets], since_ns: list[int], w_um: Phasors, ranks: list[int], ellipses: Ellipses
    ) -> list[ModalSolution]:
        """The solutions at a frame's instants, each `since_ns` after the one before, which it continues, as the first
        does `w_um` (M,). Without a slipping finger the amplitudes are 0; no mode moves by more than the plate follows,
        so that a pattern that begins from silence keeps its contrast. `ranks` (N,) are the fingers' priorities."""
        if not self.has_contacts:
            points: list[ModalSolution] = []
            for at in asked:
                two = self._solve_two(at.places, w_um)
                points += [two] if two else self._descended([at], [math.inf], w_um, ranks, None)
                w_um = points[-1].modal_um
            return points
        steps_um = [LEAST_STEP_UM + SLEW_UM_NS * span_ns for span_ns in since_ns]
        return self._descended(asked, steps_um, w_um, ranks, ellipses)

    def _descended(
        self, asked: list[FingerTargets], steps_um: list[float], w_um: Phasors, ranks: list[int], ellipses: Ellipses
    ) -> list[ModalSolution]:
        fingers, table, places = len(ranks), array("d"), list[AskedPlace]()
        for at in asked:
            key = self.curve, [target_um for _, _, target_um in at.places], at.speed_gains, ranks
            if key != self._asked:
                had = self._table.tolist()
                log_weights = had[5 * fingers : 6 * fingers] if len(had) == 8 * fingers else [0.0] * fingers
                self._asked, self._table = key, finger_table(self.curve, key[1], log_weights, key[2], ranks)
            table += self._table
            places += at.places
        contacts = self._modes.tables, self._disc, places, ellipses and ellipses * len(asked), self.contact_radius_mm
        given = contacts, self._weights, table, self.curve.table, self.limits_um, w_um, ITERATIONS, tuple(steps_um)
        solutions: list[ModalSolution] = []
        for modal_um, limited in descend(*given, self.uncertain_frac, self.even_frac):
            self._table = table[8 * fingers * len(solutions) : 8 * fingers * (len(solutions) + 1)]
            got_um = self._table[7 * fingers :].tolist()
            solutions.append(ModalSolution(asked[len(solutions)].places, got_um, modal_um, limited))
        return solutions

    def shapes(
        self, disc: FloatArray, places: list[AskedPlace], ellipses: Ellipses = None, *, has_slopes: bool = False
    ) -> bytes:
        """Return the shapes (N, Q, M), or with slopes, at each contact's points: a unit disc has these (Q, 3)."""
        return evaluate(self._modes.tables, disc, places, ellipses, self.contact_radius_mm, has_slopes)

    def _solve_two(self, places: list[AskedPlace], previous_um: Phasors) -> ModalSolution | None:
        """The paper's case; None for any other."""
        if not (len(places) == 2 == len(self._w_limit_um) and (places[0][2] > 0.0) is not (places[1][2] > 0.0)):
            return None
        moved, held = (0, 1) if places[0][2] > 0.0 else (1, 0)
        target_um = places[moved][2]
        at_points = self.shapes(POINT, [places[moved], places[held]], has_slopes=True)
        x, _, _, y, _, _ = _PLACE.unpack_from(at_points)
        other_x, x_dx, x_dy, other_y, y_dx, y_dy = _PLACE.unpack_from(at_points, _PLACE.size)
        slipping, still = (x, y), (other_x, other_y)
        if still == (0.0, 0.0):  # on a node of both modes: still, whatever they do
            return None
        limits_um = self._w_limit_um[0], self._w_limit_um[1]
        modal_um, phase, limited = hold_still(slipping, target_um, still, limits_um, (previous_um[0], previous_um[1]))
        if self._derates:
            share = min(1.0, abs(_along(slipping, modal_um)) / target_um) if limited else 1.0
            slope_um_mm = math.hypot(_along((x_dx, y_dx), modal_um), _along((x_dy, y_dy), modal_um))
            modal_um = derated(modal_um, share, still, slope_um_mm, limited=limited)
        got_um = [0.0, 0.0]
        got_um[moved], got_um[held] = abs(_along(slipping, modal_um)), abs(_along(still, modal_um))
        return ModalSolution(places, got_um, turned(modal_um, phase, limits_um), limited)


def _along(row: Pair, modal_um: Pair) -> float:
    return row[0] * modal_um[0] + row[1] * modal_um[1]


def finger_table(
    curve: FrictionCurve,
    targets_um: list[float],
    log_weights: list[float],
    speed_gains: list[float],
    priorities: list[int],
) -> array[float]:
    """Return what `descend` takes of fingers (8, N), see there."""
    frictions = [curve.friction(targets_um[n] / speed_gains[n]) for n in range(len(targets_um))]
    stickiness = [_between(friction, TO_ZERO) for friction in frictions]
    counted, answers = counted_jnd(frictions, priorities), [0.0] * (2 * len(targets_um))
    return array("d", targets_um + frictions + counted + stickiness + speed_gains + log_weights + answers)


def counted_jnd(frictions: list[float], priorities: list[int]) -> list[float]:
    """Return as much of each finger's error as counts, in just noticeable differences, for the targets' frictions and
    the fingers' priorities.

    Of each priority in use a share of what counts one above. Within the highest, where there are lower ones, the
    stickiest finger counts in full, however slippery it is.
    """
    slipperiness, least, counted = [1.0 - _between(friction, FIRST) for friction in frictions], 0.0, []
    in_use = sorted(set(priorities), reverse=True)
    if len(in_use) > 1:
        least = min([slipperiness[n] for n in range(len(frictions)) if priorities[n] == in_use[0]])
    for n in range(len(frictions)):
        rank, more = in_use.index(priorities[n]), slipperiness[n] - least
        if rank > 0:
            counted.append((1.0 - (1.0 - MOST_SLIPPERY) * slipperiness[n]) * MOST_LOWER**rank)
        else:
            counted.append(MOST_SLIPPERY / more if more > 0.0 else math.inf)
    return counted


def _between(friction: float, ends: tuple[float, float]) -> float:
    return min(max((friction - ends[0]) / (ends[1] - ends[0]), 0.0), 1.0)


# --- two fingers on two modes ---


def clamped(value: float, limit: float) -> float:
    """Clamp a value to +-limit; NaN becomes 0."""
    if -limit <= value <= limit:
        return value
    return math.copysign(limit, value) if value == value else 0.0


def hold_still(
    slipping: Pair, target: float, still: Pair, limits: Pair, previous: tuple[complex, complex]
) -> tuple[Pair, complex, bool]:
    """Return real W, the phase by which to turn it to the present amplitudes, and `limited`.

    The still finger must be on no common node. Zeros in `previous` leave sign and phase free. Shapes that are not
    finite give silence.
    """
    (x, y), (limit_x, limit_y) = still, limits
    is_first = abs(y) >= abs(x)  # the mode that moves more
    base, slope = (y, x) if is_first else (x, y)
    slope = -slope / base if 0.0 < abs(base) < math.inf else math.nan
    ux, uy = (1.0, slope) if is_first else (slope, 1.0)
    most, other = (limit_x, limit_y) if is_first else (limit_y, limit_x)
    top = other / abs(slope) if abs(slope) * most > other else most
    first, second = slipping[0] * ux, slipping[1] * uy
    gain = first + second
    size = abs(gain)
    if not NOISE * (abs(first) + abs(second)) < size < math.inf:
        return (0.0, 0.0), 1.0 + 0j, False
    requested = target / size
    t = requested if requested <= top else top
    lean, behind = (previous[0].real * ux + previous[1].real * uy), (previous[0].imag * ux + previous[1].imag * uy)
    phase, ahead = 1.0 + 0j, math.hypot(lean, behind)
    if behind != 0.0 and 0.0 < ahead < SAFE:
        phase = complex(lean / ahead, behind / ahead)
    elif lean < 0.0 or (lean == 0.0 and gain < 0.0):
        t = -t
    return (clamped(t * ux, limit_x), clamped(t * uy, limit_y)), phase, not requested <= top


def turned(modal: Pair, phase: complex, limits: Pair) -> tuple[complex, complex]:
    """Return real W turned by a phase, within the limits to the last bit."""
    if phase.imag == 0.0:
        return complex(modal[0], 0.0), complex(modal[1], 0.0)
    one, other, shave = modal[0] * phase, modal[1] * phase, 2.0**-53
    while abs(one) > limits[0] or abs(other) > limits[1]:  # both: the still finger stays still
        one, other, shave = one * (1.0 - shave), other * (1.0 - shave), 2.0 * shave
    return one, other


def derated(modal: Pair, share: float, still: Pair, slope_um_mm: float, *, limited: bool) -> Pair:
    """Return W scaled by 1 or less: `share` is what the slipping finger gets of its target; under the other one are the
    shapes `still`, and the amplitude's slope."""
    bound_um_mm, scale = STEEPEST_UM_MM * math.sqrt(still[0] * still[0] + still[1] * still[1]), 1.0
    if slope_um_mm > bound_um_mm:
        scale = bound_um_mm / slope_um_mm
    if limited:
        price, worth = DERATING_MM2_UM2 * slope_um_mm * slope_um_mm, math.hypot(share, LEAST_SHARE)
        if price > worth:
            scale = min(scale, worth / price)
    return modal if scale == 1.0 else (modal[0] * scale, modal[1] * scale)
