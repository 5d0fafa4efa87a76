"""Predictors on touches that pads recorded: error by group of devices, and whether its covariance is true.

Truth is the pad's own report 15 and 25 ms later, on the straight line between two reports. The default keeps what it
learns of a device over its traces; the others begin with each trace. A trace's first samples do not count.
The form of the file is in this folder's README.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.prediction.pad_memory import CLASSES, SLOWEST_MM_S, PadMemory, speed_class
from ..core.prediction.predictor import DEFAULT as FACTORY
from ..core.prediction.predictor import Predictor
from ..errors import UsageError, reason
from ..formats.npz import arrays_of
from ..regular_file import read_bounded
from ..tools.touches import Trace
from ..values import FloatArray
from .baselines import PREDICTORS
from .tables import Table, finite_rows

DEFAULT, RIVALS = "default", ("linear", "kalman_cv")
AHEADS_MS = (15, 25)
WARM_UP = 3
ALL = "all (geometric mean)"
LEAST_COUNT = 100  # of predictions in a class of speed
MAX_BYTES = 1 << 26  # of the file, and of an array in it: four million samples


def load(path: Path) -> list[Trace]:
    """Read the traces, those of one device together. Raises UsageError."""
    try:
        file = arrays_of(read_bounded(path, MAX_BYTES), [("t_s", "xy_mm", "trace", "device")], MAX_BYTES)
        t_s, xy_mm = file["t_s"].astype(np.float64), file["xy_mm"].astype(np.float64)
        number, devices = file["trace"].astype(np.int64), [str(name) for name in file["device"]]
    except (OSError, ValueError, KeyError, TypeError, OverflowError) as error:
        raise UsageError(f"--traces {path}: cannot be read ({reason(error)}): see hapticd/bench/README.md.") from None
    if not (t_s.shape == number.shape and xy_mm.shape == (len(t_s), 2) and len(t_s) > 0):
        raise UsageError(f"--traces {path}: t_s, trace and xy_mm must have one entry a sample, xy_mm two columns.")
    if np.any(np.diff(number) < 0) or number[0] < 0 or number[-1] >= len(devices):
        raise UsageError(f"--traces {path}: trace must not decrease, and count the names in device from 0.")
    if not (np.isfinite(t_s).all() and np.isfinite(xy_mm).all()):
        raise UsageError(f"--traces {path}: every stamp and position must be finite.")
    edges = np.searchsorted(number, np.arange(len(devices) + 1))
    traces = [Trace(name, t_s[a:b], xy_mm[a:b]) for name, a, b in zip(devices, edges[:-1], edges[1:], strict=True)]
    return sorted((trace for trace in traces if len(trace.t_s) > 1), key=lambda trace: trace.device)


def by_device(traces: list[Trace]) -> dict[str, list[Trace]]:
    """Traces of each device, by its name; `traces` of one device are together."""
    return {device: list(some) for device, some in groupby(traces, key=lambda trace: trace.device)}


class Errors(NamedTuple):
    """Of one predictor on the traces of a device, by horizon: errors (n, 2), deviations (n, 2) and speeds (n,)."""

    error_mm: list[FloatArray]
    sigma_mm: list[FloatArray]
    speed_mm_s: list[FloatArray]


def run(traces: list[Trace]) -> tuple[Table, Table]:
    """Compare the default with the simple predictors on the traces, and check its covariance."""
    return tables(compared(traces))


def tables(found: Mapping[str, Mapping[str, Errors]]) -> tuple[Table, Table]:
    """Tables of errors by group and of the covariance by speed."""
    return _errors(found), _coverage([predictors[DEFAULT] for predictors in found.values()])


def compared(
    traces: list[Trace],
    memory: Callable[[str], PadMemory] = lambda _: PadMemory(),
    group_of: Callable[[Trace], str] = lambda trace: trace.group,
) -> dict[str, dict[str, Errors]]:
    """Errors by group of devices and predictor; `memory` makes the default's for a device of a group."""
    found: dict[str, dict[str, list[Errors]]] = {}
    for some in by_device(traces).values():
        name = group_of(some[0])
        group = found.setdefault(name, {name: [] for name in (DEFAULT, *RIVALS)})
        kept = memory(name)
        group[DEFAULT].append(errors(lambda kept=kept: FACTORY(memory=kept), some))  # type: ignore[misc]
        for rival in RIVALS:
            group[rival].append(errors(PREDICTORS[rival], some))
    return {
        name: {predictor: _joined(parts) for predictor, parts in predictors.items()}
        for name, predictors in sorted(found.items())
    }


