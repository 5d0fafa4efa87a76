"""What discs in place of points are worth: how much a still finger's whole contact gets, RMS over a radius of 5 mm,
beside one that slips.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ..core.solver.contacts import principal_axis
from ..core.solver.public import solve, solve_batch, solve_fast
from ..sim.plate.ground_truth import DRIVEN_MODES, GroundTruth
from .modes import HALF_SIZE_MM, W_LIMIT_UM
from .solver_tracks import ONE_STILL_UM, rms, rows_of
from .tables import Table, finite_rows
from .timing import REPEATS, compare

FloatArray = npt.NDArray[np.float64]

CONTACT_RADIUS_MM = 5.0


def run(*, pairs: int = 400, repeats: int = REPEATS) -> Table:
    """Compare points and discs on `pairs` of random positions."""
    half_mm = HALF_SIZE_MM - CONTACT_RADIUS_MM
    points_mm = np.random.default_rng(19).uniform(-half_mm, half_mm, (pairs, 2, 2))
    phi = GroundTruth().shapes(points_mm)[..., : len(DRIVEN_MODES)]
    gram = _gram(points_mm[:, 1], CONTACT_RADIUS_MM)
    both = np.stack([np.zeros_like(gram), gram], axis=1)
    solved: dict[str, Callable[[], Any]] = {
        "point": lambda: [solve_fast(rows, ONE_STILL_UM, W_LIMIT_UM)[0] for rows in rows_of(phi)],
        "disc": lambda: [
            solve_fast((rows[0], principal_axis(xx, xy, yy)), ONE_STILL_UM, W_LIMIT_UM)[0]
            for rows, ((xx, xy), (_, yy)) in zip(rows_of(phi), gram.tolist(), strict=True)
        ],
        "disc, solve with gram": lambda: [
            solve(rows, ONE_STILL_UM, W_LIMIT_UM, gram=[np.zeros((2, 2)), disc]).modal_um
            for rows, disc in zip(phi, gram, strict=True)
        ],
        "disc, solve_batch with gram": lambda: solve_batch(phi, ONE_STILL_UM, W_LIMIT_UM, gram=both),
        "least leak for its amplitude": lambda: _least_leak(phi, gram),
    }
    times = compare({name: (way, pairs) for name, way in solved.items()}, repeats)
    rows = []
    for name, way in solved.items():
        modal_um = np.array(way())
        got_um = np.abs(np.einsum("knm,km->kn", phi, modal_um))
        contact_um = np.sqrt(np.einsum("km,kml,kl->k", modal_um, gram, modal_um))
        figures = {
            **times[name].figures(),
            "contact_leak_um": rms(contact_um),
            "point_leak_um": rms(got_um[:, 1]),
            "share_frac": float(np.mean(np.minimum(got_um[:, 0], 1.0))),
            "leak_um_per_um": rms(contact_um) / rms(got_um[:, 0]),
        }
        rows.append((name, figures))
    return Table(
        name="contacts",
        title=f"solver, contacts of {CONTACT_RADIUS_MM:g} mm radius: RMS over the still finger's, random pairs",
        default="point",
        rows=finite_rows(rows),
        compared=("time_us", "contact_leak_um"),
        time="time_us",
        error="contact_leak_um",
        notes=("least leak for its amplitude: W along G^-1 phi of the slipping finger, no zero anywhere",),
    )


def _gram(centres_mm: FloatArray, radius_mm: float) -> FloatArray:
    """The mean of phi phi' over discs (K, 2, 2): seven rings of fourteen points of equal area."""
    radii_mm = radius_mm * np.sqrt((np.arange(7) + 0.5) / 7)
    angle = 2 * np.pi * (np.arange(14)[None] / 14 + np.arange(7)[:, None] / 3)
    offsets_mm = np.stack([radii_mm[:, None] * np.cos(angle), radii_mm[:, None] * np.sin(angle)], axis=-1)
    phi = GroundTruth().shapes(centres_mm[:, None] + offsets_mm.reshape(1, -1, 2))[..., : len(DRIVEN_MODES)]
    return np.asarray(np.einsum("kpm,kpl->kml", phi, phi) / phi.shape[1])


def _least_leak(phi: FloatArray, gram: FloatArray) -> list[FloatArray]:
    told = []
    for (slipping, _), disc in zip(phi, gram, strict=True):
        modal_um = np.linalg.solve(disc, slipping)
        modal_um *= ONE_STILL_UM[0] / (slipping @ modal_um)
        told.append(modal_um / max(1.0, float(np.max(np.abs(modal_um) / W_LIMIT_UM))))
    return told
