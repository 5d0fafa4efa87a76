"""Monte Carlo over a plate's tolerances: what plates of one drawing give friction as asked.

As `contact_tolerances`, with float glass as it is sold: its thickness moves all frequencies together, and the drive
follows. Each plate is driven where it is best, by patches that are near their places, and solved on the maps that
`hapticd calibrate modes` fits to a scan of it. Its modes may lie farther from the drive than a search would allow: it
has been made.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np

from ..values import FloatArray
from .contact_search import Progress
from .contact_tolerances import random_plate, scanned
from .felt_search import FeltDesign, FeltTask, judge_near

THICKNESS_MM = 0.2  # of float glass, EN 572-2
SPREAD_HZ = 40.0  # by which edges off by 0.1 mm may move modes of one design apart


def felt_tolerances(
    design: FeltDesign, task: FeltTask, count: int, *, progress: Progress = lambda _: None
) -> FloatArray:
    """Return the share of places felt as asked on each of `count` plates; 0 where no drive has enough modes."""
    random = np.random.default_rng([task.seed, count])
    task = replace(task, farthest_hz=design.farthest_hz + SPREAD_HZ)
    found = np.zeros(count)
    for index in range(count):
        progress(index / count)
        made = random_plate(design.plate, random, THICKNESS_MM / design.plate.thickness_mm)
        drive_hz = design.drive_hz * made.thickness_mm / design.plate.thickness_mm
        drive_hz *= math.sqrt(made.material.young_gpa / design.plate.material.young_gpa)
        measure = partial(scanned, seed=[task.seed, count, index])
        judged = judge_near(made, drive_hz, len(design.modes), task, measure)
        found[index] = 0.0 if judged is None else judged.felt_frac
    return found
