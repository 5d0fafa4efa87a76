"""How well the plate follows its reference under both control laws: steps, sinusoids, the voltage's bound.

Everything runs the firmware's own C against the plate model. `new_board`, `follow` and the measures below them are
shared with the firmware's tests.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from ..sim.board import (
    Board,
    BoardConfig,
    BoardTrace,
    PlateModel,
    reference_decay_1_s,
    reference_gain_um_per_v_s,
)
from ..values import Knot, LimitReason, SafeDrive
from ..wire import device
from .tables import Table, finite_rows
from .timing import REPEATS, compare

Phasors = npt.NDArray[np.complex128]

TICK_MS = 0.5
CONTROLLERS = ("pi_ff", "pi")
DEFAULT = CONTROLLERS[0]
FREQUENCIES_HZ = (2.0, 5.0, 10.0, 15.0)
SETTLED_FRAC = 0.02
PLATES = tuple(
    {"quality": quality, "damping": damping, "detune_hz": detune_hz}
    for quality in (200.0, 500.0, 1000.0)
    for damping, detune_hz in ((1.0, 0.0), (0.5, 0.0), (1.5, 0.0), (1.0, 20.0), (1.0, -20.0))
)


def run(
    *, frequencies_hz: Sequence[float] = FREQUENCIES_HZ, repeats: int = REPEATS, ticks: int = 2000
) -> tuple[Table, Table]:
    """Compare the control laws: figures of a step, and of sinusoids; `ticks` control ticks are timed on the host."""
    times = compare({name: (_ticking(name, ticks), ticks) for name in CONTROLLERS}, repeats)
    steps, tracking = [], []
    for name in CONTROLLERS:
        settling, overshoot, cross = one_um_step(name)
        figures = {
            **times[name].figures("host_tick"),
            "settling_ms": settling,
            "overshoot_frac": overshoot,
            "cross_axis_frac": cross,
            "worst_settling_ms": max(one_um_step(name, **plate)[0] for plate in PLATES),
            "largest_voltage_v": largest_voltage_v(name),
        }
        steps.append((name, figures))
        tracking += [
            (f"{name}, {f_hz:g} Hz", {"frequency_hz": f_hz, **tracking_figures(name, f_hz)}) for f_hz in frequencies_hz
        ]
    return (
        Table(
            name="step",
            title="firmware: a step of one mode from 0 to 1 um, the other axis held at 0",
            default=DEFAULT,
            rows=finite_rows(steps),
            compared=("host_tick_us", "settling_ms"),
            time="host_tick_us",
            error="settling_ms",
            notes=(
                f"worst: of {len(PLATES)} plates of Q 200 to 1000, damped 0.5 to 1.5 times and detuned by up to 20 Hz",
                "largest voltage: when more is asked than the amplifiers' 150 V give",
                "host tick: 1 control tick of firmware and plate model on this machine",
            ),
        ),
        Table(
            name="tracking",
            title="firmware: sinusoids of 3 um, sent as 3 ms knots 90 times a second",
            default=f"{DEFAULT}, {10.0 if 10.0 in frequencies_hz else frequencies_hz[0]:g} Hz",
            rows=finite_rows(tracking),
            compared=("error_um",),
            error="error_um",
            across="frequency_hz",
            notes=("residual: what is left of the error once the delay is taken out",),
        ),
    )


def new_board(controller: str, quality: float = 500.0, damping: float = 1.0, detune_hz: float = 0.0) -> Board:
    """A plate of this quality, known to the board but for `damping` and `detune_hz`."""
    gain = reference_gain_um_per_v_s(quality)
    config = BoardConfig(controller=controller, decay_1_s=reference_decay_1_s(quality), gain_um_per_v_s=(gain, gain))
    model = PlateModel(
        decay_1_s=damping * np.array(config.decay_1_s),
        detuning_rad_s=np.array(config.detuning_rad_s) + 2 * np.pi * detune_hz,
        gain_um_per_v_s=gain * np.eye(2),
        sensor=np.eye(2),
        noise_um=0.0006,
        amplifier_limit_v=150.0,
    )
    return Board(model, config=config)


def follow(
    board: Board, knots_at: Callable[[float], list[tuple[float, Phasors]]], ticks: int, every: int
) -> BoardTrace:
    """Drives the board with what `knots_at` says at each frame's start (s): (ms after it, amplitudes)."""
    trace = BoardTrace(ticks, 2, 2)
    seq = 0
    for tick in range(0, ticks, every):
        knots = tuple(Knot(round(ms * 1e6), tuple(w)) for ms, w in knots_at(board.t_us * 1e-6))
        for _ in range(3 if tick == 0 else 1):  # a board trusts the third frame of a stream
            board.receive(device.encode_reference(seq, SafeDrive(0, knots, LimitReason.NONE), board.t_us))
            seq += 1
        rows = min(every, ticks - tick)
        board.run(rows, np.zeros((rows, 0, 2)), np.zeros((rows, 0)), trace, tick)
    return trace


