"""Where the fingers were and what they should have got, over time: what a reference is judged by.

With the simulated plate's truth in the recording that is known; without, the pad's own samples stand for it, laid
between by straight lines: then what the sensor errs by is judged as if it were true.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Any

import numpy as np
import numpy.typing as npt

from ...core.plate.mode_shapes import ModeShapes
from ...errors import RecordingError
from ...files.recording.records import Record

FloatArray = npt.NDArray[np.float64]
Sample = tuple[int, float, float]  # t_ns, x_mm, y_mm
GRID_NS = 1_000_000
LONGEST_NS = 3600 * 1_000_000_000  # of what is judged at once: an hour takes 200 MB
MOST_CELLS = 8 * LONGEST_NS // GRID_NS  # instants times fingers at once


@dataclass(frozen=True, slots=True)
class Tracks:
    """T instants `t_ns` (T,), N fingers, NaN where one is absent: position_mm (T,N,2), target_um (T,N). A finger that
    comes after another one went may take its column.

    `got_um` (T,N) is what the plate gave them, where that is known; `is_true`: these are the true positions.
    """

    t_ns: npt.NDArray[np.int64]
    position_mm: FloatArray
    target_um: FloatArray
    got_um: npt.NDArray[np.complex128] | None
    is_true: bool

    def felt_um(self, modes: ModeShapes, modal_um: npt.NDArray[np.complex128]) -> npt.NDArray[np.complex128]:
        """What modal amplitudes (T,M) give each finger at its place (T,N), by the map."""
        instants, fingers = self.target_um.shape
        is_there = np.isfinite(self.position_mm[..., 0])
        places_mm = np.where(is_there[..., None], self.position_mm, 0.0).reshape(-1, 2)
        phi = modes.evaluate(places_mm).reshape(instants, fingers, modes.M)
        felt_um: npt.NDArray[np.complex128] = np.einsum("tnm,tm->tn", phi, modal_um)
        felt_um[~is_there] = np.nan
        return felt_um


def tracks(records: Sequence[Record]) -> Tracks:
    """From the truth where there is one, else from the passes. Raises RecordingError where nobody touched."""
    truth = [record for record in records if record.kind == "truth"]
    if len(truth) > 1:
        return _from_truth(truth)
    return _from_passes([record for record in records if record.kind == "pass"])


def _grid_ns(start_ns: int, end_ns: int, fingers: int) -> npt.NDArray[np.int64]:
    """The instants that are judged, for so many fingers at once. Raises RecordingError where they are none, or too
    many to hold."""
    if not (fingers and end_ns - start_ns >= 2 * GRID_NS):
        raise RecordingError("The recording has no fingers to judge by.")
    if not (end_ns - start_ns <= LONGEST_NS and (end_ns - start_ns) // GRID_NS * fingers <= MOST_CELLS):
        raise RecordingError(
            "The recording has more fingers than can be judged at once: make one of less than an hour."
        )
    return np.arange(start_ns, end_ns, GRID_NS)


def _from_truth(truth: Sequence[Record]) -> Tracks:
    at_ns = np.array([record.t_ns for record in truth])
    order = np.argsort(at_ns, kind="stable")
    at_ns = at_ns[order]
    fingers = min(len(record.fields[column]) for record in truth for column in (1, 2, 4))
    t_ns = _grid_ns(int(at_ns[0]), int(at_ns[-1]), fingers)

    def column(index: int, width: int) -> FloatArray:
        nothing = [np.nan] * width
        rows = [[_wide(v, nothing) for v in record.fields[index][:fingers]] for record in truth]
        return np.array(rows, dtype=np.float64).reshape(len(truth), fingers, width)[order]

    position_mm = _between(t_ns, at_ns, column(1, 2))
    got_um = _between(t_ns, at_ns, column(4, 2))
    target_um = column(2, 1)[np.searchsorted(at_ns, t_ns, side="right") - 1, :, 0]
    target_um[~np.isfinite(position_mm[..., 0])] = np.nan  # between the last truth of a finger and the next without it
    return Tracks(t_ns, position_mm, target_um, got_um[..., 0] + 1j * got_um[..., 1], True)


def _wide(value: Any, nothing: list[float]) -> list[float]:
    if value is None:
        return nothing
    return list(value) if isinstance(value, list) else [value]


def _between(t_ns: npt.NDArray[np.int64], at_ns: npt.NDArray[np.int64], values: FloatArray) -> FloatArray:
    """Straight lines between values (K,N,W); NaN where a neighbour is."""
    flat = values.reshape(len(at_ns), -1)
    lines = [np.interp(t_ns, at_ns, flat[:, index]) for index in range(flat.shape[1])]
    return np.stack(lines, axis=1).reshape(len(t_ns), *values.shape[1:])


def _from_passes(passes: Iterable[Record]) -> Tracks:
    """Fingers at their samples' instants, virtual ones where a pass put them; targets hold from pass to pass."""
    places: dict[int | str, list[Sample]] = {}
    targets: dict[int | str, list[tuple[int, float]]] = {}
    for record in passes:
        t_ns, age_ns, horizon_ns, _, _, fingers, points, *_ = record.fields
        wanted = {point[0]: point for point in points}
        for finger_id, _, x_mm, y_mm in fingers:
            _add_sample(places.setdefault(finger_id, []), t_ns - age_ns, x_mm, y_mm)
            target_um = wanted[finger_id][3] if finger_id in wanted else np.nan
            targets.setdefault(finger_id, []).append((t_ns, target_um))
        for key, point in wanted.items():
            if isinstance(key, str):
                _add_sample(places.setdefault(key, []), t_ns - age_ns + horizon_ns, point[1], point[2])
                targets.setdefault(key, []).append((t_ns, point[3]))
    touched = {key: samples for key, samples in places.items() if len(samples) > 1}
    columns, fingers = _columns(touched)
    start_ns = min((samples[0][0] for samples in touched.values()), default=0)
    t_ns = _grid_ns(start_ns, max((samples[-1][0] for samples in touched.values()), default=0), fingers)
    position_mm = np.full((len(t_ns), fingers, 2), np.nan)
    target_um = np.full((len(t_ns), fingers), np.nan)
    for key, samples in touched.items():
        part = slice(*np.searchsorted(t_ns, (samples[0][0], samples[-1][0] + 1)).tolist())
        position_mm[part, columns[key]] = _position_mm(t_ns[part], samples)
        target_um[part, columns[key]] = _held(t_ns[part], targets[key])
    target_um[~np.isfinite(position_mm[..., 0])] = np.nan
    return Tracks(t_ns, position_mm, target_um, None, False)


