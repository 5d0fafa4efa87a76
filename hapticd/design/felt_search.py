"""Search for plates on which frictions are felt as asked, with the patches that an order brings.

For each bare plate the sets of neighbouring modes are sought that lie within `farthest_hz` of a drive, and compared by
the share of random places at which every contact is felt as asked (`felt_places`), with the same reach for all. The
best get patches of each orderable size along the edges, where they give most (`patch_places.places_for_reach`). Glued
on, these move and mix the modes (`glued_plate`): they are placed again on the shapes that result, and the plate is
judged as it then is, with the reach that follows from its patches, within the volts that each may have (`patch_reach`).

A mode's limit is a share of its reach alone, the same for all modes of a plate: modes move together, and share the
patches. The share that leaves most places within the volts is taken.

Of modes that nearly have one frequency any support or flaw makes others, which no map has: plates whose closest modes
turn by more than MOST_TURN_DEG come after all others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..values import FloatArray
from .campaign import TaskRunner, one_by_one
from .contact_pairs import ShapeMaps, surfaces
from .felt_places import ENOUGH_JND, PlateTouches, settle_felt, touches
from .glued_plate import PZT, GluedPlate, Patch
from .mode_choice import (
    FINGER_KG_S,
    MOST_UM,
    SEARCH_PLACES,
    Choice,
    FeltTask,
    NearModes,
    choose,
    fits,
    is_felt,
    least_volts_hz,
    limited,
)
from .mode_shape import ModeShape
from .patch_places import along_edges, couplings, overlapping, places_for_reach
from .patch_reach import PatchDrive, UndrivenError, patch_drive

ORDERABLE = tuple((width, depth, thick) for width, depth in ((10, 10), (20, 10), (15, 15)) for thick in (0.3, 0.5))
JUDGE_PLACES = 500
FINALISTS = 3  # for each number of modes, that get patches
USUAL_UM = 12.0  # reach at resonance of eight 10 x 10 mm patches: by it bare plates are compared
GLUE_HZ = 250.0  # by which patches move modes, at most
COUPLED_HZ = 2.0  # of two modes by what touches the plate since its scan: soft supports, a chip of 1 mm
MOST_TURN_DEG = 10.0  # by 32 a laboratory's contrast falls from 5.9 to 1.3, by 7 not at all
ROUNDS, MORE_ROUNDS = 2, 12  # of placing patches on the shapes that they make; of the best

Kit = tuple[float, float, float]  # a patch's width, depth and thickness in mm
Modes = Sequence[tuple[float, ModeShape]]
Measure = Callable[[Sequence[ModeShape]], ShapeMaps]  # from a plate's modes to the maps that a laboratory has of them


@dataclass(frozen=True, slots=True)
class FeltDesign:
    """A plate with its patches, one for each driven mode, nearest first, at a drive frequency.

    `limits_um` (M,) are at the drive, `reach_um` what they are at each mode's resonance; `share` is theirs of the reach
    alone. `felt_frac` is the share of places where all contacts are felt as asked within the patches' volts,
    `each_frac` (N,) that of each contact; `fits_frac` of places within the volts. `next_hz` is the nearest other mode's
    distance from the drive.
    """

    plate: GluedPlate
    drive_hz: float
    modes: tuple[tuple[float, ModeShape], ...]
    next_hz: float
    driven: PatchDrive
    share: float
    limits_um: tuple[float, ...]
    felt_frac: float
    each_frac: tuple[float, ...]
    fits_frac: float
    modal_um: FloatArray  # |W| at the places, (P, M)
    patch_v: FloatArray  # at the places, (P, M patches)

    @property
    def frequency_hz(self) -> tuple[float, ...]:
        """The driven modes' frequencies."""
        return tuple(hz for hz, _ in self.modes)

    @property
    def shapes(self) -> tuple[ModeShape, ...]:
        """The driven modes' shapes."""
        return tuple(shape for _, shape in self.modes)

    @property
    def reach_um(self) -> tuple[float, ...]:
        """Each mode's limit at resonance with the same volts."""
        resonance_gain = np.abs(self.driven.stiffness_1_s(self.drive_hz)) / self.driven.decay_1_s
        return tuple((np.array(self.limits_um) * resonance_gain).tolist())

    @property
    def farthest_hz(self) -> float:
        """The distance of the farthest driven mode from the drive."""
        return max(abs(hz - self.drive_hz) for hz in self.frequency_hz)

    @property
    def closest_hz(self) -> float:
        """The least distance between two driven modes."""
        return min((above - below for below, above in pairwise(sorted(self.frequency_hz))), default=math.inf)

    @property
    def turn_deg(self) -> float:
        """The angle by which the closest two turn into each other where COUPLED_HZ couple them."""
        return math.degrees(math.atan2(2.0 * COUPLED_HZ, self.closest_hz) / 2.0)

    @property
    def rank(self) -> tuple[bool, float]:
        """Of two designs the better one has more: friction as asked on modes that stay, then friction as asked."""
        return self.turn_deg <= MOST_TURN_DEG and self.felt_frac > 0.0, self.felt_frac


