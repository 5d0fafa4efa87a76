"""Monte Carlo over a plate's tolerances: what plates of one drawing give friction as asked.

Each random plate has its own modes and is driven where it is best, near the design's frequency, by patches that are
near their places. It is solved on the maps that `hapticd calibrate modes` fits to a vibrometer's scan of it, with
noise, lost points and outliers. Its modes may lie farther from the drive than a search would allow: it has been made.

A modulus or a thickness that is off moves all frequencies of a thin plate by one factor, and the drive follows. Edges
of different length split pairs of equal frequency, by 30 Hz per 0.1 mm on 200 mm, and unmix the shapes of a square
plate: these are the tolerances that count.

Left out: wires, supports and the glue's own layer, uneven thickness, and errors of the drive's measurement.
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
from .felt_search import FeltDesign, FeltTask, judge_near
from .free_plate import ModeShape
from .glued_plate import GluedPlate, Patch
from .scan import sample_scan

# Largest errors, each uniformly distributed: a cut by a glass shop, a batch's modulus, float glass (EN 572-2), the
# place of a patch.
SIZE_MM, YOUNG_FRAC, THICKNESS_MM, PATCH_MM = 0.1, 0.02, 0.2, 0.5
SPREAD_HZ = 40.0  # by which edges off by 0.1 mm may move modes of one design apart
SCAN_STEP_MM = 6.0


class MadeTask(NamedTuple):
    """A plate as it was made, to be driven near `drive_hz` with so many modes; `scan_seed` is of its scan."""

    plate: GluedPlate
    drive_hz: float
    modes: int
    task: FeltTask
    scan_seed: tuple[int, ...]


def felt_tolerances(design: FeltDesign, task: FeltTask, count: int, campaign: TaskRunner = one_by_one) -> FloatArray:
    """Return the share of places felt as asked on each of `count` plates; 0 where no drive has enough modes."""
    random = np.random.default_rng([task.seed, count])
    task = replace(task, farthest_hz=design.farthest_hz + SPREAD_HZ)
    made = []
    for index in range(count):
        plate = random_plate(design.plate, random)
        drive_hz = design.drive_hz * plate.thickness_mm / design.plate.thickness_mm
        drive_hz *= math.sqrt(plate.material.young_gpa / design.plate.material.young_gpa)
        made.append(MadeTask(plate, drive_hz, len(design.modes), task, (task.seed, count, index)))
    return np.array(campaign(f"{count} random plates", felt_frac, made))


def felt_frac(made: MadeTask) -> float:
    """Return the share of places felt as asked on one plate."""
    judged = judge_near(made.plate, made.drive_hz, made.modes, made.task, partial(scanned, seed=made.scan_seed))
    return 0.0 if judged is None else judged.felt_frac


def scanned(shapes: Sequence[ModeShape], seed: Sequence[int]) -> ModeShapes:
    """Return the maps of a vibrometer's scan, each with the sign of its mode, by the fit that takes a third of the time
    of the better one."""
    scan = sample_scan(shapes, step_mm=SCAN_STEP_MM, noise_frac=0.02, seed=seed, missing_frac=0.03, dropout_frac=0.01)
    fit = fit_scan(*scan, size_mm=shapes[0].size_mm, normalise=False, by="plate_equation")
    maps, signs = fit.modes, np.sign(fit.scale.real)
    return ModeShapes.from_grid(maps.x_mm, maps.y_mm, maps.shapes * signs[:, None, None])


def random_plate(plate: GluedPlate, random: np.random.Generator) -> GluedPlate:
    """Return a plate as it may be made; its patches are on it."""
    x, y, young, thickness = random.uniform(-1.0, 1.0, 4)
    width_mm, depth_mm = plate.size_mm
    size_mm = (width_mm + x * SIZE_MM, depth_mm + y * SIZE_MM)
    young_gpa = plate.material.young_gpa * (1.0 + young * YOUNG_FRAC)
    return GluedPlate(
        size_mm,
        plate.thickness_mm + thickness * THICKNESS_MM,
        replace(plate.material, young_gpa=young_gpa),
        tuple(_moved(patch, size_mm, random) for patch in plate.patches),
    )


def _moved(patch: Patch, size_mm: tuple[float, float], random: np.random.Generator) -> Patch:
    """Return the patch moved at random, away from the edges it is near, to a place on a plate of this size."""
    x_mm, y_mm = (
        math.copysign(min(abs(middle_mm) - off_mm, (edge_mm - width_mm) / 2.0), middle_mm)
        for middle_mm, off_mm, edge_mm, width_mm in zip(
            (patch.x_mm, patch.y_mm), random.uniform(0.0, PATCH_MM, 2), size_mm, patch.size_mm, strict=True
        )
    )
    return replace(patch, x_mm=x_mm, y_mm=y_mm)
