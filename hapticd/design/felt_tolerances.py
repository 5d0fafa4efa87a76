"""Copies of a plate within its tolerances, each set up from its scan: what plates of one drawing give when made.

A copy has its own modes. A vibrometer's scan of all that lie near the drive that is expected, with noise, lost points
and outliers, is fitted as `hapticd calibrate modes` does, and from the maps, the frequencies and what each patch does
to each mode follows which modes are driven, and at which frequency (`mode_choice`). What is felt is judged on the true
shapes, with the motion of the modes that stay undriven.

A plate is cut after its sheet was measured: edges and places are to the thickness as drawn, so that all frequencies
move by one factor, and the drive follows. At drawn edges bending modes would move with the thickness, and those in the
plane, which stay, would come among the driven ones. Edges of different length split pairs of equal frequency, by 30 Hz
per 0.1 mm on 200 mm, and unmix the shapes of a square plate.

Left out: wires, supports, uneven thickness, and errors of the frequencies and of the forces that a sweep measures.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from ..core.plate.mode_shapes import ModeShapes
from ..values import FloatArray
from .campaign import TaskRunner, one_by_one
from .cartography import fit_scan
from .felt_search import FeltDesign, GluedModes
from .glued_plate import GluedPlate, Patch
from .mode_choice import FeltTask
from .mode_shape import ModeShape
from .scan import sample_scan
from .section import wave_hz, wave_rad_mm

# Largest errors, each uniformly distributed: a cut by a glass shop, a batch's modulus, float glass (EN 572-2), a
# caliper's reading of its thickness, the place of a patch. GLUE_FRAC is of a patch's stiffness and force: 5 to 15 um of
# epoxy shear over 0.4 to 0.7 mm at each of its edges, an estimate.
SIZE_MM, YOUNG_FRAC, THICKNESS_MM, CALIPER_MM, PATCH_MM, GLUE_FRAC = 0.1, 0.02, 0.2, 0.02, 0.5, 0.2
NEAR_HZ = 600.0  # from the drive that is expected: modes that are scanned, so that some stay undriven
SCAN_STEP_MM = 6.0
PLACES = 300
_STREAM = 51


class Copy(NamedTuple):
    """Copy `number` of a plate that is driven at `drive_hz` as drawn; 0 is the plate as drawn."""

    plate: GluedPlate
    drive_hz: float
    task: FeltTask
    number: int

    def made(self) -> GluedPlate:
        """Return the plate as it was made; its patches are on it."""
        plate = self.plate
        if self.number == 0:
            return plate
        random = np.random.default_rng([_STREAM, self.number])
        x, y, young, thickness, read = random.uniform(-1.0, 1.0, 5).tolist()
        thickness_mm = plate.thickness_mm + thickness * THICKNESS_MM
        scale = (thickness_mm + read * CALIPER_MM) / plate.thickness_mm
        size_mm = (plate.size_mm[0] * scale + x * SIZE_MM, plate.size_mm[1] * scale + y * SIZE_MM)
        young_gpa = plate.material.young_gpa * (1.0 + young * YOUNG_FRAC)
        patches = tuple(_glued(patch, plate.size_mm, size_mm, random) for patch in plate.patches)
        return GluedPlate(size_mm, thickness_mm, replace(plate.material, young_gpa=young_gpa), patches)

    def modes(self) -> GluedModes:
        """Return the modes of the plate as it was made near the drive that is expected, with the maps of its scan.
        Raises ValueError."""
        made, drawn = self.made(), self.plate
        rad_mm = wave_rad_mm(self.drive_hz, drawn.thickness_mm, drawn.material)
        drive_hz = wave_hz(rad_mm * drawn.size_mm[0] / made.size_mm[0], made.thickness_mm, made.material)
        measure = partial(scanned, seed=(_STREAM, self.number))
        return GluedModes(made, (drive_hz - NEAR_HZ, drive_hz + NEAR_HZ), self.task, PLACES, measure=measure)


class Tolerances(NamedTuple):
    """Shares of places felt as asked, of a design's plate as drawn and of its copies (n,), all set up from scans."""

    design: FeltDesign
    nominal_frac: float
    felt_frac: FloatArray

    @property
    def tenth_frac(self) -> float:
        """The share that nine in ten copies have, or more."""
        return float(np.quantile(self.felt_frac, 0.1))


def felt_tolerances(
    designs: Sequence[FeltDesign], task: FeltTask, count: int, campaign: TaskRunner = one_by_one
) -> list[Tolerances]:
    """Return what is felt on each plate and its copies 1 to `count`, alike for all: the largest tenth percentile first.
    0 is felt where no drive has enough modes."""
    copies = [Copy(one.plate, one.drive_hz, task, number) for one in designs for number in range(count + 1)]
    found = np.reshape(campaign(f"{count} copies of each plate", felt_frac, copies), (len(designs), count + 1))
    studies = [Tolerances(one, float(each[0]), each[1:]) for one, each in zip(designs, found, strict=True)]
    return sorted(studies, key=lambda one: (one.design.rank[0], one.tenth_frac), reverse=True)


def felt_frac(copy: Copy) -> float:
    """Return the share of places felt as asked on one copy."""
    judged = copy.modes().set_up()
    return 0.0 if judged is None else judged.felt_frac


def scanned(shapes: Sequence[ModeShape], seed: Sequence[int]) -> ModeShapes:
    """Return the maps of a vibrometer's scan, by the fit that takes a third of the time of the better one."""
    scan = sample_scan(shapes, step_mm=SCAN_STEP_MM, noise_frac=0.02, seed=seed, missing_frac=0.03, dropout_frac=0.01)
    return fit_scan(*scan, size_mm=shapes[0].size_mm, normalise=False, by="plate_equation").modes


def _glued(
    patch: Patch, drawn_mm: tuple[float, float], size_mm: tuple[float, float], random: np.random.Generator
) -> Patch:
    """Return the patch with the stiffness that its glue leaves it, at its place to scale on a plate of this size, or at
    the edge where it is drawn there, and moved at random away from the edges it is near."""
    off_mm = random.uniform(0.0, PATCH_MM, 2).tolist()
    x_mm, y_mm = map(_placed, (patch.x_mm, patch.y_mm), patch.size_mm, drawn_mm, size_mm, off_mm)
    young_gpa = patch.material.young_gpa * (1.0 - random.uniform(0.0, GLUE_FRAC))
    return replace(patch, x_mm=x_mm, y_mm=y_mm, material=replace(patch.material, young_gpa=young_gpa))


def _placed(middle_mm: float, width_mm: float, drawn_mm: float, edge_mm: float, off_mm: float) -> float:
    most_mm, place_mm = (edge_mm - width_mm) / 2.0, abs(middle_mm)
    if place_mm < (drawn_mm - width_mm) / 2.0:
        most_mm = min(most_mm, place_mm * edge_mm / drawn_mm)
    return math.copysign(most_mm - off_mm, middle_mm)
