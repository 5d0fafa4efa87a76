"""Where a finger will be: every predictor's error at two horizons, and what an update and a prediction cost.

Samples as the pad gives them: 88.9 Hz, 0.05 mm of noise on each axis, positions in steps of 0.02 mm, stamps off by up
to 1 ms. The error is the distance, RMS, from the prediction to where the finger truly is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..core.prediction import PREDICTORS, Recipe
from ..sim.fingers import Path, Rest, Strokes
from .tables import Table, finite_rows
from .timing import REPEATS, compare

FloatArray = npt.NDArray[np.float64]
Samples = list[tuple[int, float, float]]

PERIOD_S = 0.01125
NOISE_MM, STEP_MM, STAMP_ERROR_S = 0.05, 0.02, 1e-3
HORIZONS_MS = (15, 25)
WARM_UP = 20  # samples after landing that are not judged: the start has its own tests
SPEED_MM_S = 100.0
DEFAULT = "default"
AHEAD_NS = 15_000_000


@dataclass(frozen=True)
class Straight:
    """A finger that goes straight on for ever."""

    start_mm: tuple[float, float] = (-50.0, -30.0)
    velocity_mm_s: tuple[float, float] = (82.5, 56.5)

    def position_mm(self, t_s: FloatArray) -> FloatArray:
        way_mm: FloatArray = t_s[:, np.newaxis] * np.asarray(self.velocity_mm_s)
        return np.asarray(self.start_mm) + way_mm


def run(*, seeds: Sequence[int] = (1, 2, 3, 4), seconds: float = 6.0, repeats: int = REPEATS) -> Table:
    """Compare all predictors on touches of `seconds`, one for each motion and seed."""
    motions: dict[str, Callable[[int], Path]] = {
        "strokes": lambda seed: Strokes(seed, SPEED_MM_S),
        "straight": lambda _: Straight(),
        "rest": lambda seed: Rest((21.7, -8.3), tremor_mm=0.02, seed=seed),
    }
    touches = {motion: [_sense(path(seed), seconds, seed) for seed in seeds] for motion, path in motions.items()}
    samples = touches["strokes"][0][0]
    times = compare({name: (_timed(recipe, samples), len(samples)) for name, recipe in PREDICTORS.items()}, repeats)
    rows = []
    for name, recipe in PREDICTORS.items():
        errors = {
            f"{motion}_{horizon_ms}ms_mm": _rms_mm([_errors_mm(recipe, *touch, horizon_ms * 1e-3) for touch in played])
            for motion, played in touches.items()
            for horizon_ms in HORIZONS_MS
        }
        rows.append((name, {**times[name].figures(), **errors}))
    return Table(
        name="prediction",
        title="prediction: RMS distance to the true position, on strokes of 10 cm/s, straight slides and at rest",
        default=DEFAULT,
        rows=finite_rows(rows),
        compared=("time_us", "strokes_15ms_mm"),
        time="time_us",
        error="strokes_15ms_mm",
        notes=("time: one update and one prediction of one finger",),
    )


def _sense(path: Path, seconds: float, seed: int) -> tuple[Samples, FloatArray, Path]:
    """What the pad says of a finger, when each sample was truly taken, and the finger's path."""
    rng = np.random.default_rng([seed, 5])
    sampled_s = np.asarray(PERIOD_S * (np.arange(round(seconds / PERIOD_S)) + rng.uniform()), np.float64)
    noisy_mm = path.position_mm(sampled_s) + NOISE_MM * rng.standard_normal((len(sampled_s), 2))
    seen_mm = STEP_MM * np.round(noisy_mm / STEP_MM)
    stamps_s = sampled_s + rng.uniform(-STAMP_ERROR_S, STAMP_ERROR_S, len(sampled_s))
    stamps_ns: list[int] = np.rint(stamps_s * 1e9).astype(np.int64).tolist()
    return [(t_ns, x, y) for t_ns, (x, y) in zip(stamps_ns, seen_mm.tolist(), strict=True)], sampled_s, path


def _errors_mm(recipe: Recipe, samples: Samples, sampled_s: FloatArray, path: Path, ahead_s: float) -> FloatArray:
    predictor = recipe()
    foretold = []
    for sample, t_s in zip(samples, sampled_s.tolist(), strict=True):
        predictor.update(*sample)
        foretold.append(predictor.predict(round((t_s + ahead_s) * 1e9)))
    missed_mm = np.array(foretold) - path.position_mm(sampled_s + ahead_s)
    return np.hypot(missed_mm[:, 0], missed_mm[:, 1])[WARM_UP:]


def _rms_mm(errors_mm: Sequence[FloatArray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(errors_mm) ** 2)))


def _timed(recipe: Recipe, samples: Samples) -> Callable[[], object]:
    def follow() -> None:
        predictor = recipe()
        for t_ns, x_mm, y_mm in samples:
            predictor.update(t_ns, x_mm, y_mm)
            predictor.predict(t_ns + AHEAD_NS)

    return follow
