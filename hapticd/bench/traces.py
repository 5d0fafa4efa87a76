"""Touches as pads recorded them, by device: the file of `hapticd bench prediction --traces`.

An NPZ file of four arrays:

    t_s     (n,)    the device's stamps in s, increasing within a trace
    xy_mm   (n, 2)  positions in mm
    trace   (n,)    number of the sample's trace, from 0, not decreasing
    device  (m,)    name of each trace's device, as kind/device: reported by kind, or by vendor for hid/vendor_...

Traces of one device are one pad's touches, in their order.
"""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

import numpy as np

from ..errors import UsageError, reason
from ..formats.npz import arrays_of
from ..regular_file import read_bounded
from ..tools.touches import Trace

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