def step_trace(board: Board, from_um: Phasors, to_um: Phasors) -> BoardTrace:
    """0.1 s of one reference, then 0.1 s of another."""

    def knots(t_s: float) -> list[tuple[float, Phasors]]:
        return [(0.0, to_um if t_s > 0.0999 else from_um)]

    return follow(board, knots, 400, 20)


def step(board: Board, from_um: Phasors, to_um: Phasors) -> Phasors:
    """What the plate does from the tick of the step on."""
    return step_trace(board, from_um, to_um).plate_um[200:]


def settling_ms(w_um: Phasors, target_um: complex) -> float:
    """Time after which the amplitude stays within 2 %."""
    outside = np.flatnonzero(np.abs(w_um - target_um) > SETTLED_FRAC * abs(target_um))
    return 0.0 if len(outside) == 0 else float(outside[-1] + 2) * TICK_MS


def one_um_step(controller: str, **plate: float) -> tuple[float, float, float]:
    """Settling (ms), overshoot and largest W_q (fractions) of a step of W_d from 0 to 1000 nm, W_q held at 0."""
    w_um = step(new_board(controller, **plate), np.zeros(2, complex), np.array([1 + 0j, 0]))[:, 0]
    return settling_ms(w_um, 1.0), float(w_um.real.max()) - 1, float(np.abs(w_um.imag).max())


def largest_voltage_v(controller: str) -> float:
    """The largest amplifier voltage while a damped plate is asked for more than it can do."""
    most_um = np.array([3.9 + 0j, -3.9])
    return float(np.abs(step_trace(new_board(controller, damping=1.5), most_um, -most_um).voltage_v).max())


def tracking_trace(controller: str, f_hz: float) -> BoardTrace:
    """Sinusoids of 3 um as of fingers that cross the waves, sent as polylines of 3 ms knots 90 times a second."""

    def amplitudes(t_s: float) -> Phasors:
        return 3 * np.array([np.sin(2 * np.pi * f_hz * t_s), np.cos(1.6 * np.pi * f_hz * t_s)]) + 0j

    def knots(t_s: float) -> list[tuple[float, Phasors]]:
        return [(ms, amplitudes(t_s + ms * 1e-3)) for ms in range(0, 18, 3)]

    return follow(new_board(controller), knots, 1600, 22)


def tracking_rms_um(controller: str, f_hz: float) -> float:
    """RMS distance of the plate from its reference, both modes."""
    return tracking_figures(controller, f_hz)["error_um"]


def tracking_figures(controller: str, f_hz: float) -> dict[str, float]:
    """RMS error, the delay that explains most of it, and what that leaves."""
    trace = tracking_trace(controller, f_hz)
    reference_um, plate_um = trace.reference_um[200:], trace.plate_um[200:]
    delay_ticks = _delay_ticks(reference_um, plate_um)
    return {
        "error_um": _rms_um(plate_um - reference_um),
        "delay_ms": delay_ticks * TICK_MS,
        "residual_um": _late_error_um(reference_um, plate_um, delay_ticks),
    }


def _delay_ticks(reference_um: Phasors, plate_um: Phasors) -> float:
    """The delay of least error, to a hundredth of a tick: coarse over 20 ms, then finer and finer."""
    middle, step_ticks = 0.0, 1.0
    candidates = np.arange(-4.0, 40.0)
    for _ in range(3):
        errors = [_late_error_um(reference_um, plate_um, float(ticks)) for ticks in candidates]
        middle = float(candidates[int(np.argmin(errors))])
        candidates = middle + step_ticks * np.linspace(-1.0, 1.0, 21)
        step_ticks /= 10
    return middle


def _late_error_um(reference_um: Phasors, plate_um: Phasors, delay_ticks: float) -> float:
    """RMS distance from the reference `delay_ticks` ago, linear between ticks; the ends are left out."""
    ticks = np.arange(50, len(plate_um) - 50)
    then = ticks - delay_ticks
    whole = np.floor(then).astype(int)
    share = (then - whole)[:, np.newaxis]
    late_um = reference_um[whole] * (1 - share) + reference_um[whole + 1] * share
    return _rms_um(plate_um[ticks] - late_um)


def _rms_um(w_um: Phasors) -> float:
    return math.sqrt(float(np.mean(np.abs(w_um) ** 2)))


def _ticking(controller: str, ticks: int) -> Callable[[], object]:
    board, trace = new_board(controller), BoardTrace(ticks, 2, 2)
    phi, decay_1_s = np.zeros((ticks, 0, 2)), np.zeros((ticks, 0))

    def live() -> None:
        knots = (Knot(0, (1 + 0j, -1 + 0j)),)
        for seq in range(3):
            board.receive(device.encode_reference(seq, SafeDrive(0, knots, LimitReason.NONE), board.t_us))
        board.run(ticks, phi, decay_1_s, trace)

    return live
