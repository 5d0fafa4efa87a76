"""`hapticd firmware selftest`: short sweeps of each amplifier, and what has moved since the calibration.

Frequency, quality, gain and phase of each mode, both matrices of the wiring and the feedthrough, in two seconds and at
a tenth of the voltage: a check before a session, not a calibration.
"""

from __future__ import annotations

import argparse
import cmath
import math
from collections.abc import Iterator, Sequence

import numpy as np

from ...board_values import BoardController, ControllerRequest, ModeCalibration, Sweep
from ...design.wiring import AmplifierSweep, MeasuredWiring, fit_wiring
from ...errors import ConfigError, DeviceError, UsageError
from ...files import calibration
from . import text
from .conversation import Conversation
from .sweep import VOLTS_FRAC, measured, quiet

BAND_HZ, POINTS, DWELL_MS = 80.0, 9, 80  # half of the dwell settles: 4 time constants at Q 1000
MOVED_HZ, MOVED_FRAC, MOVED_DEG = 5.0, 0.15, 5.0
MOVED_UM_PER_V = 0.001  # of feedthrough: limit cycles begin at 0.0014


async def run(board: Conversation, options: argparse.Namespace) -> None:
    """Measure, compare and print."""
    known = await _known(board, options)
    found = await measure(board)
    try:
        modes = found.calibrations()
    except ValueError as error:
        raise DeviceError(str(error)) from None
    moved = [
        *found.wrong_wires(),
        *(line for one, other in zip(modes, known, strict=True) for line in changes(one, other)),
    ]
    if options.json:
        print(text.as_json({"modes": modes, "known": known, "moved": moved}))
        return
    for one in modes:
        print(
            f"mode {one.mode}    {one.frequency_hz:.2f} Hz, Q {one.q_factor:.0f}, gain {one.gain_um_per_v_s:.4g} "
            f"um/(V s), loop phase {math.degrees(one.loop_phase_rad):+.1f} degrees"
        )
    print("\n".join(moved) or "Nothing has moved since the calibration.")


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


async def measure(board: Conversation) -> MeasuredWiring:
    """Sweep every amplifier around the drive. Raises DeviceError."""
    hello, sweeps = board.hello, []
    for amplifier in range(hello.modes):
        await quiet(board)
        plan = Sweep(
            amplifier,
            hello.drive_hz - BAND_HZ,
            hello.drive_hz + BAND_HZ,
            POINTS,
            DWELL_MS,
            VOLTS_FRAC * hello.v_limit_v,
        )
        points = await measured(board, plan)
        response = np.array([point.measured_um for point in points], np.complex128) / plan.voltage_v
        sweeps.append(AmplifierSweep(amplifier, np.array([point.frequency_hz for point in points]), response))
    try:
        return fit_wiring(sweeps)
    except ValueError as error:
        raise DeviceError(f"{error} A sensor or an amplifier may be dead.") from None


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
