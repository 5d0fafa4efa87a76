"""Monte Carlo over a plate's tolerances: how many plates of one drawing reach the contrast of the design.

Each random plate has its own modes and is driven where it is best, near the design's frequency: what measuring its
modes and choosing its drive gives. A modulus or a thickness that is off moves all frequencies of a thin plate by one
factor, and the drive follows. Edges of different length split pairs of equal frequency, by 30 Hz per 0.1 mm on 200 mm,
and unmix the shapes of a square plate: these are the tolerances that count.

Left out: wires, supports and the glue's own layer, uneven thickness, and errors of measurement.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .contact_search import JUDGE_PAIRS, SEED, ContactDesign, Drive, Plate, best_near
from .glued_plate import Patch
from .legendre import FloatArray

ENOUGH_FRAC = 2.0 / 3.0  # of the design's contrast

Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Largest errors, each uniformly distributed: a cut by a glass shop, a batch's modulus, a float sheet."""

    size_mm: float = 0.1
    young_frac: float = 0.02
    thickness_frac: float = 0.01
    patch_mm: float = 0.5  # of each patch's position


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
    tolerances: Tolerances = Tolerances(),
    pairs: int = JUDGE_PAIRS,
    seed: int = SEED,
    progress: Progress = lambda _: None,
) -> ToleranceStudy:
    """Draw `count` plates around the design's. `progress` is called with the share that is done."""
    random = np.random.default_rng([seed, count])
    found = np.zeros((count, 2))
    for index in range(count):
        progress(index / count)
        judged = best_near(design, _drawn(design.plate, tolerances, random), drive, pairs)
        found[index] = (0.0, 0.0) if judged is None else (judged.contrast, judged.slip_um)
    return ToleranceStudy(found[:, 0] / design.contrast, found[:, 1] / design.slip_um)


def _drawn(plate: Plate, tolerances: Tolerances, random: np.random.Generator) -> Plate:
    x, y, young, thickness = random.uniform(-1.0, 1.0, 4)
    width_mm, depth_mm = plate.size_mm
    young_gpa = plate.material.young_gpa * (1.0 + young * tolerances.young_frac)
    return Plate(
        (width_mm + x * tolerances.size_mm, depth_mm + y * tolerances.size_mm),
        plate.thickness_mm * (1.0 + thickness * tolerances.thickness_frac),
        replace(plate.material, young_gpa=young_gpa),
        tuple(_moved(patch, tolerances.patch_mm, random) for patch in plate.patches),
    )


def _moved(patch: Patch, most_mm: float, random: np.random.Generator) -> Patch:
    """Return the patch moved at random, away from the edges it is near."""
    x_mm, y_mm = random.uniform(0.0, most_mm, 2)
    return replace(
        patch, x_mm=patch.x_mm - math.copysign(x_mm, patch.x_mm), y_mm=patch.y_mm - math.copysign(y_mm, patch.y_mm)
    )
