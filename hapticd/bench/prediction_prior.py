"""Fit of `core.prediction.prior`: `python -m hapticd.bench.prediction_prior TRACES.npz > .../prior.py`.

The traces (`traces`) are public recordings of real touches: zhaorz/Touch-Calculator, whot/evemu-devices,
bentiss/hid-devices, interactionlab/MobileHCI17-Touch-Extrapolation and others, 132 000 samples of 40 devices. The
synthetic motions of `motions` count as SYNTHETIC devices more, so that a pad of white noise is not forgotten.

For each device the normal equations of its corrections are summed as the predictor forms them. The prior is the normal
distribution of the devices' weights, by expectation maximisation (empirical Bayes; Dempster, Laird, Rubin 1977), where
CORRELATED neighbouring samples count as one. The spreads are medians over the devices.

`--check` prints what a group of devices gets from the prior of all others instead, `--check --kinds` what a kind of
devices gets, all vendors together.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.prediction.adaptive import AdaptiveMotion, Estimate
from ..core.prediction.motion import MotionModel, Sample
from ..core.prediction.pad_memory import CLASSES, FAR_S, NEAR_S, HorizonFit, PadMemory
from ..core.prediction.predictor import Predictor
from ..core.prediction.prior import Prior, Vector
from ..core.touch.sample_clock import SampleClock
from ..tools.touches import FloatArray, Trace
from .motions import MOTIONS, touch
from .tables import render
from .traces import by_device, load

SYNTHETIC = 18
CORRELATED = 20.0
HORIZONS_S = (NEAR_S, FAR_S)
SEEDS = range(6)
FIRST_SAMPLES = 3
LEAST_VARIANCE_MM2 = 1e-5
STEPS = 30
ORDER = 5

Touches = Iterable[list[tuple[int, float, float]]]


class Sums(NamedTuple):
    """Normal equations of one device at one horizon: f f^T, f d, d d and the number of d."""

    matrix: FloatArray
    right: FloatArray
    squares: float
    number: int


class Gathering(MotionModel):
    """The default model, with its estimates and samples of each train of samples kept."""

    def __init__(self, memory: PadMemory | None = None) -> None:
        self._model = AdaptiveMotion(period_ms=11.25, memory=memory)
        self.trains: list[list[tuple[Estimate, float, float]]] = []

    def start(self, x_mm: float, y_mm: float) -> None:
        self._model.start(x_mm, y_mm)
        self.trains.append([(self._model.estimate, x_mm, y_mm)])

    def step(self, sample: Sample) -> None:
        self._model.step(sample)
        self.trains[-1].append((self._model.estimate, sample.x_mm, sample.y_mm))


def gathered(touches: Touches, memory: PadMemory | None = None) -> list[list[tuple[Estimate, float, float]]]:
    """Estimates and samples of all trains of samples."""
    trains = []
    for samples in touches:
        model = Gathering(memory)
        predictor = Predictor(lambda model=model: model, partial(SampleClock, 0.01125, 0.001, 0.0006))  # type: ignore[misc]
        for sample in samples:
            predictor.update(*sample)
        trains += model.trains
    return trains


def corrections(touches: Touches, ahead_s: float) -> tuple[FloatArray, FloatArray, list[int]]:
    """Corrections (n, 2, ORDER), what they should have added up to (n, 2), and classes of speed (n,), of all
    predictions that teach."""
    features, lacked, places = [], [], []
    for train in gathered(touches):
        t_s, x, y = np.array([(now.t_s, x_mm, y_mm) for now, x_mm, y_mm in train]).T
        for now, _, _ in train[FIRST_SAMPLES:]:
            if now.t_s + ahead_s > t_s[-1]:
                break
            if not now.is_jump:
                then = [np.interp(now.t_s + ahead_s, t_s, axis) for axis in (x, y)]
                features.append(now.corrections(ahead_s))
                places.append(now.speed_class())
                lacked.append((then[0] - now.x - ahead_s * now.vx, then[1] - now.y - ahead_s * now.vy))
    return np.array(features).reshape(-1, 2, ORDER), np.array(lacked).reshape(-1, 2), places


def sums(touches: Touches, ahead_s: float) -> Sums:
    """Normal equations of a device."""
    features, lacked, _ = corrections(touches, ahead_s)
    rows, right = features.reshape(-1, ORDER), lacked.ravel()
    return Sums(rows.T @ rows, rows.T @ right, float(right @ right), len(right))


def fitted(devices: Sequence[Sums]) -> tuple[FloatArray, FloatArray]:
    """Mean (ORDER,) and covariance (ORDER, ORDER) of the devices' weights."""
    evidence = []
    for matrix, right, squares, number in devices:
        ridge = 1e-6 * np.trace(matrix) / ORDER * np.eye(ORDER)
        own = np.linalg.solve(matrix + ridge, right)
        left = float(squares - 2.0 * own @ right + own @ matrix @ own)
        variance = CORRELATED * max(left / number, LEAST_VARIANCE_MM2)
        evidence.append((matrix / variance, right / variance))
    mean, covariance = np.zeros(ORDER), 0.3 * np.eye(ORDER)
    for _ in range(STEPS):
        precision = np.linalg.inv(covariance)
        posteriors = [np.linalg.inv(matrix + precision) for matrix, _ in evidence]
        weights = np.array(
            [own @ (right + precision @ mean) for own, (_, right) in zip(posteriors, evidence, strict=True)]
        )
        mean = weights.mean(axis=0)
        covariance = (weights - mean).T @ (weights - mean) / len(weights) + np.mean(posteriors, axis=0)
        covariance += 1e-4 * np.eye(ORDER)
    return mean, covariance