class GluedModes:
    """A plate's modes near a drive, with the shapes under fingers at random places. Raises ValueError."""

    def __init__(
        self,
        plate: GluedPlate,
        band_hz: tuple[float, float],
        task: FeltTask,
        places: int,
        measure: Measure = surfaces,
    ) -> None:
        """Solve the plate's modes in the band, widened by `task.farthest_hz`."""
        self.plate, self.task, self.places, self._measure = plate, task, places, measure
        self.solved_hz = (max(band_hz[0] - task.farthest_hz, 0.0), band_hz[1] + task.farthest_hz)
        self.modes = plate.modes(self.solved_hz)
        self._band_hz = band_hz

    @cached_property
    def _known(self) -> PlateTouches:
        return self._under(self._measure([shape for _, shape in self.modes]))

    @cached_property
    def _touches(self) -> PlateTouches:
        if self._measure is surfaces:
            return self._known
        return self._under(surfaces([shape for _, shape in self.modes])).known_by(self._known)

    def _under(self, known: ShapeMaps) -> PlateTouches:
        of = self.task
        return touches(known, self.plate.size_mm, of.radius_mm, len(of.targets_um), self.places, of.seed)

    def sets(self, count: int) -> list[range]:
        """Return the sets of `count` neighbouring modes that a drive in the band has within `farthest_hz`."""
        frequency_hz = [hz for hz, _ in self.modes]
        found = []
        for first in range(len(frequency_hz) - count + 1):
            low_hz, high_hz = frequency_hz[first], frequency_hz[first + count - 1]
            is_near = high_hz - low_hz <= 2.0 * self.task.farthest_hz
            if is_near and self._band_hz[0] <= (low_hz + high_hz) / 2.0 <= self._band_hz[1]:
                found.append(range(first, first + count))
        return found

    def felt_frac(self, chosen: Sequence[int]) -> float:
        """Return the share of places felt as asked when each of these modes has the usual reach at resonance."""
        task, frequency_hz = self.task, np.array([hz for hz, _ in self.of(chosen)])
        drive_hz = (frequency_hz.min() + frequency_hz.max()) / 2.0
        decay_1_s = math.pi * frequency_hz / task.q_factor
        limits_um = USUAL_UM * decay_1_s / np.hypot(decay_1_s, 2.0 * math.pi * (frequency_hz - drive_hz))
        few = self._touches.of(chosen, SEARCH_PLACES)
        _, error_jnd = settle_felt(few, task.targets_um, np.minimum(limits_um, MOST_UM), starts=1, curve=task.curve)
        return float(np.mean(is_felt(error_jnd)))

    def of(self, chosen: Sequence[int]) -> list[tuple[float, ModeShape]]:
        """Return some of the modes."""
        return [self.modes[mode] for mode in chosen]

    def judge(self, chosen: Sequence[int], drive_hz: float | None = None) -> FeltDesign:
        """Return the plate's figures with these modes driven, without `drive_hz` where that takes least volts."""
        near = self.near(self._touches)
        drive_hz = least_volts_hz(near.of(chosen), self.task.farthest_hz) if drive_hz is None else drive_hz
        return self._judged(near, limited(near, chosen, drive_hz, self.task))

    def set_up(self) -> FeltDesign | None:
        """Return the plate's figures with the drive and the modes that are chosen from what is known of it, None
        without a drive near as many modes as there are patches."""
        choice = choose(self.shown(), self.task)
        return None if choice is None else self._judged(self.near(self._touches), choice)

    def shown(self) -> NearModes:
        """Return what the patches do to all modes as they were measured."""
        return self.near(self._known)

    def near(self, found: PlateTouches) -> NearModes:
        """Return what the patches do to all modes."""
        plate = self.plate
        driven = patch_drive(plate.thickness_mm, plate.patches, self.modes, self.task.q_factor)
        mass_kg = math.prod(plate.size_mm) * plate.thickness_mm * plate.material.density_kg_m3 * 1e-9
        return NearModes(driven, found, FINGER_KG_S / mass_kg)

    def _judged(self, near: NearModes, choice: Choice) -> FeltDesign:
        drive_hz, task = choice.drive_hz, self.task
        nearest = np.argsort(np.abs(near.driven.frequency_hz[list(choice.used)] - drive_hz))
        chosen = [choice.used[at] for at in nearest]
        driven, limits_um = near.of(chosen), np.array(choice.limits_um)[nearest]
        modal_um, error_jnd = settle_felt(near.under(chosen, drive_hz), task.targets_um, limits_um, curve=task.curve)
        patch_v = driven.patch_volts_v(modal_um.T, drive_hz).T
        is_within = fits(patch_v, driven)
        others_hz = [abs(hz - drive_hz) for at, (hz, _) in enumerate(self.modes) if at not in chosen]
        return FeltDesign(
            self.plate,
            drive_hz,
            tuple(self.of(chosen)),
            min(others_hz, default=math.inf),
            driven,
            choice.share,
            tuple(limits_um.tolist()),
            float(np.mean(is_felt(error_jnd) & is_within)),
            tuple(np.mean(np.abs(error_jnd) <= ENOUGH_JND, axis=0).tolist()),
            float(np.mean(is_within)),
            np.abs(modal_um),
            patch_v,
        )


