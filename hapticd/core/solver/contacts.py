"""Fingertips as discs: modal amplitudes that give each whole contact its vibration.

What counts is friction as felt, F(r), the plate's friction curve. With r_i the RMS over contact i
(`plate.contact`) that is to be expected, and its target a_i, this sum is least within the limits |W_k| <= L_k:

    sum_i importance(a_i) sqrt((F(r_i) - F(a_i))^2 + JUST_FELT^2)  +  stay |W - W_before|^2

expected     r_i^2 = W^H G_i W + UNCERTAIN_FRAC^2 sum_k G_i,kk |W_k|^2: each mode errs by a share of its amplitude, by
             map, gain and sensor together.
importance   the error of a finger that should stick counts STILL_IMPORTANCE times, that of one at FULL_UM and above
             once; targets between pass from one to the other without a step. What is asked of the plate sets it: the
             slippery finger keeps 0.75 um on the fingertip plate with four modes, and the sticky one gets the rest.
             By Weber's law, in differences that are just felt, the slippery one's error would count 4 times: a contrast
             of 4.4 for perfect knowledge on the bare plate, and of 8.7 where both count alike (decision 10).
JUST_FELT    the least change that is felt (Weber) where friction is lowest: smaller errors count by their squares.
stay         keeps the reference from turning faster than the plate follows, where directions are nearly equal.

Errors count by their size, not by their squares: squares give most to the slippery finger that is farthest from its
target because the voltage ends, and take it from the sticky one where each step costs most.

Once a call each error is replaced by weight (r - a)^2 / 2 of the same slope at the present r (iteratively reweighted
least squares: P. W. Holland and R. E. Welsch, Communications in Statistics A 6, 1977). Phases are free: W is complex,
X = Re(W W^H) is any matrix of rank 2, and in X the problem is convex but for the rank. That is why a descent from the
present amplitudes stays near the best (within 2 % of the best of many starts on four modes) and changes continuously
with the fingers; it never flips. From r_i >= Re(u_i^H W), with u_i = G_i W / r_i at the present W, each r_i a_i is
replaced by a linear term, so that a sweep over the modes, each moved to its best, or PAST_FRAC past it, and into its
limit, never raises the sum (over-relaxation: D. M. Young, Trans. AMS 76, 1954). One sweep costs O(N M^2) and is exact
within limits at any time.
"""

from __future__ import annotations

import math
from typing import Final

from ...values import WEBER_FRAC
from ..friction import DEFAULT_FRICTION_CURVE, FrictionCurve
from ..phasors import SAFE, ModeRow
from ..plate.contact import Gram

FULL_UM: Final = 1.0  # beyond this friction is nearly as low as it gets: its slope stays, so that more is still more
FULL_FRAC: Final = 0.5  # of the amplitude at which the curve ends, where that is less than FULL_UM
STILL_IMPORTANCE: Final = 4.5  # what leaves the other finger 0.75 um
NEAR_UM: Final = 1e-6  # of a target: the difference of frictions is rounding there
UNCERTAIN_FRAC: Final = 0.01  # of a mode's amplitude: map, gain and sensor together
STAY_FRAC: Final = 0.03  # of the mean curvature; 0.1 costs 3 % of the slipping finger's share, 0.01 doubles the steps
SWEEPS: Final = 6  # of a call
COLD_CALLS: Final = 12  # as many descents from rest
PAST_FRAC: Final = 0.2  # 6 sweeps then come as near to the least as 8 without; 0.4 turns modes by up to 1.1 um a call
LEAST_SHARE: Final = 1e-3  # of a target: a finger that gets less has no direction of its own yet
NEAR_FRAC: Final = 0.999  # of the square of a step: below it rounding decides nothing
MISSED_FRAC: Final = 0.01  # of a target: more than this counts as limited
COLD_TURN_RAD: Final = 2.4  # from mode to mode at the start: no pattern of signs is preferred


class _Mode:
    """One mode's amplitude, and the pull on it: attributes, which are plain doubles as machine code."""

    __slots__ = ("along_d", "along_q", "d_um", "limit_um", "pull_d", "pull_q", "q_um", "stay_d", "stay_q")

    def __init__(self, d_um: float, q_um: float, limit_um: float) -> None:
        self.d_um, self.q_um, self.limit_um = d_um, q_um, limit_um
        self.stay_d = self.stay_q = self.pull_d = self.pull_q = self.along_d = self.along_q = 0.0


