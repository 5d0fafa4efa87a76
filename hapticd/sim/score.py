"""Score of a run: amplitude at each finger's true position, from the plate's true motion.

    leak        RMS |W_i| of the fingers with target 0
    slip error  RMS (|W_i| - a_i) of the others
    slip        mean |W_i| / a_i of the others

    contact leak, contact slip   the same fingers' RMS amplitude over the contact, an ellipse, not at its centre
    contrast                     contact slip / contact leak
    error                        a finger's friction, the mean over its contact, over what was asked, minus 1, in just
                                 noticeable differences (JND), Weber fractions: its mean is the bias
    felt, within two             share of time in which no finger's error is beyond one or two JND, either way
    limit                        the largest true amplitude of a driven mode over its limit W_LIM

A target in um asks for the friction that this amplitude gives the person who touches when it is the same all over the
contact; a target that is a friction asks for that, whoever touches.

A finger counts from 0.1 s after it landed or its target changed: the system cannot respond earlier.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from ..core.friction import DEFAULT_FRICTION_CURVE, FrictionCurve
from ..values import WEBER_FRAC, ComplexArray, FloatArray

AmplitudeGains = Callable[[FloatArray, FloatArray], FloatArray]  # as `world_errors.WorldErrors.amplitude_gains`

SETTLE_S = 0.1
CONTACT_RADIUS_MM = 5.0  # a fingertip at 0.2 .. 1 N covers 50 .. 150 mm2
_RINGS, _SPOKES = 6, 20  # of a contact's points: 4 and 12 err by 0.14 JND (RMS) where friction has cusps, these by 0.03
_EVERY_TICKS = 4  # of the contacts' history
_AT_ONCE = 4000  # instants evaluated together


class TrueContact(Protocol):
    """A finger's contact, as `fingers.fingertip.Fingertip`."""

    def ellipses_mm(self, t_s: FloatArray) -> FloatArray:
        """Return the symmetric matrices (T,2,2) that make the contact of the unit disc."""


@dataclass(frozen=True, slots=True)
class FingerFriction:
    """Friction of one finger while it counted, NaN if it never did: its error's mean, the median of its size and what
    that is below for 95 % of the time, and the shares of time within one and two just noticeable differences."""

    bias_jnd: float
    median_jnd: float
    error_95_jnd: float
    felt_frac: float
    within_two_frac: float


@dataclass(frozen=True, slots=True)
class Score:
    """Figures of one run; NaN where no finger contributes. `fingers` are in the order of the run's arrays."""

    leak_um: float
    slip_error_um: float
    slip_frac: float
    limited_frac: float
    largest_reference_um: float
    contact_leak_um: float
    contact_slip_um: float
    contrast: float
    felt_frac: float
    within_two_frac: float
    limit_frac: float
    fingers: tuple[FingerFriction, ...]


def score(
    t_s: FloatArray,
    finger_mm: FloatArray,
    target_um: FloatArray,
    truth_um: ComplexArray,
    plate_um: ComplexArray,
    shapes: Callable[[FloatArray], FloatArray],
    *,
    reference_um: ComplexArray,
    limited: npt.NDArray[np.bool_],
    limit_frac: float = math.nan,
    every: int = _EVERY_TICKS,
    curve: FrictionCurve = DEFAULT_FRICTION_CURVE,
    fingertips: Sequence[TrueContact] | None = None,
    gains: AmplitudeGains | None = None,
    friction_targets: bool = False,
) -> Score:
    """Score a run: t_s (T,), finger_mm (T,N,2), target_um and truth_um (T,N), NaN where a finger is absent,
    reference_um (T,M), plate_um (T,P) of all modes, whose `shapes` are true; `fingertips` (N,), without them discs of
    CONTACT_RADIUS_MM. A friction takes `gains` times the amplitude that it takes by `curve`. With `friction_targets`
    that of `target_um` by the built-in curve is asked."""
    counts, finger_um = settled(t_s, target_um), np.abs(truth_um)
    still, slipping = counts & (target_um == 0), counts & (target_um > 0)
    points = {
        "leak_um": rms(finger_um[still]),
        "slip_error_um": rms(finger_um[slipping] - target_um[slipping]),
        "slip_frac": float(np.mean(finger_um[slipping] / target_um[slipping])) if slipping.any() else math.nan,
        "limited_frac": float(np.mean(limited)) if limited.size else math.nan,
        "largest_reference_um": float(np.abs(reference_um).max(initial=0.0)),
        "limit_frac": limit_frac,
    }
    part = slice(None, None, every)
    counts, still, slipping = counts[part], still[part], slipping[part]
    t_s, target_um, finger_mm, plate_um = t_s[part], target_um[part], finger_mm[part], plate_um[part]
    needed = needed_gains(t_s, finger_mm, curve, gains)
    ellipses = None if fingertips is None else ellipses_mm(fingertips, t_s)
    rms_um, got = felt(finger_mm, plate_um, shapes, curve, needed, ellipses)
    leak_um, slip_um = rms(rms_um[still]), rms(rms_um[slipping])
    asked = curve.frictions(target_um / needed)
    if friction_targets:
        asked = DEFAULT_FRICTION_CURVE.frictions(target_um)
    errors_jnd = (got / asked - 1.0) / WEBER_FRAC
    return Score(
        **points,
        contact_leak_um=leak_um,
        contact_slip_um=slip_um,
        contrast=slip_um / leak_um if leak_um > 0.0 else math.nan,
        felt_frac=_within_frac(errors_jnd, counts, 1.0),
        within_two_frac=_within_frac(errors_jnd, counts, 2.0),
        fingers=tuple(_friction(errors_jnd[:, n : n + 1], counts[:, n : n + 1]) for n in range(errors_jnd.shape[1])),
    )


