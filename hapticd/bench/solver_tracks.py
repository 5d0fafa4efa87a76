"""What the solver's freedoms are worth on the way: signs and phases along strokes, discs in place of points, sizes.

Two fingers cross the plate on random straight lines at 100 mm/s, a knot every 2.8 ms, shapes known exactly. Between
knots the board interpolates: a chord on which a finger gets less than at both ends is a sag that it feels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from ..core.solver import solve, solve_batch, solve_fast, solve_phased_fast
from ..core.solver_contact import principal_axis
from ..core.solver_policies import Rows
from ..sim.plate import DRIVEN_MODES, PlateTruth
from .modes import HALF_SIZE_MM, W_LIMIT_UM
from .tables import Table, finite_rows
from .timing import REPEATS, compare, optional

FloatArray = npt.NDArray[np.float64]
Phasors = npt.NDArray[np.complex128]
Pairs = list[Rows]  # the mode matrices of one stroke, or of several pairs of positions
Way = Callable[[Pairs, tuple[float, ...]], Sequence[Sequence[complex]]]  # knots of one stroke, targets -> modal_um

KNOT_MM = 0.28  # 2.8 ms: about what `core.pipeline` takes at this speed
KNOTS = 170
NEAR_UM, FAR_UM = (1.0, 0.6), (3.0, 3.0)
ONE_STILL_UM = (1.0, 0.0)
SAG_FRAC = 0.1  # of a finger's amplitude: what counts as a sag
CONTACT_RADIUS_MM = 5.0
SIZES = ((1, 1), (2, 1), (1, 2), (2, 2), (3, 2), (15, 2), (2, 3), (3, 3), (5, 4), (8, 8), (15, 8))


def run(*, strokes: int = 40, repeats: int = REPEATS, pairs: int = 400, calls: int = 20) -> tuple[Table, ...]:
    """All tables: `strokes` for the first two, `pairs` of random positions for discs, `calls` for each size."""
    points_mm = strokes_mm(strokes)
    return (
        both_slip(points_mm, repeats),
        one_still(points_mm, repeats),
        contacts(pairs, repeats),
        sizes(calls, repeats),
    )


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
    phi = PlateTruth().shapes(points_mm)[..., : len(DRIVEN_MODES)]
    tracks = [_pairs(stroke) for stroke in phi]
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
    track: Pairs,
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


def _phases(track: Pairs, wanted_um: tuple[float, ...]) -> list[tuple[complex, ...]]:
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
    shapes = PlateTruth().shapes(points_mm)
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
        tracks = [_pairs(stroke) for stroke in phi]
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


# --- discs ----------------------------------------------------------------------------------------------------------


def contacts(pairs: int = 400, repeats: int = REPEATS) -> Table:
    """Points against discs: what the still finger's whole contact gets, RMS over a radius of 5 mm."""
    half_mm = HALF_SIZE_MM - CONTACT_RADIUS_MM
    points_mm = np.random.default_rng(19).uniform(-half_mm, half_mm, (pairs, 2, 2))
    phi = PlateTruth().shapes(points_mm)[..., : len(DRIVEN_MODES)]
    gram = _gram(points_mm[:, 1], CONTACT_RADIUS_MM)
    both = np.stack([np.zeros_like(gram), gram], axis=1)
    solved: dict[str, Callable[[], Any]] = {
        "point": lambda: [solve_fast(rows, ONE_STILL_UM, W_LIMIT_UM)[0] for rows in _pairs(phi)],
        "disc": lambda: [
            solve_fast((rows[0], principal_axis(xx, xy, yy)), ONE_STILL_UM, W_LIMIT_UM)[0]
            for rows, ((xx, xy), (_, yy)) in zip(_pairs(phi), gram.tolist(), strict=True)
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
            "contact_leak_um": _rms(contact_um),
            "point_leak_um": _rms(got_um[:, 1]),
            "share_frac": float(np.mean(np.minimum(got_um[:, 0], 1.0))),
            "leak_um_per_um": _rms(contact_um) / _rms(got_um[:, 0]),
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
    phi = PlateTruth().shapes(centres_mm[:, None] + offsets_mm.reshape(1, -1, 2))[..., : len(DRIVEN_MODES)]
    return np.asarray(np.einsum("kpm,kpl->kml", phi, phi) / phi.shape[1])


def _least_leak(phi: FloatArray, gram: FloatArray) -> list[FloatArray]:
    told = []
    for (slipping, _), disc in zip(phi, gram, strict=True):
        modal_um = np.linalg.solve(disc, slipping)
        modal_um *= ONE_STILL_UM[0] / (slipping @ modal_um)
        told.append(modal_um / max(1.0, float(np.max(np.abs(modal_um) / W_LIMIT_UM))))
    return told


# --- sizes ----------------------------------------------------------------------------------------------------------


def sizes(calls: int = 20, repeats: int = REPEATS) -> Table:
    """What a solve takes with N fingers and M modes, one of three fingers still, half of them out of reach."""
    random = np.random.default_rng(23)
    ways: dict[str, tuple[Callable[[], object], int]] = {}
    for fingers, modes in SIZES:
        problems = [_pairs(random.uniform(-1, 1, (1, fingers, modes)))[0] for _ in range(calls)]
        targets = tuple(0.0 if index % 3 == 2 else 0.5 + index % 2 * 3.0 for index in range(fingers))
        limits = (2.0,) * modes
        for policy in ("keep_zero", "priority"):
            name = f"{policy}, {fingers} on {modes}"
            ways[name] = partial(_solve_all, problems, targets, limits, policy), calls
    times = compare(ways, repeats)
    return Table(
        name="sizes",
        title="solver: time of a call with N fingers on M modes",
        default="keep_zero, 2 on 2",
        rows=finite_rows([(name, timing.figures()) for name, timing in times.items()]),
        compared=("time_us",),
    )


def _solve_all(problems: Pairs, targets: tuple[float, ...], limits: tuple[float, ...], policy: str) -> None:
    for rows in problems:
        solve_fast(rows, targets, limits, None, policy)


# --- figures --------------------------------------------------------------------------------------------------------


def _pairs(phi: FloatArray) -> Pairs:
    return [tuple(map(tuple, rows)) for rows in phi.tolist()]


def _times(
    ways: dict[str, Way], tracks: Sequence[Pairs], wanted_um: tuple[float, ...], repeats: int
) -> dict[str, dict[str, float]]:
    def all_tracks(way: Way) -> None:
        for track in tracks:
            way(track, wanted_um)

    knots = sum(len(track) for track in tracks)
    timed = compare({name: (partial(all_tracks, way), knots) for name, way in ways.items()}, repeats)
    return {name: timing.figures() for name, timing in timed.items()}


def _error_um(phi: FloatArray, modal_um: Phasors, wanted_um: tuple[float, ...]) -> float:
    return _rms(np.abs(np.einsum("sknm,skm->skn", phi, modal_um)) - np.array(wanted_um))


def _sags_frac(phi: FloatArray, modal_um: Phasors) -> FloatArray:
    """How far each finger falls below both ends of each chord, as a share of the lesser."""
    ends_um = np.abs(np.einsum("sknm,skm->skn", phi, modal_um))
    shapes, chords_um = (phi[:, 1:] + phi[:, :-1]) / 2, (modal_um[:, 1:] + modal_um[:, :-1]) / 2
    middle_um = np.abs(np.einsum("sknm,skm->skn", shapes, chords_um))
    lesser_um = np.minimum(ends_um[:, 1:], ends_um[:, :-1])
    return np.asarray(np.where(lesser_um > 0.0, 1.0 - middle_um / np.maximum(lesser_um, 1e-12), 0.0))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
