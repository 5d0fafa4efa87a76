"""Signs against free phases along strokes of two slipping fingers.

Two fingers cross the plate on random straight lines at 100 mm/s, a knot every 2.8 ms, shapes known exactly. Between
knots the board interpolates: a chord on which a finger gets less than at both ends is a sag that it feels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from ..core.solver.arithmetic import Rows
from ..core.solver.public import solve_fast, solve_phased_fast
from ..sim.plate.ground_truth import DRIVEN_MODES, GroundTruth
from .baselines.paper_scheme import invert
from .hard_problems import HALF_SIZE_MM, W_LIMIT_UM
from .tables import Table, finite_rows
from .timing import REPEATS, compare, optional

FloatArray = npt.NDArray[np.float64]
Phasors = npt.NDArray[np.complex128]
Track = list[Rows]  # the mode matrices of one stroke, knot by knot
Way = Callable[[Track, tuple[float, ...]], Sequence[Sequence[complex]]]  # knots of one stroke, targets -> modal_um

KNOT_MM = 0.28  # 2.8 ms: about what `core.pipeline` takes at this speed
KNOTS = 170
NEAR_UM, FAR_UM = (1.0, 0.6), (3.0, 3.0)
ONE_STILL_UM = (1.0, 0.0)
SAG_FRAC = 0.1  # of a finger's amplitude: what counts as a sag


def strokes_mm(strokes: int) -> FloatArray:
    """Positions (strokes, KNOTS, 2 fingers, 2) on lines that stay on the plate."""
    random = np.random.default_rng(17)
    angle = random.uniform(0.0, 2 * np.pi, (strokes, 1, 2))
    heading = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    half_mm = KNOT_MM * KNOTS / 2
    middle_mm = random.uniform(half_mm - HALF_SIZE_MM, HALF_SIZE_MM - half_mm, (strokes, 1, 2, 2))
    return np.asarray(middle_mm + heading * np.linspace(-half_mm, half_mm, KNOTS)[None, :, None, None])


def run(*, strokes: int = 40, repeats: int = REPEATS) -> Table:
    """What two slipping fingers miss, and how often a change of pattern makes one sag."""
    points_mm = strokes_mm(strokes)
    phi = GroundTruth().shapes(points_mm)[..., : len(DRIVEN_MODES)]
    tracks = [rows_of(stroke) for stroke in phi]
    ways: dict[str, Way] = {
        "solve_fast": partial(_walked, solve_fast),
        "paper": partial(_walked, invert),
        "solve_phased_fast": partial(_walked, solve_phased_fast),
    }
    times = _times(ways, tracks, NEAR_UM, repeats)
    rows = []
    for name, way in ways.items():
        near_um, far_um = (np.array([way(track, wanted) for track in tracks]) for wanted in (NEAR_UM, FAR_UM))
        figures = {
            **times[name],
            "error_um": _error_um(phi, near_um, NEAR_UM),
            "far_error_um": _error_um(phi, far_um, FAR_UM),
            "sags_count": float(np.sum(_sags_frac(phi, near_um) > SAG_FRAC)),
            "worst_sag_frac": float(np.max(_sags_frac(phi, near_um))),
            "modal_um": float(np.mean(np.linalg.norm(near_um, axis=-1))),
        }
        rows.append((name, figures))
    optimize, skipped = optional("scipy.optimize"), {}
    if optimize is None:
        skipped["L-BFGS-B"] = "scipy is not installed"
    else:
        rows.append(("L-BFGS-B", _general_minimiser(optimize, phi)))
    return Table(
        name="both_slip",
        title=f"solver, both fingers slip: strokes with targets of {NEAR_UM} um, far: {FAR_UM} um",
        default="solve_fast",
        rows=finite_rows(rows),
        compared=("time_us", "error_um", "far_error_um"),
        time="time_us",
        error="error_um",
        skipped=skipped,
        notes=(
            f"sags: chords between knots on which a finger gets {SAG_FRAC:.0%} less than at both ends",
            "L-BFGS-B: magnitudes and phase of every tenth knot by a general minimiser, from four starts",
        ),
    )


def _walked(solve: Callable[..., Any], track: Track, wanted_um: tuple[float, ...]) -> list[Sequence[complex]]:
    """Modal amplitudes knot by knot, each solved from the last one's."""
    previous: Sequence[complex] | None = None
    found = []
    for rows in track:
        previous, _ = solve(rows, wanted_um, W_LIMIT_UM, previous)
        assert previous is not None
        found.append(previous)
    return found


def _general_minimiser(optimize: Any, phi: FloatArray) -> dict[str, float]:
    """The least errors over two magnitudes and the phase between, knot by knot: a bound for all phasors."""
    some = phi[:, ::10].reshape(-1, 2, 2)
    bounds = [(0.0, limit) for limit in W_LIMIT_UM] + [(0.0, np.pi)]
    starts = [(x, x, angle) for x in (1.0, 3.0) for angle in (0.3, 2.8)]
    found = {}
    for name, wanted in (("error_um", NEAR_UM), ("far_error_um", FAR_UM)):
        target = np.array(wanted)

        def missed(v: FloatArray, one: FloatArray, target: FloatArray = target) -> float:
            return float(np.sum((np.abs(one @ np.array([v[0], v[1] * np.exp(1j * v[2])])) - target) ** 2))

        least = [min(optimize.minimize(missed, at, args=(one,), bounds=bounds).fun for at in starts) for one in some]
        found[name] = float(np.sqrt(np.mean(least) / 2))
    return found


# --- figures --------------------------------------------------------------------------------------------------------


def rows_of(phi: FloatArray) -> list[Rows]:
    """Mode matrices (K, N, M) as the solver takes them, one by one."""
    return [tuple(map(tuple, rows)) for rows in phi.tolist()]


def _times(
    ways: dict[str, Way], tracks: Sequence[Track], wanted_um: tuple[float, ...], repeats: int
) -> dict[str, dict[str, float]]:
    def all_tracks(way: Way) -> None:
        for track in tracks:
            way(track, wanted_um)

    knots = sum(len(track) for track in tracks)
    timed = compare({name: (partial(all_tracks, way), knots) for name, way in ways.items()}, repeats)
    return {name: timing.figures() for name, timing in timed.items()}


def _error_um(phi: FloatArray, modal_um: Phasors, wanted_um: tuple[float, ...]) -> float:
    return rms(np.abs(np.einsum("sknm,skm->skn", phi, modal_um)) - np.array(wanted_um))


def _sags_frac(phi: FloatArray, modal_um: Phasors) -> FloatArray:
    """How far each finger falls below both ends of each chord, as a share of the lesser."""
    ends_um = np.abs(np.einsum("sknm,skm->skn", phi, modal_um))
    shapes, chords_um = (phi[:, 1:] + phi[:, :-1]) / 2, (modal_um[:, 1:] + modal_um[:, :-1]) / 2
    middle_um = np.abs(np.einsum("sknm,skm->skn", shapes, chords_um))
    lesser_um = np.minimum(ends_um[:, 1:], ends_um[:, :-1])
    return np.asarray(np.where(lesser_um > 0.0, 1.0 - middle_um / np.maximum(lesser_um, 1e-12), 0.0))


def rms(values: FloatArray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))