def _columns(touched: Mapping[int | str, Sequence[Sample]]) -> tuple[dict[int | str, int], int]:
    """A column for each finger, and how many there are: a session has thousands of touches, but few at once."""
    columns: dict[int | str, int] = {}
    taken: list[tuple[int, int]] = []  # until when, and which: the first to be free in front
    for key, samples in sorted(touched.items(), key=lambda item: item[1][0][0]):
        # Two steps between them, so that the one that comes is seen to land.
        is_free = bool(taken) and taken[0][0] + 2 * GRID_NS < samples[0][0]
        columns[key] = heappop(taken)[1] if is_free else len(taken)
        heappush(taken, (samples[-1][0], columns[key]))
    return columns, len(taken)


def _add_sample(samples: list[Sample], t_ns: int, x_mm: float, y_mm: float) -> None:
    if not samples or t_ns > samples[-1][0]:
        samples.append((t_ns, x_mm, y_mm))


def _position_mm(t_ns: npt.NDArray[np.int64], samples: Sequence[Sample]) -> FloatArray:
    at_ns, x_mm, y_mm = zip(*samples, strict=True)
    lines = [np.interp(t_ns, at_ns, along, left=np.nan, right=np.nan) for along in (x_mm, y_mm)]
    return np.stack(lines, axis=1)


def _held(t_ns: npt.NDArray[np.int64], steps: Sequence[tuple[int, float]]) -> FloatArray:
    at_ns, values = zip(*steps, strict=True)
    index = np.searchsorted(np.array(at_ns), t_ns, side="right")
    return np.array([np.nan, *values])[index]
