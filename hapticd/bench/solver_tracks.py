"""What the solver's freedoms are worth on the way: signs and phases along strokes.

Two fingers cross the plate on random straight lines at 100 mm/s, a knot every 2.8 ms, shapes known exactly. Between
knots the board interpolates: a chord on which a finger gets less than at both ends is a sag that it feels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from ..core.solver.policies import Rows
from ..core.solver.public import solve_fast, solve_phased_fast
from ..sim.plate.ground_truth import DRIVEN_MODES, GroundTruth
from .modes import HALF_SIZE_MM, W_LIMIT_UM
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


def run(*, strokes: int = 40, repeats: int = REPEATS) -> tuple[Table, Table]:
    """Both tables, of the same `strokes`."""
    points_mm = strokes_mm(strokes)
    return both_slip(points_mm, repeats), one_still(points_mm, repeats)


def strokes_mm(strokes: int) -> FloatArray:
    """Positions (strokes, KNOTS, 2 fingers, 2) on lines that stay on the plate."""
    random = np.random.default_rng(17)
    angle = random.uniform(0.0, 2 * np.pi, (strokes, 1, 2))
    heading = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    half_mm = KNOT_MM * KNOTS / 2
    middle_mm = random.uniform(half_mm - HALF_SIZE_MM, HALF_SIZE_MM - half_mm, (strokes, 1, 2, 2))
    return np.asarray(middle_mm + heading * np.linspace(-half_mm, half_mm, KNOTS)[None, :, None, None])


# --- both fingers slip ----------------------------------------------------------------------------------------------


def both_slip(points_mm: FloatArray, repeats: int = REPEATS) -> Table:
    """Signs against phases: what two slipping fingers miss, and how often a change of pattern makes one sag."""
    phi = GroundTruth().shapes(points_mm)[..., : len(DRIVEN_MODES)]
    tracks = [rows_of(stroke) for stroke in phi]
    ways: dict[str, Way] = {
        "solve_fast": _signs,
        "solve_fast, hysteresis 0.05": lambda track, wanted_um: _signs(track, wanted_um, hysteresis=0.05),
        "solve_fast, paper": lambda track, wanted_um: _signs(track, wanted_um, policy="paper"),
        "solve_phased_fast": _phases,
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


def _signs(
    track: Track,
    wanted_um: tuple[float, ...],
    *,
    policy: str = "keep_zero",
    effort: float = 0.0,
    hysteresis: float = 0.0,
) -> list[tuple[float, ...]]:
    limits = (W_LIMIT_UM[0],) * len(track[0][0])
    previous: tuple[float, ...] | None = None
    told = []
    for rows in track:
        previous, _ = solve_fast(rows, wanted_um, limits, previous, policy, effort, hysteresis)
        told.append(previous)
    return told


def _phases(track: Track, wanted_um: tuple[float, ...]) -> list[tuple[complex, ...]]:
    previous: tuple[complex, ...] | None = None
    told = []
    for rows in track:
        previous, _ = solve_phased_fast(rows, wanted_um, W_LIMIT_UM, previous)
        told.append(previous)
    return told


def _general_minimiser(optimize: Any, phi: FloatArray) -> dict[str, float]:
    """What is least over two magnitudes and the phase between, knot by knot: the bound for all phasors."""
    some = phi[:, ::10].reshape(-1, 2, 2)
    bounds = [(0.0, limit) for limit in W_LIMIT_UM] + [(0.0, np.pi)]
    starts = [(x, x, angle) for x in (1.0, 3.0) for angle in (0.3, 2.8)]
    told = {}
    for name, wanted in (("error_um", NEAR_UM), ("far_error_um", FAR_UM)):
        target = np.array(wanted)

        def missed(v: FloatArray, one: FloatArray, target: FloatArray = target) -> float:
            return float(np.sum((np.abs(one @ np.array([v[0], v[1] * np.exp(1j * v[2])])) - target) ** 2))

        least = [min(optimize.minimize(missed, at, args=(one,), bounds=bounds).fun for at in starts) for one in some]
        told[name] = float(np.sqrt(np.mean(least) / 2))
    return told


# --- one finger is still --------------------------------------------------------------------------------------------


def one_still(points_mm: FloatArray, repeats: int = REPEATS) -> Table:
    """The reference's steps from knot to knot, largest at singular positions, and the slipping finger's share."""
    shapes = GroundTruth().shapes(points_mm)
    side = np.sign(np.linalg.det(shapes[..., : len(DRIVEN_MODES)]))
    crosses = side[:, 1:] != side[:, :-1]
    ways: dict[str, tuple[int, Way]] = {
        "solve_fast": (2, _signs),
        "solve_fast, effort 0.02": (2, lambda track, wanted_um: _signs(track, wanted_um, effort=0.02)),
        "solve_fast, least_squares": (2, lambda track, wanted_um: _signs(track, wanted_um, policy="least_squares")),
        "solve_fast, paper": (2, lambda track, wanted_um: _signs(track, wanted_um, policy="paper")),
        "solve_phased_fast": (2, _phases),
        "solve_fast, 3 modes": (3, _signs),
        "solve_fast, 4 modes": (4, _signs),
    }
    rows = []
    for name, (modes, way) in ways.items():
        phi = shapes[..., :modes]
        tracks = [rows_of(stroke) for stroke in phi]
        modal_um = np.array([way(track, ONE_STILL_UM) for track in tracks])
        got_um = np.abs(np.einsum("sknm,skm->skn", phi, modal_um))
        steps_um = np.max(np.abs(np.diff(modal_um, axis=1)), axis=-1)
        figures = {
            **_times({name: way}, tracks[:5], ONE_STILL_UM, repeats)[name],
            "singular_step_um": float(np.max(steps_um[crosses])),
            "usual_singular_step_um": float(np.median(steps_um[crosses])),
            "largest_step_um": float(np.max(steps_um)),
            "usual_step_um": float(np.median(steps_um)),
            "share_frac": float(np.mean(np.minimum(got_um[..., 0] / ONE_STILL_UM[0], 1.0))),
            "leak_um": float(np.sqrt(np.mean(got_um[..., 1] ** 2))),
        }
        rows.append((name, figures))
    return Table(
        name="one_still",
        title="solver, one finger still, one at 1 um: strokes; the reference's step from knot to knot of 2.8 ms",
        default="solve_fast",
        rows=finite_rows(rows),
        compared=("singular_step_um", "share_frac"),
        time="time_us",
        error="singular_step_um",
        notes=(
            f"singular step: where the two-mode matrix changes the sign of its determinant, {np.sum(crosses)} times",
            "with one finger still, two modes leave one line: its share is the most that limits and zero allow",
            "3, 4 modes: the plate's neighbouring pair as if it were driven, within the same limits",
        ),
    )


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
    """Over all of them."""
    return float(np.sqrt(np.mean(values**2)))
