"""`hapticd firmware selftest`: short sweeps of each amplifier, and what has moved since the calibration.

Frequency, quality, gain and phase of each mode, both matrices of the wiring and the feedthrough, in two seconds (six
modes: three) and at a tenth of the voltage: a check before a session, not a calibration.
"""

from __future__ import annotations

import argparse
import cmath
import math
from collections.abc import Iterator, Sequence

import numpy as np

from ...board_protocol import ControllerRequest, Sweep
from ...board_values import BoardController, ModeCalibration
from ...design.wiring import AmplifierSweep, MeasuredWiring, fit_wiring
from ...errors import ConfigError, DeviceError, UsageError
from ...files import calibration
from . import text
from .conversation import Conversation
from .sweep import VOLTS_FRAC, each_swept

BAND_HZ, BESIDE_HZ = 80.0, 50.0  # swept to either side of the drive, and at least beyond the outermost modes
LEAST_POINTS = 9
# Of all sweeps together, and of a point: half of it settles, 4 time constants at Q 1000 and at Q 500.
SWEEPS_MS, LONGEST_MS, SHORTEST_MS = 1500, 80, 40
MOVED_HZ, MOVED_FRAC, MOVED_DEG = 5.0, 0.15, 5.0
MOVED_UM_PER_V = 0.001  # of feedthrough: limit cycles begin at 0.0014
# Of the response that the board expects: the loop bears 2.2 times its gain and 45 degrees (test_sensor_faults.py), and
# with less than half of it the plate does more than twice what is asked.
SAFE_SHARE, SAFE_DEG = (0.45, 2.0), 45.0


async def run(board: Conversation, options: argparse.Namespace) -> None:
    """Measure, compare and print."""
    known = await _known(board, options)
    sweeps = await measure(board, known)
    try:
        found = fit_wiring(sweeps)
        modes = found.calibrations()
    except ValueError as error:
        dead = f"{error} A sensor or an amplifier may be dead."
        if options.json:
            print(text.as_json({"modes": [], "known": known, "moved": [dead], "unsafe": [dead]}))
        raise DeviceError(dead) from None
    moved = [
        *found.wrong_wires(),
        *(line for one, other in zip(modes, known, strict=True) for line in changes(one, other)),
    ]
    bad = unsafe(found, known)
    if options.json:
        print(text.as_json({"modes": modes, "known": known, "moved": moved, "unsafe": bad}))
        return
    for one in modes:
        print(
            f"mode {one.mode}    {one.frequency_hz:.2f} Hz, Q {one.q_factor:.0f}, gain {one.gain_um_per_v_s:.4g} "
            f"um/(V s), loop phase {math.degrees(one.loop_phase_rad):+.1f} degrees"
        )
    print("\n".join(dict.fromkeys([*moved, *bad])) or "Nothing has moved since the calibration.")


async def _known(board: Conversation, options: argparse.Namespace) -> Sequence[ModeCalibration]:
    """Return the calibration of every mode: the file's, or without one the models that the board runs with."""
    count = board.hello.modes
    if options.calibration is not None:
        try:
            modes = sorted(calibration.load(options.calibration, count).modes, key=lambda one: one.mode)
        except ConfigError as error:
            raise UsageError(f"--calibration: {error}") from None
        if len(modes) < count:
            raise UsageError(f"--calibration: {options.calibration} lacks a mode: measure all {count} of them.")
        return modes
    controller = await board.ask(ControllerRequest(), BoardController)
    modes = []
    for mode, model in enumerate(controller.models):
        frequency_hz = board.hello.drive_hz + model.detuning_rad_s / (2.0 * math.pi)
        q_factor = math.pi * frequency_hz / model.decay_1_s
        modes.append(ModeCalibration(mode, frequency_hz, q_factor, model.gain_um_per_v_s, cmath.phase(model.loop)))
    return modes