def prior_of(mean: FloatArray, covariance: FloatArray) -> Prior:
    """As the core has it."""
    rows = np.linalg.inv(covariance).tolist()
    return Prior(_vector(mean.tolist()), (*(_vector(row) for row in rows),))  # type: ignore[arg-type]


def _vector(values: Sequence[float]) -> Vector:
    a, b, c, d, e = (float(f"{value:.6g}") for value in values)
    return a, b, c, d, e


def memory_of(priors: Sequence[Prior]) -> PadMemory:
    """A memory that begins with another prior."""
    memory = PadMemory()
    memory.near, memory.far = (HorizonFit(prior) for prior in priors)
    return memory


def all_sums(traces: list[Trace]) -> dict[str, list[Sums]]:
    """Normal equations by device at each horizon; the synthetic motions under ""."""
    synthetic = [touch(motion, seed).samples for motion in MOTIONS.values() for seed in SEEDS]
    touches = {device: [trace.samples for trace in some] for device, some in by_device(traces).items()}
    return {name: [sums(some, ahead_s) for ahead_s in HORIZONS_S] for name, some in {**touches, "": synthetic}.items()}


def priors_without(group: str | None, found: Mapping[str, list[Sums]], groups: Mapping[str, str]) -> list[Prior]:
    """The prior at each horizon of all devices but those of a group."""
    devices = [horizons for name, horizons in found.items() if name and groups[name] != group]
    devices += [found[""]] * SYNTHETIC
    return [prior_of(*fitted(at_horizon)) for at_horizon in zip(*devices, strict=True)]


def spreads_mm(traces: list[Trace], priors: Sequence[Prior]) -> FloatArray:
    """Spreads (horizon, along or across, class of speed), medians over the devices of 68 % quantiles."""
    by_horizon: list[list[FloatArray]] = [[] for _ in HORIZONS_S]
    for some in by_device(traces).values():
        memory = memory_of(priors)
        for _ in range(2):
            gathered((trace.samples for trace in some), memory)
        for place, ahead_s in enumerate(HORIZONS_S):
            fit = memory.near if place == 0 else memory.far
            by_horizon[place].append(_device_spreads_mm(some, ahead_s, np.array(fit.weights)))
    medians: FloatArray = np.nanmedian(np.array(by_horizon), axis=1)
    return medians


def _device_spreads_mm(traces: list[Trace], ahead_s: float, weights: FloatArray) -> FloatArray:
    features, lacked, places = corrections((trace.samples for trace in traces), ahead_s)
    errors = lacked - features @ weights
    velocity = features[:, :, 0] / ahead_s
    speed = np.hypot(*velocity.T)
    unit = velocity / np.maximum(speed, 1e-9)[:, None]
    sizes = np.abs(np.stack(((errors * unit).sum(1), errors[:, 1] * unit[:, 0] - errors[:, 0] * unit[:, 1])))
    classes = np.array(places)
    found = np.full((2, CLASSES), np.nan)
    for place in range(CLASSES):
        if np.count_nonzero(classes == place) >= 30:
            found[:, place] = np.quantile(sizes[:, classes == place], 0.6827, axis=1)
    return found


def main() -> None:
    """Print the module, or the check."""
    traces = load(Path(sys.argv[1]))
    found = all_sums(traces)
    group_of = attrgetter("kind" if "--kinds" in sys.argv else "group")
    groups = {trace.device: group_of(trace) for trace in traces}
    if "--check" in sys.argv:
        from .prediction_traces import compared, tables

        unseen = {group: priors_without(group, found, groups) for group in sorted(set(groups.values()))}
        checked = tables(compared(traces, lambda group: memory_of(unseen[group]), group_of))
        print("\n\n".join(map(render, checked)))
        return
    priors = priors_without(None, found, groups)
    print(module_text(priors, spreads_mm(traces, priors)))


def module_text(priors: Sequence[Prior], spreads: FloatArray) -> str:
    """The text of `core.prediction.prior`."""
    head = Path(__file__).parent.parent / "core" / "prediction" / "prior.py"
    return head.read_text().split("# --- fitted ---")[0] + _constants(priors, spreads)


def _constants(priors: Sequence[Prior], spreads: FloatArray) -> str:
    lines = ["# --- fitted ---\n"]
    for name, prior in zip(("NEAR", "FAR"), priors, strict=True):
        rows = "".join(f"        {row},\n" for row in prior.precision)
        lines.append(f"\n{name}: Final = Prior(\n    {prior.mean},\n    (\n{rows}    ),\n)\n")
    rounded = [[tuple(float(f"{value:.3g}") for value in row) for row in horizon] for horizon in spreads]
    body = "".join("    (\n" + "".join(f"        {row},\n" for row in horizon) + "    ),\n" for horizon in rounded)
    lines.append("\n# Along and across the motion, at both horizons, by class of speed.\n")
    lines.append(f"SPREADS_MM: Final[tuple[Spreads, Spreads]] = (\n{body})\n")
    return "".join(lines).rstrip("\n")


if __name__ == "__main__":
    main()
