"""Trial of a calibration before it is written: the firmware's own loop, in simulation, on the plate as it was fitted.

Where noise hides modes outside the sweep, their share of the constant would be believed as feedthrough, and a fast loop
swings by 2 nm/V of that: there the loop must also bear each plate that explains the sweeps better than the believed
one. A wide sweep shows modes up to 2 kHz away; where they make a fast loop swing, or would with gains a tenth larger, a
slower law may hold.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from ...board_protocol import FAULTS, LogRequest
from ...board_values import BoardHello, BoardLog, ModeCalibration
from ...config.sections import DeviceConfig
from ...design.wiring import AmplifierSweep, MeasuredWiring, as_likely
from ...errors import DeviceError
from ...sim.board.board import PLATE_MODES_MAX, Board, BoardConfig, PlateModel
from ...sim.board.closed_loop import follow
from ...wire import device

HELD_S: Final = 0.5  # of each of two references: slow laws swing slowly
ASKED_FRAC: Final = 0.5  # of each mode's limit
FRAME_S: Final = 0.02
NOISE_UM: Final = 0.0006
MARGIN: Final = 1.21  # of far modes in the loop: amplifiers and sensors are known to a tenth each
LAW: Final = DeviceConfig().controller  # what the service sets, unless its configuration names another
SLOWER: Final = ("pi_ff", "pi")


class Tried(NamedTuple):
    """A sentence if what was fitted could not be tried, or does not bear the usual law, and the law that it bears."""

    sentence: str = ""
    controller: str = ""


NO_REMARK: Final = Tried()


def try_out(
    sweeps: Sequence[AmplifierSweep],
    found: MeasuredWiring,
    modes: Sequence[ModeCalibration],
    hello: BoardHello,
    drive_hz: float,
    wider: MeasuredWiring | None = None,
) -> Tried:
    """Try the fitted modes, driven at `drive_hz`, with all that `wider` sweeps show. Raises DeviceError if no law holds
    them: without wider sweeps, if the service's does not.
    """
    others = as_likely(sweeps, found)
    tried = found if wider is None else replace(wider, parasitic=wider.parasitic.scaled(1.0, MARGIN))
    try:
        own = fault_on([tried], modes, hello, LAW, drive_hz)
        fault = own or fault_on(others, modes, hello, LAW, drive_hz)
    except (DeviceError, ValueError) as error:
        return Tried(f"What was fitted was not tried against the loop: {error}")
    if not fault:
        return NO_REMARK
    near = ", ".join(f"{hz:.0f} Hz" for hz in tried.parasitic_hz()) or "near those swept"
    for slower in SLOWER if wider and own else ():
        if not fault_on([tried, *others], modes, hello, slower, drive_hz):
            return Tried(
                f"{LAW} would make the modes swing that no amplifier is for ({near}; fault {fault}), or nearly: "
                f'controller = "{slower}" is set, which does not. Damp these modes, or move the sensors to where they '
                f"are still, for {LAW}.",
                slower,
            )
    if others and not own:
        largest = 1e3 * max(abs(wire) for mode in modes for wire in mode.feedthrough_um_per_v)
        raise DeviceError(
            f"Nothing is written: the {largest:.2g} nm/V that look like feedthrough may be modes outside the sweep, "
            f"and the loop would swing (fault {fault}): sweep a wider band, with more volts (`hapticd calibrate "
            "resonance --from --to --volts`)."
        )
    raise DeviceError(
        f"Nothing is written: the loop would not hold the plate as it was fitted (fault {fault}): damp the modes that "
        f"no amplifier is for ({near}), or move the sensors to where these are still."
    )


def fault_on(
    plates: Sequence[MeasuredWiring],
    modes: Sequence[ModeCalibration],
    hello: BoardHello,
    law: str,
    drive_hz: float,
) -> int:
    """Return the first fault in which a board with this calibration ends on one of the plates, 0 if it holds all.

    Raises ValueError if the firmware refuses the calibration, DeviceError without its build for this host.
    """
    models = [mode.model(drive_hz) for mode in modes]
    through = [mode.feedthrough_um_per_v for mode in modes]
    config = BoardConfig(
        w_limit_um=hello.w_limit_um,
        v_limit_v=hello.v_limit_v,
        control_hz=hello.control_hz,
        drive_hz=drive_hz,
        decay_1_s=tuple(model.decay_1_s for model in models),
        detuning_rad_s=tuple(model.detuning_rad_s for model in models),
        gain_um_per_v_s=tuple(model.gain_um_per_v_s for model in models),
        loop_phase_rad=tuple(cmath.phase(model.loop) for model in models),
        drive=np.array([mode.drive for mode in modes]).T,
        sense=np.array([mode.sense for mode in modes]),
        feedthrough_um_per_v=np.array(through) if all(through) else None,
        controller=law,
    )
    faults = (_fault(Board(fitted_plate(plate, drive_hz, hello.v_limit_v), config=config)) for plate in plates)
    return next((fault for fault in faults if fault), 0)


def fitted_plate(found: MeasuredWiring, drive_hz: float, v_limit_v: float) -> PlateModel:
    """Return the plate as it was fitted; of parasitic modes as much as the simulated board's plate has room for."""
    count = len(found.fits)
    loops = np.exp(1j * np.array([fit.loop_phase_rad for fit in found.fits]))
    poles = found.driven_poles(drive_hz).tolist()
    gains, seen = list((found.drives / (-1j * loops)[:, None]).real), list((found.senses * loops).T)
    outside = found.parasitic
    for pole, residue in zip(outside.poles, outside.residues, strict=True):
        left, size, right = np.linalg.svd(np.vstack([residue.real, residue.imag]), full_matrices=False)
        for part in range(min((PLATE_MODES_MAX - count) // len(outside.poles), count)):  # each with real gains
            poles.append(complex(pole) + 2j * math.pi * (found.centre_hz - drive_hz))
            gains.append(size[part] * right[part])
            seen.append(1j * (left[:count, part] + 1j * left[count:, part]))
    return PlateModel(
        decay_1_s=-np.array(poles).real,
        detuning_rad_s=np.array(poles).imag,
        gain_um_per_v_s=np.array(gains),
        sensor=np.array(seen).T,
        noise_um=NOISE_UM,
        amplifier_limit_v=v_limit_v,
        through_um_per_v=found.background_um_per_v,
    )


def _fault(board: Board) -> int:
    """Drive all modes, with alternating signs, then turned by half: return the fault in which it ends, 0 without."""
    config = board.config
    signs = (-1.0) ** np.arange(len(config.w_limit_um))
    asked_um = ASKED_FRAC * np.array(config.w_limit_um, np.complex128) * signs
    every = max(round(FRAME_S * config.control_hz), 1)
    ticks = round(2.0 * HELD_S / FRAME_S) * every
    follow(board, lambda t_s: [(0.0, asked_um if t_s < HELD_S - 1e-4 else -asked_um)], ticks, every)
    board.transmit()
    board.receive(device.encode(LogRequest()))
    logs = [said for said in device.Decoder().feed(board.transmit()) if isinstance(said, BoardLog)]
    return next((entry.code for log in logs for entry in log.entries if entry.code in FAULTS), 0)