async def measure(board: Conversation, known: Sequence[ModeCalibration]) -> list[AmplifierSweep]:
    """Sweep every amplifier around the drive and the modes. Raises DeviceError."""
    hello = board.hello
    known_hz = [one.frequency_hz for one in known]
    low_hz = min(hello.drive_hz - BAND_HZ, min(known_hz) - BESIDE_HZ)
    high_hz = max(hello.drive_hz + BAND_HZ, max(known_hz) + BESIDE_HZ)
    points = max(LEAST_POINTS, 2 * hello.modes + 1)  # what a fit of as many modes takes
    dwell_ms = min(max(SWEEPS_MS // (points * hello.modes), SHORTEST_MS), LONGEST_MS)
    return await each_swept(board, Sweep(0, low_hz, high_hz, points, dwell_ms, VOLTS_FRAC * hello.v_limit_v))


def unsafe(found: MeasuredWiring, known: Sequence[ModeCalibration]) -> list[str]:
    """Return a sentence for each mode whose loop, closed by the known models and wires, would not follow or swing; the
    wires that explain it come first."""
    sentences = []
    for one in known:
        own = [float(wire == one.mode) for wire in range(len(known))]
        seen = np.dot(one.sense or own, found.senses[:, one.mode])
        driven = np.dot(found.drives[one.mode], one.drive or own)
        expected = -1j * cmath.rect(one.gain_um_per_v_s, one.loop_phase_rad)
        share, turned_deg = abs(seen * driven / expected), math.degrees(cmath.phase(seen * driven / expected))
        if not SAFE_SHARE[0] <= share <= SAFE_SHARE[1]:
            sentences.append(f"The loop of mode {one.mode} has {share:.2f} times its gain.")
        elif abs(turned_deg) > SAFE_DEG:
            sentences.append(f"The loop of mode {one.mode} is {turned_deg:+.0f} degrees off.")
    return [*found.wrong_wires(), *sentences] if sentences else []


def changes(found: ModeCalibration, known: ModeCalibration) -> Iterator[str]:
    """Yield a sentence for all that has moved."""
    mode = f"Mode {found.mode}"
    offset_hz = found.frequency_hz - known.frequency_hz
    if abs(offset_hz) > MOVED_HZ:
        yield f"{mode} has moved by {offset_hz:+.1f} Hz to {found.frequency_hz:.1f} Hz."
    if not _near(found.q_factor / known.q_factor):
        yield f"{mode} has a quality of {found.q_factor:.0f}, not {known.q_factor:.0f}: something holds the plate."
    if not _near(found.gain_um_per_v_s / known.gain_um_per_v_s):
        share = found.gain_um_per_v_s / known.gain_um_per_v_s
        yield f"{mode} has {share:.2f} times its gain: check its amplifier, patches and sensor."
    turned_deg = math.degrees(cmath.phase(cmath.rect(1.0, found.loop_phase_rad - known.loop_phase_rad)))
    if abs(turned_deg) > MOVED_DEG:
        yield f"{mode} has turned its loop phase by {turned_deg:+.0f} degrees: calibrate again."
    own = tuple(float(wire == found.mode) for wire in range(len(found.drive)))
    yield from _moved_wires(f"{mode}: the share of amplifier", found.drive, known.drive or own, MOVED_FRAC)
    yield from _moved_wires(f"{mode}: the weight of sensor", found.sense, known.sense or own, MOVED_FRAC)
    yield from _moved_wires(
        f"{mode}: the feedthrough of amplifier",
        found.feedthrough_um_per_v,
        known.feedthrough_um_per_v or (0.0,) * len(own),
        MOVED_UM_PER_V,
    )


def _near(share: float) -> bool:
    return abs(share - 1.0) <= MOVED_FRAC


def _moved_wires(what: str, found: Sequence[complex], known: Sequence[complex], most: float) -> Iterator[str]:
    for wire, (now, before) in enumerate(zip(found, known, strict=True)):
        if abs(now - before) > most:
            yield f"{what} {wire} is {now:.3g}, not {before:.3g}."
