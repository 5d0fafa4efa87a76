"""Positions, targets and contacts of the fingers over time, by which a reference is judged.

They are those of the simulated plate's ground truth where the recording has it; else the pad's own samples, with
straight lines between them: then the sensor's error is not seen. Contacts are the ellipses that the passes took them
for, and discs where no ellipse was used.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush

import numpy as np
import numpy.typing as npt

from ...core.plate.mode_shapes import ModeShapes
from ...errors import RecordingError
from ...files.recording.kinds import Fields, Record, key_of
from ...sim.score import CONTACT_RADIUS_MM
from ...values import FloatArray

_Sample = tuple[int, float, float]  # t_ns, x_mm, y_mm
_Form = tuple[float, float, float]  # xx_mm, xy_mm, yy_mm: the symmetric matrix that makes a contact of the unit disc
_DISC: _Form = (CONTACT_RADIUS_MM, 0.0, CONTACT_RADIUS_MM)
_TRUE = ("x_mm", "y_mm", "plate_d_um", "plate_q_um", "target_um")
GRID_NS = 1_000_000
LONGEST_NS = 3600 * 1_000_000_000  # of what is judged at once: an hour takes 200 MB
MOST_FINGERS = 64
MOST_CELLS = 8 * LONGEST_NS // GRID_NS  # instants times fingers at once


@dataclass(frozen=True, slots=True)
class RecordedContact:
    """The contact of a column's fingers: `forms` (K,3), each from its instant `at_s` (K,) on; a disc before."""

    at_s: FloatArray
    forms: FloatArray

    def forms_mm(self, t_s: FloatArray) -> FloatArray:
        """Return the symmetric matrices (T,2,2) that make it of the unit disc."""
        held = np.array([_DISC, *self.forms])[np.searchsorted(self.at_s, t_s, side="right")]
        return held[:, (0, 1, 1, 2)].reshape(-1, 2, 2)


@dataclass(frozen=True, slots=True)
class Tracks:
    """T instants `t_ns` (T,), N fingers, NaN where one is absent: position_mm (T,N,2), target_um (T,N). A finger that
    comes after another one went may take its column.

    `got_um` (T,N) is what the plate gave them, where that is known; `is_true`: these are the true positions. `contacts`
    (N,) are over seconds from the first instant on; None where no ellipse was recorded.
    """

    t_ns: npt.NDArray[np.int64]
    position_mm: FloatArray
    target_um: FloatArray
    got_um: npt.NDArray[np.complex128] | None
    is_true: bool
    contacts: tuple[RecordedContact, ...] | None = None

    def felt_um(self, modes: ModeShapes, modal_um: npt.NDArray[np.complex128]) -> npt.NDArray[np.complex128]:
        """The amplitude (T,N) that modal amplitudes (T,M) give each finger at its place, by the map."""
        instants, fingers = self.target_um.shape
        is_there = np.isfinite(self.position_mm[..., 0])
        places_mm = np.where(is_there[..., None], self.position_mm, 0.0).reshape(-1, 2)
        phi = modes.evaluate(places_mm).reshape(instants, fingers, modes.M)
        felt_um: npt.NDArray[np.complex128] = np.einsum("tnm,tm->tn", phi, modal_um)
        felt_um[~is_there] = np.nan
        return felt_um


def tracks(records: Sequence[Record]) -> Tracks:
    """From the truth where there is one, else from the passes. Raises RecordingError where no finger touched."""
    truth = [record for record in records if record.kind == "truth"]
    passes = [record for record in records if record.kind == "pass"]
    return _from_truth(truth, passes) if len(truth) > 1 else _from_passes(passes)


def _grid_ns(start_ns: int, end_ns: int, fingers: int) -> npt.NDArray[np.int64]:
    """The instants that are judged, for this many fingers at once. Raises RecordingError where there are none, or too
    many to hold."""
    if not (fingers and end_ns - start_ns >= 2 * GRID_NS):
        raise RecordingError("The recording has no fingers to judge by.")
    cells = (end_ns - start_ns) // GRID_NS * fingers
    if fingers > MOST_FINGERS or cells > MOST_CELLS or end_ns - start_ns > LONGEST_NS:
        raise RecordingError(
            "The recording has more fingers than can be judged at once: make one of less than an hour."
        )
    return np.arange(start_ns, end_ns, GRID_NS)


def _from_truth(truth: Sequence[Record], passes: Sequence[Record]) -> Tracks:
    at_ns = np.array([record.t_ns for record in truth])
    order = np.argsort(at_ns, kind="stable")
    at_ns = at_ns[order]
    numbers = sorted({finger["path"] for record in truth for finger in record.fields["fingers"]})
    t_ns = _grid_ns(int(at_ns[0]), int(at_ns[-1]), len(numbers))
    columns = {number: column for column, number in enumerate(numbers)}
    values = np.full((len(truth), len(numbers), len(_TRUE)), np.nan)
    for row, index in enumerate(order.tolist()):
        for finger in truth[index].fields["fingers"]:
            values[row, columns[finger["path"]]] = [finger.get(name, np.nan) for name in _TRUE]
    position_mm, got_um = _between(t_ns, at_ns, values[..., :2]), _between(t_ns, at_ns, values[..., 2:4])
    target_um = values[np.searchsorted(at_ns, t_ns, side="right") - 1, :, 4]
    target_um[~np.isfinite(position_mm[..., 0])] = np.nan  # between the last truth of a finger and the next without it
    found = {key_of(one): columns[one["path"]] for record in truth for one in record.fields["fingers"]}
    contacts = _contacts(passes, found, len(numbers), int(t_ns[0]))
    return Tracks(t_ns, position_mm, target_um, got_um[..., 0] + 1j * got_um[..., 1], True, contacts)