class BareTask(NamedTuple):
    """A plate whose sets of so many modes each are compared."""

    plate: GluedPlate
    counts: tuple[int, ...]
    drive_hz: tuple[float, float]
    task: FeltTask


class GlueTask(NamedTuple):
    """A plate that gets patches of a kit; see `glue`."""

    plate: GluedPlate
    modes: Modes
    kit: Kit
    task: FeltTask
    rounds: int


def search(
    plates: Sequence[GluedPlate],
    counts: Sequence[int],
    drive_hz: tuple[float, float],
    task: FeltTask,
    kits: Sequence[Kit] = ORDERABLE,
    campaign: TaskRunner = one_by_one,
) -> list[FeltDesign]:
    """Return the best plates with their patches, best first: those that they have, or where they have none those of
    `kits`. Raises ValueError."""
    bare = [BareTask(plate, tuple(counts), drive_hz, task) for plate in plates]
    if any(plate.patches for plate in plates):
        found = campaign("plates", _as_they_are, bare)
        return sorted((one for each in found for one in each), key=lambda one: one.rank, reverse=True)
    ranked: list[list[tuple[float, GluedPlate, Modes]]] = [[] for _ in counts]
    for plate, of_plate in zip(plates, campaign("plates", _ranked, bare), strict=True):
        for sets, of_count in zip(ranked, of_plate, strict=True):
            sets += [(felt_frac, plate, modes) for felt_frac, modes in of_count]
    finalists = [one for sets in ranked for one in sorted(sets, key=lambda each: -each[0])[:FINALISTS]]
    jobs = [GlueTask(plate, modes, kit, task, ROUNDS) for _, plate, modes in finalists for kit in kits]
    made = [(job, one) for job, one in zip(jobs, campaign("patches", glue, jobs), strict=True) if one is not None]
    made.sort(key=lambda each: each[1].rank, reverse=True)
    designs = [one for _, one in made]
    if designs:
        (better,) = campaign("more places", glue, [made[0][0]._replace(rounds=MORE_ROUNDS)])
        designs[0] = better or designs[0]
    return designs