class FeltError:
    """What a contact adds to the sum that is least, by a friction curve: its error of friction, relative to bare glass.

    `stretch` is by how much more amplitude a sliding finger needs than one at rest.
    """

    def __init__(self, curve: FrictionCurve) -> None:
        self._curve = curve
        self.full_um: Final = min(FULL_UM, FULL_FRAC * curve.full_um)
        self._full_friction: Final = curve.friction(self.full_um)
        self._full_decay_um: Final = curve.decay_um(self.full_um)
        self.just_felt: Final = WEBER_FRAC * self._full_friction

    def error(self, rms_um: float, target_um: float, stretch: float = 1.0) -> float:
        """Return the error, times its importance."""
        off = self._friction(rms_um / stretch) - self._friction(target_um / stretch)
        return self.importance(target_um / stretch) * math.hypot(off, self.just_felt)

    def weight(self, rms_um: float, target_um: float, stretch: float = 1.0) -> float:
        """Return the weight, in 1/um^2, with which weight (r - a)^2 / 2 has the slope of `error` at r."""
        rms_um, target_um = rms_um / stretch, target_um / stretch
        off_um, error = target_um - rms_um, self._friction(rms_um) - self._friction(target_um)
        at_um = min(rms_um, self.full_um)
        slope_1_um = self._friction(at_um) / self._curve.decay_um(at_um)
        secant_1_um = error / off_um if abs(off_um) > NEAR_UM else slope_1_um
        weight = self.importance(target_um) * slope_1_um * secant_1_um / math.hypot(error, self.just_felt)
        return weight / (stretch * stretch)

    def importance(self, target_um: float) -> float:
        """Return how much a finger's error counts: STILL_IMPORTANCE at 0, 1 from `full_um` on."""
        return STILL_IMPORTANCE + (1.0 - STILL_IMPORTANCE) * min(target_um / self.full_um, 1.0)

    def _friction(self, amplitude_um: float) -> float:
        """Return friction relative to bare glass; beyond `full_um` it goes on straight."""
        if amplitude_um <= self.full_um:
            return self._curve.friction(amplitude_um)
        return self._full_friction * (1.0 - (amplitude_um - self.full_um) / self._full_decay_um)


BUILT_IN: Final = FeltError(DEFAULT_FRICTION_CURVE)


def solve_contacts(
    grams: list[Gram],
    targets_um: ModeRow,
    limits_um: ModeRow,
    d_um: list[float],
    q_um: list[float],
    felt: FeltError = BUILT_IN,
    stretches: list[float] | None = None,
) -> tuple[list[float], bool]:
    """Move W (M,), given in its parts, to where the sum is least; return each contact's RMS (N,), and `limited`.

    `stretches` (N,) are those of sliding fingers (`FeltError`), 1 if not given. Without a slipping finger W becomes 0.
    If W is 0, the search starts from all modes alike.
    """
    count = len(limits_um)
    if not is_any_slippery(targets_um):
        for k in range(count):
            d_um[k] = q_um[k] = 0.0
        return [0.0] * len(targets_um), False
    is_cold = True
    for k in range(count):
        is_cold = is_cold and d_um[k] == 0.0 and q_um[k] == 0.0
    if is_cold:
        for k in range(count):
            start_um, turn_rad = min(limits_um[k], max(targets_um)), COLD_TURN_RAD * k
            d_um[k], q_um[k] = start_um * math.cos(turn_rad), start_um * math.sin(turn_rad)
    modes = [_Mode(d_um[k], q_um[k], limits_um[k]) for k in range(count)]
    for _ in range(COLD_CALLS if is_cold else 1):
        _descend(grams, targets_um, modes, felt, stretches, 0.0 if is_cold else STAY_FRAC)
    for k in range(count):
        d_um[k], q_um[k] = modes[k].d_um, modes[k].q_um
    achieved_um = [contact_rms_um(gram, d_um, q_um) for gram in grams]
    return achieved_um, _is_limited(achieved_um, targets_um, limits_um, d_um, q_um)


def _descend(
    grams: list[Gram],
    targets_um: ModeRow,
    modes: list[_Mode],
    felt: FeltError,
    stretches: list[float] | None,
    stay_frac: float,
) -> None:
    """Weigh the errors as they are, then sweep over the modes."""
    weights = []
    for finger in range(len(grams)):
        rms_um = _along(grams[finger], modes)
        stretch = 1.0 if stretches is None else stretches[finger]
        weights.append(felt.weight(rms_um if rms_um < SAFE else SAFE, targets_um[finger], stretch))
    curvature = _curvature(grams, weights)
    mean = 0.0
    for k in range(len(modes)):
        mean += curvature[k][k] / len(modes)
    stay = stay_frac * mean
    for k in range(len(modes)):
        curvature[k][k] += UNCERTAIN_FRAC * UNCERTAIN_FRAC * curvature[k][k] + stay
    for mode in modes:
        mode.stay_d, mode.stay_q = stay * mode.d_um, stay * mode.q_um
    for _ in range(SWEEPS):
        for mode in modes:
            mode.pull_d, mode.pull_q = mode.stay_d, mode.stay_q
        for finger in range(len(grams)):
            if targets_um[finger] > 0.0:
                _pull(grams[finger], targets_um[finger], weights[finger], modes)
        _sweep(curvature, modes)


