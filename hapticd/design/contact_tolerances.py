"""Monte Carlo over a plate's tolerances: how many plates of one drawing reach the contrast of the design.

Each random plate has its own modes and is driven where it is best, near the design's frequency. It is solved on the
maps that `hapticd calibrate modes` fits to a vibrometer's scan of it, with noise, lost points and outliers.

A modulus or a thickness that is off moves all frequencies of a thin plate by one factor, and the drive follows. Edges
of different length split pairs of equal frequency, by 30 Hz per 0.1 mm on 200 mm, and unmix the shapes of a square
plate: these are the tolerances that count.

Left out: wires, supports and the glue's own layer, uneven thickness, and errors of the drive's measurement.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.values import FloatArray

from .cartography import fit_scan
from .contact_search import JUDGE_PAIRS, SEED, ContactDesign, Drive, Plate, Progress, best_near
from .free_plate import ModeShape
from .glued_plate import Patch
from .scan import sample_scan

# Largest errors, each uniformly distributed: a cut by a glass shop, a batch's modulus, a float sheet, a patch's place.
SIZE_MM, YOUNG_FRAC, THICKNESS_FRAC, PATCH_MM = 0.1, 0.02, 0.01, 0.5
ENOUGH_FRAC = 2.0 / 3.0  # of the design's contrast
SCAN_STEP_MM = 6.0


@dataclass(frozen=True, slots=True)
class ToleranceStudy:
    """The random plates' contrast and mean slip (N,) as shares of the design's; 0 where no drive has enough modes."""

    contrast_frac: FloatArray
    slip_frac: FloatArray

    @property
    def enough_frac(self) -> float:
        """The share of plates with at least ENOUGH_FRAC of the design's contrast."""
        return float(np.mean(self.contrast_frac >= ENOUGH_FRAC))


def tolerance_study(
    design: ContactDesign,
    drive: Drive,
    count: int,
    *,
    are_scanned: bool = True,
    pairs: int = JUDGE_PAIRS,
    seed: int = SEED,
    progress: Progress = lambda _: None,
) -> ToleranceStudy:
    """Draw `count` plates around the design's; without `are_scanned` their modes are known exactly.

    `progress` is called with the share that is done.
    """
    random = np.random.default_rng([seed, count])
    found = np.zeros((count, 2))
    for index in range(count):
        progress(index / count)
        measure = partial(scanned, seed=[seed, count, index]) if are_scanned else None
        judged = best_near(design, random_plate(design.plate, random), drive, pairs, measure)
        found[index] = (0.0, 0.0) if judged is None else (judged.contrast, judged.slip_um)
    return ToleranceStudy(found[:, 0] / design.contrast, found[:, 1] / design.slip_um)


def scanned(shapes: Sequence[ModeShape], seed: Sequence[int]) -> ModeShapes:
    """Return the maps of a vibrometer's scan, each with the sign of its mode, by the fit that takes a third of the time
    of the better one."""
    scan = sample_scan(shapes, step_mm=SCAN_STEP_MM, noise_frac=0.02, seed=seed, missing_frac=0.03, dropout_frac=0.01)
    fit = fit_scan(*scan, size_mm=shapes[0].size_mm, normalise=False, by="plate_equation")
    maps, signs = fit.modes, np.sign(fit.scale.real)
    return ModeShapes.from_grid(maps.x_mm, maps.y_mm, maps.shapes * signs[:, None, None])


def random_plate(plate: Plate, random: np.random.Generator, thickness_frac: float = THICKNESS_FRAC) -> Plate:
    """Return a plate as it may be made; its patches are on it."""
    x, y, young, thickness = random.uniform(-1.0, 1.0, 4)
    width_mm, depth_mm = plate.size_mm
    size_mm = (width_mm + x * SIZE_MM, depth_mm + y * SIZE_MM)
    young_gpa = plate.material.young_gpa * (1.0 + young * YOUNG_FRAC)
    return Plate(
        size_mm,
        plate.thickness_mm * (1.0 + thickness * thickness_frac),
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