def errors(make: Callable[[], Predictor], traces: Sequence[Trace]) -> Errors:
    """Errors of one predictor a trace."""
    found = Errors([], [], [])
    for ahead_ms in AHEADS_MS:
        parts = [_trace_errors(make(), trace, 1e-3 * ahead_ms) for trace in traces]
        for column, values in zip(found, zip(*parts, strict=True), strict=True):
            column.append(np.concatenate(values))
    return found


def _trace_errors(predictor: Predictor, trace: Trace, ahead_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    predicted, sigma, speed = [], [], []
    for t_ns, x_mm, y_mm in trace.samples:
        predictor.update(t_ns, x_mm, y_mm)
        t_ahead_ns = t_ns + round(ahead_s * 1e9)
        predicted.append(predictor.predict(t_ahead_ns))
        xx, _, yy = predictor.covariance(t_ahead_ns)
        sigma.append((math.sqrt(xx), math.sqrt(yy)))
        speed.append(math.hypot(*predictor.velocity(t_ns)))
    t_s = trace.t_s + ahead_s
    is_known = (t_s <= trace.t_s[-1]) & (np.arange(len(t_s)) >= WARM_UP)
    truth_mm = np.stack([np.interp(t_s, trace.t_s, axis) for axis in trace.xy_mm.T], axis=-1)
    return (np.array(predicted) - truth_mm)[is_known], np.array(sigma)[is_known], np.array(speed)[is_known]


def _joined(parts: Sequence[Errors]) -> Errors:
    return Errors(
        *([np.concatenate(horizon) for horizon in zip(*column, strict=True)] for column in zip(*parts, strict=True))
    )


def rms_mm(found: Errors, place: int) -> float:
    """RMS error at one of the horizons."""
    error_mm = found.error_mm[place]
    return float(np.sqrt(np.mean(np.sum(error_mm**2, axis=1)))) if len(error_mm) else math.nan


def _errors(found: Mapping[str, Mapping[str, Errors]]) -> Table:
    rows: list[tuple[str, dict[str, float]]] = []
    for group, predictors in found.items():
        row: dict[str, float] = {"predictions_count": len(predictors[DEFAULT].error_mm[0])}
        for place, ahead_ms in enumerate(AHEADS_MS):
            of = {name: rms_mm(predictors[name], place) for name in (DEFAULT, *RIVALS)}
            row |= {f"{name}_{ahead_ms}ms_mm": value for name, value in of.items()}
            row[f"over_the_better_{ahead_ms}ms"] = of[DEFAULT] / min(of[name] for name in RIVALS)
        rows.append((group, row))
    rows.append((ALL, _overall([row for _, row in rows])))
    return Table(
        name="prediction_traces",
        title="prediction: RMS distance to the pad's own reports 15 and 25 ms later, by group of devices",
        default=ALL,
        rows=finite_rows(rows),
        compared=(),
        notes=("over the better: the default's error over the smaller of the two others'",),
    )


def _overall(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Geometric means over the groups; the ratio is that of the means."""
    means: dict[str, float] = {"predictions_count": sum(row["predictions_count"] for row in rows)}
    for name in rows[0]:
        if name.endswith("_mm"):
            means[name] = float(np.exp(np.nanmean([math.log(max(row[name], 1e-9)) for row in rows])))
    for ahead_ms in AHEADS_MS:
        better = min(means[f"{name}_{ahead_ms}ms_mm"] for name in RIVALS)
        means[f"over_the_better_{ahead_ms}ms"] = means[f"{DEFAULT}_{ahead_ms}ms_mm"] / better
    return {name: means[name] for name in rows[0]}


def _coverage(found: Sequence[Errors]) -> Table:
    every = _joined(found)
    rows = [("all", _within(every, None))]
    for place in range(CLASSES):
        edge_mm_s = SLOWEST_MM_S * 2.0**place
        name = f"up to {edge_mm_s:g} mm/s" if place < CLASSES - 1 else "faster"
        row = _within(every, place)
        if row["predictions_count"] >= LEAST_COUNT:
            rows.append((name, row))
    return Table(
        name="prediction_covariance",
        title="prediction: share of the errors on an axis within one deviation, by predicted speed",
        default="all",
        rows=finite_rows(rows),
        compared=(),
        notes=("0.683 is right; more where a pad holds a position, as its errors are then exactly zero",),
    )


def _within(found: Errors, place: int | None) -> dict[str, float]:
    row: dict[str, float] = {}
    for horizon, ahead_ms in enumerate(AHEADS_MS):
        classes = np.array([speed_class(float(speed)) for speed in found.speed_mm_s[horizon]], int)
        chosen = slice(None) if place is None else classes == place
        is_within = np.abs(found.error_mm[horizon][chosen]) <= found.sigma_mm[horizon][chosen]
        row.setdefault("predictions_count", len(is_within))
        row[f"within_{ahead_ms}ms_frac"] = float(is_within.mean()) if len(is_within) else math.nan
    return row
