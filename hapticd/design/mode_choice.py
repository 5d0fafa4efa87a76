"""Choice of a plate's drive and of the modes that it drives, from what a sweep and a scan show near it.

A plate that arrives is not the plate that was computed: its modes lie elsewhere and in another order. Of the sets of as
many modes as there are patches, those that the patches move most are compared by the share of random places at which
every contact is felt as asked (`felt_places`), each at the drive that takes least volts, the best at drives near.

Modes that stay undriven move all the same: patches push them, and fingers that brake the driven modes do. What patches
do in phase is a share of each driven mode, wherever the fingers are: it is *compensated*, as it is added to that mode's
shape, on which the daemon solves. The rest, in quadrature or by fingers, is unwanted motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from ..core.friction import DEFAULT_FRICTION_CURVE, FLOOR_FRAC, FrictionCurve
from ..values import ComplexArray, FloatArray
from .felt_places import ENOUGH_JND, PlateTouches, settle_felt
from .patch_places import BoolArray
from .patch_reach import PatchDrive, UndrivenError

Q_FACTOR = 500.0
RADIUS_MM = 5.0  # of a fingertip's contact at 0.2 .. 1 N (50 .. 150 mm2)
FARTHEST_HZ = 180.0  # of a driven mode from the drive: an amplifier reaches a sixth there; the firmware controls 300
STEP_HZ = 25.0  # of the drives tried, less than a mode's bandwidth of 58 Hz
SEED = 1
FINGER_KG_S = 10.9  # decay that a finger adds to a mode, per square of its shape, times the mass: 115 1/s on 95 g

SHARES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.18)  # of the reach alone
ALIKE_FRAC = 0.02  # of the places: of shares that differ by less the least is taken, which spares volts in motion
MOST_UM = 6.0  # of a mode: 95 % of places need less than 5, and the glass bears the sum of all
SEARCH_PLACES = 60

STRONGEST, BEST = 24, 3  # sets of modes that are compared by what is felt: with one share, with all and other drives
FEW_PLACES, CHOICE_PLACES, USUAL_SHARE = 30, 200, 0.5
BESIDE_HZ = (0.0, -12.5, 12.5)


@dataclass(frozen=True, slots=True)
class FeltTask:
    """Requirements on the fingers, all at the same time, and on the modes; `curve_um`: the amplitudes at which these
    fingers feel equally spaced frictions 1 .. 0, where they were measured."""

    targets_um: tuple[float, ...] = (1.0, 0.0)
    q_factor: float = Q_FACTOR
    radius_mm: float = RADIUS_MM
    farthest_hz: float = FARTHEST_HZ
    seed: int = SEED
    curve_um: tuple[float, ...] = ()
    floor_frac: float = FLOOR_FRAC

    @property
    def curve(self) -> FrictionCurve:
        """The friction that these fingers feel, at rest."""
        return (
            FrictionCurve.from_amplitudes(self.curve_um, self.floor_frac) if self.curve_um else DEFAULT_FRICTION_CURVE
        )


@dataclass(frozen=True, slots=True)
class NearModes:
    """K modes near a drive: what patches do to them, (K, patches), their shapes under fingers, and the decay that a
    finger adds per square of a shape."""

    driven: PatchDrive
    found: PlateTouches
    finger_decay_1_s: float

    def of(self, used: Sequence[int]) -> PatchDrive:
        """Return what the patches do to some modes, in this order. Raises ValueError unless there is a patch for each,
        UndrivenError where they do not move each mode alone."""
        driven = self.driven.of(np.array(used))
        modes, patches = driven.gain_um_per_v_s.shape
        if patches != modes:
            raise ValueError(f"{patches} patches drive {modes} modes; glue one for each.")
        if np.linalg.matrix_rank(driven.gain_um_per_v_s) < modes:
            raise UndrivenError("these patches do not move each mode alone: place them elsewhere.")
        return driven

    def pushed(self, used: Sequence[int], drive_hz: float) -> ComplexArray:
        """Return the motion (K - M, M) of each undriven mode, per um of each driven one, by the patches alone."""
        own, others = self.of(used), self.driven.of(np.array(self.undriven(used), np.intp))
        pushes = others.gain_um_per_v_s @ own.volts_per_um_s * own.stiffness_1_s(drive_hz)
        return np.asarray(pushes / others.stiffness_1_s(drive_hz)[:, None])

    def undriven(self, used: Sequence[int]) -> list[int]:
        """Return the other modes."""
        return [mode for mode in range(len(self.driven.frequency_hz)) if mode not in used]

    def under(self, used: Sequence[int], drive_hz: float, count: int | None = None) -> PlateTouches:
        """Return the driven modes' shapes at the first `count` places: solved with what is compensated, and true with
        all that the undriven modes do meanwhile."""
        rest, used = self.undriven(used), list(used)
        own, others = self.of(used), self.driven.of(np.array(rest, np.intp))
        solved, true = self.found.solved[:count], self.found.true[:count]
        compensated = solved[..., used] + solved[..., rest] @ self.pushed(used, drive_hz).real
        load_1_s = np.einsum("pnqa,pnqb,q->pab", true, true[..., used], self.found.weights, optimize=True)
        load_1_s *= self.finger_decay_1_s
        held_1_s = load_1_s[:, used] + np.diag(own.stiffness_1_s(drive_hz))
        moved = others.gain_um_per_v_s @ own.volts_per_um_s @ held_1_s - load_1_s[:, rest]
        moved /= others.stiffness_1_s(drive_hz)[:, None]
        return PlateTouches(compensated, true[..., used] + true[..., rest] @ moved[:, None], self.found.weights)


@dataclass(frozen=True, slots=True)
class Choice:
    """The modes that are driven, at this frequency, each within its limit, a `share` of its reach alone; `felt_frac` of
    the places tried are felt as asked."""

    used: tuple[int, ...]
    drive_hz: float
    share: float
    limits_um: tuple[float, ...]
    felt_frac: float

    def sentence(self, modes: int) -> str:
        """Return what to do with this many modes of a scan, numbered from 1 as in its file."""
        undriven = [mode for mode in range(modes) if mode not in self.used]
        said = f"use modes {_listed(self.used)}; drive {self.drive_hz:.0f} Hz"
        if undriven:
            many = len(undriven) > 1
            named = f"modes {_listed(undriven)} stay" if many else f"mode {_listed(undriven)} stays"
            said += f"; {named} undriven, {'their shares are' if many else 'its share is'} compensated"
        return said


def _listed(modes: Sequence[int]) -> str:
    return ", ".join(str(mode + 1) for mode in modes)


def choose(near: NearModes, task: FeltTask) -> Choice | None:
    """Return the drive, and the modes that are driven, at which most is felt as asked; None if no drive is within
    `task.farthest_hz` of as many modes as there are patches, each to be moved alone."""
    hz, sets = near.driven.frequency_hz, []
    for used in combinations(range(len(hz)), near.driven.gain_um_per_v_s.shape[1]):
        if np.ptp(hz[list(used)]) <= 2.0 * task.farthest_hz:
            with suppress(UndrivenError):
                driven = near.of(used)
                drive_hz = least_volts_hz(driven, task.farthest_hz)
                sets.append((float(driven.reach_um(drive_hz).min()), used, drive_hz))
    sets = sorted(sets, reverse=True)[:STRONGEST]
    usual = [limited(near, used, drive_hz, task, FEW_PLACES, (USUAL_SHARE,)) for _, used, drive_hz in sets]
    best = sorted(usual, key=lambda one: one.felt_frac, reverse=True)[:BEST]
    tried = [
        limited(near, one.used, one.drive_hz + beside_hz, task, CHOICE_PLACES)
        for one, beside_hz in product(best, BESIDE_HZ)
    ]
    return max(tried, key=lambda one: one.felt_frac, default=None)


def limited(
    near: NearModes,
    used: Sequence[int],
    drive_hz: float,
    task: FeltTask,
    places: int = SEARCH_PLACES,
    shares: Sequence[float] = SHARES,
) -> Choice:
    """Return these modes at this drive, with the limits at which most is felt as asked. Raises ValueError."""
    driven, found = near.of(used), near.under(used, drive_hz, places)
    reach_um = driven.reach_um(drive_hz)

    def felt(share: float) -> float:
        most_um = np.minimum(share * reach_um, MOST_UM)
        modal_um, error_jnd = settle_felt(found, task.targets_um, most_um, starts=1, curve=task.curve)
        return float(np.mean(is_felt(error_jnd) & fits(driven.patch_volts_v(modal_um.T, drive_hz).T, driven)))

    felt_by_share = {share: felt(share) for share in shares}
    enough = max(felt_by_share.values()) - ALIKE_FRAC
    share = min(share for share, felt_frac in felt_by_share.items() if felt_frac >= enough)
    limits_um = np.minimum(share * reach_um, MOST_UM).tolist()
    return Choice(tuple(used), drive_hz, share, tuple(limits_um), felt_by_share[share])


def least_volts_hz(driven: PatchDrive, farthest_hz: float) -> float:
    """Return the drive at which the worst patch needs least, RMS, when all modes have the same amplitude."""
    frequency_hz = driven.frequency_hz
    middle_hz = (frequency_hz.min() + frequency_hz.max()) / 2.0
    low_hz, high_hz = max(frequency_hz.max() - farthest_hz, 0.0), frequency_hz.min() + farthest_hz
    tried = low_hz + STEP_HZ * np.arange(math.floor((high_hz - low_hz) / STEP_HZ + 1e-9) + 1)
    volts = driven.volts_per_um_s / driven.most_v[:, None]

    def worst(hz: float) -> float:
        return float(np.linalg.norm(volts * np.abs(driven.stiffness_1_s(hz)), axis=1).max())

    return float(min([middle_hz, *tried.tolist()], key=worst))


def is_felt(error_jnd: FloatArray) -> BoolArray:
    """Return whether all contacts are felt as asked, at each place."""
    return np.asarray(np.abs(error_jnd).max(axis=1) <= ENOUGH_JND)


def fits(patch_v: FloatArray, driven: PatchDrive) -> BoolArray:
    """Return whether all patches have their volts, at each place."""
    return np.asarray((patch_v <= driven.most_v).all(axis=1))