def _as_they_are(bare: BareTask) -> list[FeltDesign]:
    made = [judge_best(bare.plate, bare.drive_hz, count, bare.task) for count in bare.counts]
    return [one for one in made if one is not None]


def _ranked(bare: BareTask) -> list[list[tuple[float, Modes]]]:
    """Return for each number of modes its sets, and the share of places felt as asked with each."""
    modes = GluedModes(bare.plate, bare.drive_hz, bare.task, SEARCH_PLACES)
    return [[(modes.felt_frac(chosen), modes.of(chosen)) for chosen in modes.sets(count)] for count in bare.counts]


def glue(job: GlueTask) -> FeltDesign | None:
    """Return a bare plate with patches of a kit glued on where they give its `modes` most, or None where they take
    these too far apart.

    Patches move the modes for which they are placed. So after the first round they are placed on the best plate's
    shapes so far, each time among a random half of the places.
    """
    plate, modes, kit, task, rounds = job
    best = None
    middle_hz = (min(hz for hz, _ in modes) + max(hz for hz, _ in modes)) / 2.0
    near_hz = middle_hz - GLUE_HZ, middle_hz + GLUE_HZ
    random = np.random.default_rng(task.seed)
    for number in range(rounds):
        patches = place(plate, modes if best is None else best.modes, task, kit, random if number else None)
        found = judge_best(replace(plate, patches=patches), near_hz, len(modes), task)
        if found is not None and (best is None or found.rank > best.rank):
            best = found
    return best


def judge_best(plate: GluedPlate, drive_hz: tuple[float, float], count: int, task: FeltTask) -> FeltDesign | None:
    """Return a plate with its patches at its best drive within `drive_hz`, or None without `count` modes there. Raises
    ValueError."""
    glued = GluedModes(plate, drive_hz, task, JUDGE_PLACES)
    found = []
    for chosen in glued.sets(count):
        with suppress(UndrivenError):
            found.append(glued.judge(chosen))
    return max(found, key=lambda one: one.rank, default=None)


def place(
    plate: GluedPlate, modes: Modes, task: FeltTask, kit: Kit, random: np.random.Generator | None = None
) -> tuple[Patch, ...]:
    """Return a patch for each mode along the edges, with `random` in half of the places. Raises ValueError for one too
    large for them."""
    frequency_hz = np.array([hz for hz, _ in modes])
    shapes = [shape for _, shape in modes]
    middle_hz = (frequency_hz.min() + frequency_hz.max()) / 2.0
    candidates_mm, sizes_mm = along_edges(plate.size_mm, kit[:2])
    if random is not None:
        kept = random.permutation(len(candidates_mm))[: len(candidates_mm) // 2]
        candidates_mm, sizes_mm = candidates_mm[kept], sizes_mm[kept]
    stiffness_1_s = np.hypot(math.pi * frequency_hz / task.q_factor, 2.0 * math.pi * (frequency_hz - middle_hz))
    mass_kg = np.array([shape.mass_kg for shape in shapes])
    height_mm = (plate.thickness_mm + kit[2]) / 2.0
    stretch = couplings(shapes, candidates_mm, sizes_mm, height_mm)
    moved = stretch / (mass_kg * frequency_hz * stiffness_1_s)[:, None]
    chosen = places_for_reach(moved / np.abs(moved).max(), overlapping(candidates_mm, sizes_mm))
    return tuple(
        Patch(x_mm, y_mm, (width_mm, depth_mm), kit[2], PZT)
        for (x_mm, y_mm), (width_mm, depth_mm) in zip(
            candidates_mm[chosen].tolist(), sizes_mm[chosen].tolist(), strict=True
        )
    )