def _between(t_ns: npt.NDArray[np.int64], at_ns: npt.NDArray[np.int64], values: FloatArray) -> FloatArray:
    """Straight lines between values (K,N,W); NaN where a neighbour is."""
    flat = values.reshape(len(at_ns), -1)
    lines = [np.interp(t_ns, at_ns, flat[:, index]) for index in range(flat.shape[1])]
    return np.stack(lines, axis=1).reshape(len(t_ns), *values.shape[1:])


def _from_passes(passes: Sequence[Record]) -> Tracks:
    """Fingers at their samples' instants, virtual ones where a pass put them; targets hold from pass to pass."""
    places: dict[int | str, list[_Sample]] = {}
    targets: dict[int | str, list[tuple[int, float]]] = {}
    for record in passes:
        t_pass_ns, fields = record.t_ns, record.fields
        t_sample_ns = t_pass_ns - fields["age_ns"]
        points: dict[int | str, Fields] = {key_of(point): point for point in fields["points"]}
        for finger in fields["fingers"]:
            number = finger["finger_id"]
            _add_sample(places.setdefault(number, []), t_sample_ns, finger)
            target_um = points[number]["target_um"] if number in points else np.nan
            targets.setdefault(number, []).append((t_pass_ns, target_um))
        for name, point in points.items():
            if isinstance(name, str):
                _add_sample(places.setdefault(name, []), t_sample_ns + fields["horizon_ns"], point)
                targets.setdefault(name, []).append((t_pass_ns, point["target_um"]))
    touched = {key: samples for key, samples in places.items() if len(samples) > 1}
    columns, fingers = _columns(touched)
    start_ns = min((samples[0][0] for samples in touched.values()), default=0)
    t_ns = _grid_ns(start_ns, max((samples[-1][0] for samples in touched.values()), default=0), fingers)
    position_mm = np.full((len(t_ns), fingers, 2), np.nan)
    targets_um = np.full((len(t_ns), fingers), np.nan)
    for key, samples in touched.items():
        part = slice(*np.searchsorted(t_ns, (samples[0][0], samples[-1][0] + 1)).tolist())
        position_mm[part, columns[key]] = _position_mm(t_ns[part], samples)
        targets_um[part, columns[key]] = _held(t_ns[part], targets[key])
    targets_um[~np.isfinite(position_mm[..., 0])] = np.nan
    contacts = _contacts(passes, columns, fingers, int(t_ns[0]))
    return Tracks(t_ns, position_mm, targets_um, None, False, contacts)


def _contacts(
    passes: Iterable[Record], columns: Mapping[int | str, int], count: int, t_start_ns: int
) -> tuple[RecordedContact, ...] | None:
    """The contact of each of `count` columns, as each pass took it to be; None where no pass had an ellipse."""
    forms: list[list[_Form]] = [[] for _ in range(count)]
    at_s: list[list[float]] = [[] for _ in range(count)]
    for record in passes:
        for point in record.fields["points"]:
            column = columns.get(key_of(point))
            form = _form(point)
            if column is not None and form != (forms[column][-1] if forms[column] else _DISC):
                forms[column].append(form)
                at_s[column].append((record.t_ns - t_start_ns) * 1e-9)
    if not any(forms):
        return None
    each = zip(at_s, forms, strict=True)
    return tuple(RecordedContact(np.array(at), np.array(some).reshape(-1, 3)) for at, some in each)


def _form(point: Fields) -> _Form:
    """The contact that a pass took a finger to have."""
    if not {"contact_major_mm", "contact_minor_mm", "contact_angle_rad"} <= point.keys():
        return _DISC
    major_mm, minor_mm, twice_rad = point["contact_major_mm"], point["contact_minor_mm"], 2 * point["contact_angle_rad"]
    mean_mm, half_mm = (major_mm + minor_mm) / 4.0, (major_mm - minor_mm) / 4.0
    along_mm, across_mm = half_mm * math.cos(twice_rad), half_mm * math.sin(twice_rad)
    return mean_mm + along_mm, across_mm, mean_mm - along_mm


def _columns(touched: Mapping[int | str, Sequence[_Sample]]) -> tuple[dict[int | str, int], int]:
    """A column for each finger, and how many there are: a session has thousands of touches, but few at once."""
    columns: dict[int | str, int] = {}
    taken: list[tuple[int, int]] = []  # until when, and which: the first to be free in front
    for key, samples in sorted(touched.items(), key=lambda item: item[1][0][0]):
        # Two steps between them, so that the one that comes is seen to land.
        is_free = bool(taken) and taken[0][0] + 2 * GRID_NS < samples[0][0]
        columns[key] = heappop(taken)[1] if is_free else len(taken)
        heappush(taken, (samples[-1][0], columns[key]))
    return columns, len(taken)


def _add_sample(samples: list[_Sample], t_ns: int, place: Fields) -> None:
    if not samples or t_ns > samples[-1][0]:
        samples.append((t_ns, place["x_mm"], place["y_mm"]))


def _position_mm(t_ns: npt.NDArray[np.int64], samples: Sequence[_Sample]) -> FloatArray:
    at_ns, x_mm, y_mm = zip(*samples, strict=True)
    lines = [np.interp(t_ns, at_ns, along, left=np.nan, right=np.nan) for along in (x_mm, y_mm)]
    return np.stack(lines, axis=1)


def _held(t_ns: npt.NDArray[np.int64], steps: Sequence[tuple[int, float]]) -> FloatArray:
    at_ns, values = zip(*steps, strict=True)
    index = np.searchsorted(np.array(at_ns), t_ns, side="right")
    return np.array([np.nan, *values])[index]
