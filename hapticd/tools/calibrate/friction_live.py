"""Readings of friction from a force sensor under the plate, while a finger strokes and the amplitude steps.

The sensor is a stream of the Lab Streaming Layer. What the service does and what the sensor measures are in one
recording, on one clock; readings are means over WINDOW_S in which one finger slides and gets much the same amplitude.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from ...errors import CalibrationError, HapticdError
from ...files.recording.mcap_reader import open_recording
from ...values import FloatArray
from ..record.tables import tables
from ..served_friction import served_curve

if TYPE_CHECKING:
    from hapticd_client import Client

LEVELS: Final = 8  # from bare glass to the highest amplitude
MOST_UM: Final = 3.0
LEAST_TOP_UM: Final = 0.3
NEAR_FLOOR: Final = 0.02  # of the frictions 0 .. 1
PLACES, PLACES_FRAC = 4, 0.7  # along each side, and of it, where `reach` is asked for
HELD_S: Final = 3.0  # at each level, twice
WINDOW_S: Final = 0.1
SETTLED_S: Final = 0.3  # after a step
LEAST_SPEED_MM_S: Final = 10.0
STEP_UM: Final = 0.1  # readings whose amplitudes differ by less are of one
MOST_SPREAD_UM: Final = 0.15  # of what a finger gets within a window, as a standard deviation
FEWEST_SAMPLES: Final = 3  # in a window, of the sensor and of the pad
NORMAL: Final = "fz"  # names of channels, in any case
LATERAL: Final = ("fx", "fy")
SURFACE: Final = "calibration"
ADVICE: Final = "Stroke the plate with one finger, to and fro, at your usual speed, until it says that it is enough."

_Tables = Mapping[str, Mapping[str, npt.NDArray[np.generic]]]


def measure(endpoint: Path | None, stream: str, say: Callable[[str], None] = print) -> tuple[FloatArray, ...]:
    """Return amplitudes, frictions and speeds (N,) of the running service's plate. Raises HapticdError."""
    import hapticd_client

    try:
        with (
            tempfile.TemporaryDirectory(prefix="hapticd-friction-") as folder,
            hapticd_client.Client(endpoint) as plate,
        ):
            top_um = highest_um(plate)
            path = Path(folder, "friction.mcap")
            with plate.record(path, lsl=[stream]):
                say(ADVICE)
                sweep(plate, np.linspace(0.0, top_um, LEVELS).tolist(), time.sleep)
                say("Enough.")
            return readings(tables(open_recording(path)), stream)
    except hapticd_client.HapticdError as error:
        raise HapticdError(str(error)) from None


def highest_um(plate: Client) -> float:
    """Return the highest level of the sweep: what half of the places can get at least, as `reach` says.

    Where that is all that the service's curve knows of, it is the curve's end, or a mode's limit beyond it; on a plate
    that is driven for points the modes' limit; MOST_UM at most. Raises CalibrationError for a plate that gives next to
    nothing, and the client library's errors.
    """
    import hapticd_client

    body = plate.plate()
    curve, limit_um = served_curve(body), min(MOST_UM, *map(float, body["w_limit_um"]))
    half_mm = [size_mm * PLACES_FRAC / 2.0 for size_mm in body["size_mm"]]
    lowest: list[float] = []
    try:
        for x_mm, y_mm in product(*(np.linspace(-size_mm, size_mm, PLACES).tolist() for size_mm in half_mm)):
            found = plate.reach(x_mm=x_mm, y_mm=y_mm)
            lowest.append(1.0 if found is None else found[0])
    except hapticd_client.RefusedError:
        return limit_um
    friction = float(np.median(lowest))
    if friction <= NEAR_FLOOR:
        return min(max(curve.full_um, limit_um), MOST_UM)
    top_um = min(curve.amplitude_um(friction), MOST_UM)
    if top_um < LEAST_TOP_UM:
        raise CalibrationError(
            f"Half of the plate gets {top_um:.2f} um at most, too little for a curve: release other clients' targets, "
            "and see `hapticd plate map`."
        )
    return top_um


def sweep(plate: Client, levels_um: Sequence[float], wait: Callable[[float], None]) -> None:
    """Give the whole plate each amplitude, rising and then falling: a drift of the friction cancels."""
    for level_um in (*levels_um, *reversed(levels_um)):
        plate.surface(SURFACE, amplitude_um=level_um)
        wait(HELD_S)
    plate.remove(SURFACE)


