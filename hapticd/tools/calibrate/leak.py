"""What a map's error costs: the vibration that a sticky finger gets because the map is not the plate.

Random pairs of fingers, one slippery, one sticky, are solved on the map. The sticky finger then gets sum_k W_k e_k,
where e_k is the map's error at its place: by cross validation an RMS over the plate, the same everywhere and
independent between modes. Left out: everything else that leaks, of which prediction is the most.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...core.plate.mode_shapes import ModeShapes
from ...core.solver.public import solve_batch

TARGETS_UM = (1.0, 0.0)
W_LIMIT_UM = 4.0
PAIRS = 1000
MARGIN_MM = 8.0  # fingers do not go nearer to an edge
APART_MM = 15.0  # nor to each other


class ExpectedLeak(NamedTuple):
    """Over all pairs of fingers, and what 95 of 100 pairs stay below; in um for the TARGETS_UM."""

    rms_um: float
    most_um: float


def finger_pairs_mm(modes: ModeShapes, pairs: int, seed: int) -> npt.NDArray[np.float64]:
    """Random places of two fingers (pairs, 2, 2) on the map, apart and clear of its edges."""
    random = np.random.default_rng(seed)
    low = np.array((modes.x_mm[0], modes.y_mm[0])) + MARGIN_MM
    high = np.array((modes.x_mm[-1], modes.y_mm[-1])) - MARGIN_MM
    drawn = random.uniform(low, high, (4 * pairs, 2, 2))
    apart_mm = np.linalg.norm(drawn[:, 0] - drawn[:, 1], axis=1)
    return np.asarray(drawn[apart_mm >= APART_MM][:pairs], np.float64)


def solved_um(modes: ModeShapes, pairs_mm: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Modal amplitudes (pairs, M) that the map asks for."""
    phi = modes.evaluate(pairs_mm.reshape(-1, 2)).reshape(*pairs_mm.shape[:2], modes.M)
    return solve_batch(phi, TARGETS_UM, W_LIMIT_UM)


def expected_leak(modes: ModeShapes, map_error_rms: Sequence[float], *, seed: int = 1) -> ExpectedLeak:
    """`map_error_rms` (M,) is each mode's own, in units of its shape."""
    modal_um = solved_um(modes, finger_pairs_mm(modes, PAIRS, seed))
    variance_um2 = modal_um**2 @ np.asarray(map_error_rms, np.float64) ** 2
    return ExpectedLeak(float(np.sqrt(variance_um2.mean())), float(np.sqrt(np.percentile(variance_um2, 95.0))))