def _friction(errors_jnd: FloatArray, counts: npt.NDArray[np.bool_]) -> FingerFriction:
    counted_jnd = errors_jnd[counts]
    if not counted_jnd.size:
        return FingerFriction(*[math.nan] * 5)
    middle_jnd, most_jnd = np.quantile(np.abs(counted_jnd), (0.5, 0.95))
    within = [_within_frac(errors_jnd, counts, most) for most in (1.0, 2.0)]
    return FingerFriction(float(np.mean(counted_jnd)), float(middle_jnd), float(most_jnd), *within)


def _within_frac(errors_jnd: FloatArray, counts: npt.NDArray[np.bool_], most_jnd: float) -> float:
    """Return the share of time in which all fingers that count are within this error."""
    is_judged = np.asarray(counts.any(axis=1))
    is_wrong = np.asarray((counts & ~(np.abs(errors_jnd) <= most_jnd)).any(axis=1))
    return 1.0 - float(np.mean(is_wrong[is_judged])) if is_judged.any() else math.nan


def needed_gains(
    t_s: FloatArray, finger_mm: FloatArray, curve: FrictionCurve, gains: AmplitudeGains | None = None
) -> FloatArray:
    """Return by how much more amplitude than at rest by the curve each finger (T,N) needs for the same friction."""
    sliding_mm_s = np.nan_to_num(speeds_mm_s(t_s, finger_mm))
    of_speed = 1.0 + sliding_mm_s / curve.speed_mm_s
    return of_speed if gains is None else of_speed * gains(t_s, sliding_mm_s)


def speeds_mm_s(t_s: FloatArray, finger_mm: FloatArray) -> FloatArray:
    """Return how fast each finger slides (T,N); NaN while absent."""
    if len(t_s) < 2:
        return np.zeros(finger_mm.shape[:2])
    return np.asarray(np.linalg.norm(np.gradient(finger_mm, t_s, axis=0), axis=2))


def felt(
    finger_mm: FloatArray,
    plate_um: ComplexArray,
    shapes: Callable[[FloatArray], FloatArray],
    curve: FrictionCurve = DEFAULT_FRICTION_CURVE,
    gains: FloatArray | None = None,
    ellipses: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return over each contact (T,N) the RMS amplitude, and the mean friction relative to bare glass; NaN if absent.

    A friction takes `gains` (T,N) times the amplitude that it takes by the curve. `ellipses` (T,N,2,2) in mm make the
    contacts of the unit disc; without them they are discs of CONTACT_RADIUS_MM.
    """
    rms_um, got = np.full(finger_mm.shape[:2], np.nan), np.full(finger_mm.shape[:2], np.nan)
    if gains is None:
        gains = np.ones(finger_mm.shape[:2])
    points, weights = disc(CONTACT_RADIUS_MM if ellipses is None else 1.0)
    for start in range(0, len(finger_mm), _AT_ONCE):
        when = slice(start, start + _AT_ONCE)
        for finger in range(finger_mm.shape[1]):
            offsets_mm = points if ellipses is None else np.einsum("tij,qj->tqi", ellipses[when, finger], points)
            phi = shapes(finger_mm[when, finger, None] + offsets_mm)
            w_um = np.abs(np.einsum("tqp,tp->tq", phi, plate_um[when]))
            rms_um[when, finger] = np.sqrt(w_um**2 @ weights)
            got[when, finger] = curve.frictions(w_um / gains[when, finger, None]) @ weights
    is_absent = ~np.isfinite(finger_mm).all(axis=2)
    rms_um[is_absent] = got[is_absent] = np.nan
    return rms_um, got


def ellipses_mm(fingertips: Sequence[TrueContact], t_s: FloatArray) -> FloatArray:
    """Return the matrices (T,N,2,2) that make the contacts of the unit disc."""
    each = [tip.ellipses_mm(t_s) for tip in fingertips]
    return np.reshape(each, (len(fingertips), len(t_s), 2, 2)).swapaxes(0, 1)


def disc(radius_mm: float) -> tuple[FloatArray, FloatArray]:
    """Return points (Q,2) of a disc about 0 and their weights, of sum 1: Gauss's rule along the radius squared, the
    rings turned against each other."""
    node, weight = np.polynomial.legendre.leggauss(_RINGS)
    ring_mm = radius_mm * np.sqrt((node + 1.0) / 2.0)
    turns = 2.0 * np.pi * (np.arange(_SPOKES) + 0.5 * (np.arange(_RINGS)[:, None] % 2)) / _SPOKES
    points = ring_mm[:, None, None] * np.stack((np.cos(turns), np.sin(turns)), axis=-1)
    return points.reshape(-1, 2), np.repeat(weight / 2.0 / _SPOKES, _SPOKES)


def settled(t_s: FloatArray, target_um: FloatArray) -> npt.NDArray[np.bool_]:
    """Return where a finger counts (T,N): its target was constant for the last SETTLE_S."""
    if len(t_s) < 2:
        return np.zeros(target_um.shape, dtype=bool)
    steps = round(SETTLE_S / (t_s[1] - t_s[0]))
    changed = np.ones(target_um.shape, dtype=bool)
    changed[1:] = target_um[1:] != target_um[:-1]  # NaN differs from itself, so an absent finger never settles
    ticks = np.arange(len(t_s))[:, None]
    since = ticks - np.maximum.accumulate(np.where(changed, ticks, 0), axis=0)
    return np.asarray((since >= steps) & np.isfinite(target_um))


def rms(values: npt.ArrayLike) -> float:
    """Return the root of the mean square of real or complex values; NaN where there is none."""
    sizes = np.abs(values)
    return float(np.sqrt(np.mean(sizes**2))) if sizes.size else math.nan
