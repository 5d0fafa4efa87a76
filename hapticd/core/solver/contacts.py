"""Fingertips as discs: modal amplitudes that give each whole contact its vibration.

With r_i = sqrt(W^H G_i W), the RMS over contact i (`plate.contact`), and its target a_i, this sum is least within the
limits |W_k| <= L_k:

    sum_i weight(a_i) (r_i - a_i)^2  +  sum_k uncertainty_k |W_k|^2  +  stay |W - W_before|^2

weight       the error in friction, squared: friction falls as exp(-a / FRICTION_DECAY_UM), so that of two equal errors
             in um a finger that should stick feels more (17 times, squared, than one at 1 um). Targets between 0 and
             1 um pass from one to the other without a step.
uncertainty  what a mode's own relative error, UNCERTAIN_FRAC of its amplitude, leaves under all fingers.
stay         keeps the reference from turning faster than the plate follows, where directions are nearly equal.

Phases are free: W is complex, X = Re(W W^H) is any matrix of rank 2, and in X the problem is convex but for the rank.
That is why a descent from the present amplitudes stays near the best (within 1 % of the best of many starts on four
modes) and changes continuously with the fingers; it never flips. From r_i >= Re(u_i^H W), with u_i = G_i W / r_i at the
present W, each r_i a_i is replaced by a linear term, so that a sweep over the modes, each moved to its best, or
PAST_FRAC past it, and into its limit, never raises the sum (over-relaxation: D. M. Young, Trans. AMS 76, 1954). One
sweep costs O(N M^2) and is exact within limits at any time.
"""

from __future__ import annotations

import math
from typing import Final

from ..plate.contact import Gram
from .arithmetic import SAFE, Row

FRICTION_DECAY_UM: Final = 0.7  # Biet, Giraud and Lemaire-Semail 2007; the default friction curve's
FULL_UM: Final = 1.0  # beyond this the weight stays: friction is nearly as low as it gets
UNCERTAIN_FRAC: Final = 0.01  # of a mode's amplitude: map, gain and sensor together
STAY_FRAC: Final = 0.03  # of the mean curvature; 0.1 costs 3 % of the slipping finger's share, 0.01 doubles the steps
WARM_SWEEPS: Final = 6
COLD_SWEEPS: Final = 64
PAST_FRAC: Final = 0.2  # 6 sweeps then come as near to the least as 8 without; 0.4 turns modes by up to 1.1 um a call
LEAST_SHARE: Final = 1e-3  # of a target: a finger that gets less has no direction of its own yet
MISSED_FRAC: Final = 0.01  # of a target: more than this counts as limited
COLD_TURN_RAD: Final = 2.4  # from mode to mode at the start: no pattern of signs is preferred


class _Mode:
    """One mode's amplitude, and the pull on it: attributes, which are plain doubles as machine code."""

    __slots__ = ("along_d", "along_q", "d_um", "limit_um", "pull_d", "pull_q", "q_um", "stay_d", "stay_q")

    def __init__(self, d_um: float, q_um: float, limit_um: float) -> None:
        self.d_um, self.q_um, self.limit_um = d_um, q_um, limit_um
        self.stay_d = self.stay_q = self.pull_d = self.pull_q = self.along_d = self.along_q = 0.0


def solve_contacts(
    grams: list[Gram], targets_um: Row, limits_um: Row, d_um: list[float], q_um: list[float]
) -> tuple[list[float], bool]:
    """Move W (M,), given in its parts, to where the sum is least; return each contact's RMS (N,), and `limited`.

    Without a slipping finger W becomes 0. If W is 0, the search starts from all modes alike.
    """
    count = len(limits_um)
    if max(targets_um) <= 0.0:
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
    _descend(grams, targets_um, limits_um, d_um, q_um, is_cold)
    achieved_um = [contact_rms_um(gram, d_um, q_um) for gram in grams]
    return achieved_um, _is_limited(achieved_um, targets_um, limits_um, d_um, q_um)


def _descend(
    grams: list[Gram], targets_um: Row, limits_um: Row, d_um: list[float], q_um: list[float], is_cold: bool
) -> None:
    """Sweep over the modes, from rest as often as it takes, else near where they were."""
    count = len(limits_um)
    modes = [_Mode(d_um[k], q_um[k], limits_um[k]) for k in range(count)]
    weights = [math.exp(-2.0 * min(target_um, FULL_UM) / FRICTION_DECAY_UM) for target_um in targets_um]
    curvature = _curvature(grams, weights)
    mean = 0.0
    for k in range(count):
        mean += curvature[k][k] / count
    stay = 0.0 if is_cold else STAY_FRAC * mean
    for k in range(count):
        curvature[k][k] += UNCERTAIN_FRAC * UNCERTAIN_FRAC * curvature[k][k] + stay
    for mode in modes:
        mode.stay_d, mode.stay_q = stay * mode.d_um, stay * mode.q_um
    for _ in range(COLD_SWEEPS if is_cold else WARM_SWEEPS):
        for mode in modes:
            mode.pull_d, mode.pull_q = mode.stay_d, mode.stay_q
        for finger in range(len(grams)):
            if targets_um[finger] > 0.0:
                _pull(grams[finger], targets_um[finger], weights[finger], modes)
        _sweep(curvature, modes)
    for k in range(count):
        d_um[k], q_um[k] = modes[k].d_um, modes[k].q_um


def step_towards(
    before_d_um: list[float], before_q_um: list[float], d_um: list[float], q_um: list[float], most_um: float
) -> bool:
    """Shorten the way of W from before to at most `most_um` in any mode; return whether it was longer.

    Limits hold on the whole way, because they are discs; a pattern that begins at rest keeps its contrast.
    """
    largest_um = 0.0
    for k in range(len(d_um)):
        largest_um = max(largest_um, math.hypot(d_um[k] - before_d_um[k], q_um[k] - before_q_um[k]))
    if largest_um <= most_um:
        return False
    share = most_um / largest_um
    for k in range(len(d_um)):
        d_um[k] = before_d_um[k] + share * (d_um[k] - before_d_um[k])
        q_um[k] = before_q_um[k] + share * (q_um[k] - before_q_um[k])
    return True


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


def _pull(gram: Gram, target_um: float, weight: float, modes: list[_Mode]) -> None:
    """Add weight a G W / r: the slope of what the finger's target asks for, at the present W."""
    square = 0.0
    for k in range(len(modes)):
        row, mode = gram[k], modes[k]
        along_d = along_q = 0.0
        for index in range(len(modes)):
            share, other = row[index], modes[index]
            along_d += share * other.d_um
            along_q += share * other.q_um
        mode.along_d, mode.along_q = along_d, along_q
        square += mode.d_um * along_d + mode.q_um * along_q
    rms_um = math.sqrt(max(square, 0.0))
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
    achieved_um: list[float], targets_um: Row, limits_um: Row, d_um: list[float], q_um: list[float]
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