def step_towards(
    before_d_um: list[float], before_q_um: list[float], d_um: list[float], q_um: list[float], most_um: float
) -> bool:
    """Shorten the way of W from before to at most `most_um` in any mode; return whether it was longer.

    Limits hold on the whole way, because they are discs; a pattern that begins at rest keeps its contrast.
    """
    largest_um, near_um2, is_near = 0.0, NEAR_FRAC * most_um * most_um, True
    for k in range(len(d_um)):  # mostly; a call of `hypot` takes ten times as long
        step_d_um, step_q_um = d_um[k] - before_d_um[k], q_um[k] - before_q_um[k]
        is_near = is_near and step_d_um * step_d_um + step_q_um * step_q_um < near_um2
    if is_near:
        return False
    for k in range(len(d_um)):
        largest_um = max(largest_um, math.hypot(d_um[k] - before_d_um[k], q_um[k] - before_q_um[k]))
    if largest_um <= most_um:
        return False
    share = most_um / largest_um
    for k in range(len(d_um)):
        d_um[k] = before_d_um[k] + share * (d_um[k] - before_d_um[k])
        q_um[k] = before_q_um[k] + share * (q_um[k] - before_q_um[k])
    return True


def is_any_slippery(targets_um: tuple[float, ...]) -> bool:
    """Return whether some finger's target is above 0."""
    is_any = False
    for target_um in targets_um:
        is_any = is_any or target_um > 0.0
    return is_any


def contact_rms_um(gram: Gram, d_um: list[float], q_um: list[float]) -> float:
    """Return sqrt(W^H G W): the RMS amplitude over a contact."""
    square = 0.0
    for k in range(len(gram)):
        row = gram[k]
        along_d = along_q = 0.0
        for other in range(len(row)):
            along_d += row[other] * d_um[other]
            along_q += row[other] * q_um[other]
        square += d_um[k] * along_d + q_um[k] * along_q
    return math.sqrt(max(square, 0.0))


def _curvature(grams: list[Gram], weights: list[float]) -> Gram:
    """Return the sum of the contacts' Gram matrices, weighted."""
    count = len(grams[0])
    total = [[0.0] * count for _ in range(count)]
    for k in range(count):
        for other in range(k, count):
            entry = 0.0
            for finger in range(len(grams)):
                entry += weights[finger] * grams[finger][k][other]
            total[k][other] = total[other][k] = entry
    return total


def _along(gram: Gram, modes: list[_Mode]) -> float:
    """Set each mode's part of G W, with the uncertainty in it, and return the RMS over the contact that is expected."""
    square = 0.0
    for k in range(len(modes)):
        row, mode = gram[k], modes[k]
        uncertain = UNCERTAIN_FRAC * UNCERTAIN_FRAC * row[k]
        along_d, along_q = uncertain * mode.d_um, uncertain * mode.q_um
        for index in range(len(modes)):
            share, other = row[index], modes[index]
            along_d += share * other.d_um
            along_q += share * other.q_um
        mode.along_d, mode.along_q = along_d, along_q
        square += mode.d_um * along_d + mode.q_um * along_q
    return math.sqrt(max(square, 0.0))


def _pull(gram: Gram, target_um: float, weight: float, modes: list[_Mode]) -> None:
    """Add weight a G W / r: the slope of what the finger's target asks for, at the present W."""
    rms_um = _along(gram, modes)
    if rms_um > LEAST_SHARE * target_um:
        scale = weight * target_um / rms_um
        for mode in modes:
            mode.pull_d += scale * mode.along_d
            mode.pull_q += scale * mode.along_q
        return
    for k in range(len(modes)):  # W gives it nothing: from rest it may follow any of its modes
        modes[k].pull_d += weight * target_um * math.sqrt(max(gram[k][k], 0.0))


def _sweep(curvature: Gram, modes: list[_Mode]) -> None:
    """Move each mode in turn past where the sum is least with the others held, and into its limit."""
    for k in range(len(modes)):
        row, mode = curvature[k], modes[k]
        own = row[k]
        if not own > 0.0:  # no finger feels this mode
            mode.d_um = mode.q_um = 0.0
            continue
        rest_d, rest_q = mode.pull_d, mode.pull_q
        for index in range(len(modes)):
            share, other = row[index], modes[index]
            rest_d -= share * other.d_um
            rest_q -= share * other.q_um
        w_d_um, w_q_um = mode.d_um + (1.0 + PAST_FRAC) * (rest_d / own), mode.q_um + (1.0 + PAST_FRAC) * (rest_q / own)
        square = w_d_um * w_d_um + w_q_um * w_q_um
        limit_um = mode.limit_um
        if not square < SAFE * SAFE:  # shapes whose products leave the range of floats
            w_d_um = w_q_um = 0.0
        elif square > limit_um * limit_um:
            share = limit_um / math.sqrt(square)
            w_d_um, w_q_um = w_d_um * share, w_q_um * share
        mode.d_um, mode.q_um = w_d_um, w_q_um


def _is_limited(
    achieved_um: list[float], targets_um: ModeRow, limits_um: ModeRow, d_um: list[float], q_um: list[float]
) -> bool:
    """Whether some mode is at its limit while a finger misses its target."""
    is_short = False
    for finger in range(len(targets_um)):
        is_short = is_short or achieved_um[finger] < (1.0 - MISSED_FRAC) * targets_um[finger]
    if not is_short:
        return False
    for k in range(len(limits_um)):
        if d_um[k] * d_um[k] + q_um[k] * q_um[k] >= (1.0 - MISSED_FRAC) * limits_um[k] * limits_um[k]:
            return True
    return False