def readings(found: _Tables, stream: str) -> tuple[FloatArray, ...]:
    """Return amplitudes in um, frictions and speeds in mm/s (N,) of a recording with a sensor's stream.

    A friction is the lateral force over the normal one, or without a channel Fz the lateral force. Raises
    CalibrationError where there is none.
    """
    if "measured" not in found or not (found["measured"]["stream"] == stream).any():
        raise CalibrationError(f"The stream {stream} sent no samples: check the sensor.")
    if "fingers" not in found or "targets" not in found:
        raise CalibrationError("No finger touched the plate: stroke it while the amplitude steps.")
    at_s, force = _friction(found, stream)
    start_s, end_s = float(at_s[0]), float(at_s[-1])
    rows = [_window(found, at_s, force, t_s) for t_s in np.arange(start_s, end_s - WINDOW_S, WINDOW_S).tolist()]
    kept = [row for row in rows if row is not None]
    if not kept:
        raise CalibrationError("No finger slid over the plate alone: stroke with one, without resting.")
    amplitude_um, friction, speed_mm_s = np.array(kept).T
    return amplitude_um, friction, speed_mm_s


def _friction(found: _Tables, stream: str) -> tuple[FloatArray, FloatArray]:
    """Return the sensor's instants (K,) in s, and the friction at each (K,)."""
    own = found["measured"]["stream"] == stream
    channel, t_s, value = (np.asarray(found["measured"][name][own], float) for name in ("channel", "t_s", "value"))
    named = _channels(found, stream)
    lateral = [named[name] for name in LATERAL if name in named] or [1]
    at_s = t_s[channel == lateral[0]]
    parts = [value[channel == number] for number in lateral]
    force = np.sqrt(np.sum(np.square(parts), axis=0))
    if NORMAL in named:
        normal = np.abs(value[channel == named[NORMAL]])
        force = np.divide(force, normal, out=np.full_like(force, np.nan), where=normal > 0.0)
    return at_s, force


def _channels(found: _Tables, stream: str) -> dict[str, int]:
    """Return the numbers of the stream's channels by their names in small letters."""
    if "streams" not in found:
        return {}
    table = found["streams"]
    own = table["stream"] == stream
    return {
        str(name).lower(): int(number) for name, number in zip(table["name"][own], table["channel"][own], strict=True)
    }


def _window(found: _Tables, at_s: FloatArray, force: FloatArray, t_s: float) -> tuple[float, float, float] | None:
    """Return amplitude, friction and speed of one window; None where it is no reading.

    The amplitude is what the finger got: a sliding one seldom gets what was asked all along.
    """
    fingers, targets = found["fingers"], found["targets"]
    touching, given = _within(fingers["t_s"], t_s), _within(targets["t_s"], t_s, SETTLED_S)
    got = _within(targets["t_s"], t_s)
    ids = np.unique(fingers["finger_id"][touching])
    target_um = np.asarray(targets["target_um"][given], float)
    has_samples = min(touching.stop - touching.start, got.stop - got.start) >= FEWEST_SAMPLES
    if len(ids) != 1 or not has_samples or np.ptp(target_um) > 0.0:
        return None
    achieved_um = np.asarray(targets["achieved_um"][got], float)
    if achieved_um.std() > MOST_SPREAD_UM:
        return None
    x_mm, y_mm, sampled_s = (np.asarray(fingers[name][touching], float) for name in ("x_mm", "y_mm", "t_s"))
    way_mm, span_s = float(np.hypot(np.diff(x_mm), np.diff(y_mm)).sum()), float(np.ptp(sampled_s))
    felt = force[_within(at_s, t_s)]
    if span_s <= 0.0 or way_mm < LEAST_SPEED_MM_S * span_s or np.isfinite(felt).sum() < FEWEST_SAMPLES:
        return None
    return round(float(achieved_um.mean()) / STEP_UM) * STEP_UM, float(np.nanmean(felt)), way_mm / span_s


def _within(at_s: npt.NDArray[np.generic], t_s: float, before_s: float = 0.0) -> slice:
    """Return the part of rising instants that is in the window, or as long before."""
    return slice(*np.searchsorted(np.asarray(at_s, float), (t_s - before_s, t_s + WINDOW_S)).tolist())
