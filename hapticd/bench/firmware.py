"""Control laws of the firmware: how fast and how well the plate follows its reference.

The laws, which run as the firmware's own C against the plate model (`closed_loop`), are compared with the bound that
the amplifier's voltage sets.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..sim.board.board import CHUNK_S, BoardTrace
from ..values import ComplexArray, Knot, LimitReason, SafeDrive
from ..wire import device
from .closed_loop import Law, LoopPlate, Response, measure, straight_bound_ms
from .loop_figures import LARGE_UM, coupling_figures, node_leak_um, sinusoid_figures, stroke_figures
from .tables import Table, finite_rows
from .timing import REPEATS, compare

DEFAULT = "deadbeat"
STEP_MS = CHUNK_S * 1e3  # between two rows of a response
BOUND = "the voltage's bound"
LAWS = {
    "deadbeat": Law("deadbeat"),
    "deadbeat, 5 kHz": Law("deadbeat", 5000.0),
    "pi_ff": Law("pi_ff"),
    "pi": Law("pi"),
}
SMALL_UM = 0.4
QUALITY = 500.0
DAMPINGS = (0.5, 1.0, 1.5)
NEAR_HZ, FAR_HZ = (-20.0, 0.0, 20.0), (-50.0, -20.0, 0.0, 20.0, 50.0)
SINUSOID_HZ, STROKE_MM_S = 10.0, 100.0

Respond = Callable[[LoopPlate, float], ComplexArray]


def run(*, repeats: int = REPEATS, ticks: int = 2000) -> tuple[Table, Table]:
    """Steps, and moving references; `ticks` control ticks are timed on the host."""
    return _steps(repeats, ticks), _tracking()


def _steps(repeats: int, ticks: int) -> Table:
    times = compare({name: (_ticking(law, ticks), ticks) for name, law in LAWS.items()}, repeats)
    rows = []
    for name, law in LAWS.items():
        tick_ms = law.tick_ms
        small, large = (measure(law.respond(LoopPlate(), um), um, tick_ms, STEP_MS) for um in (SMALL_UM, LARGE_UM))
        worst, far = (
            worst_response(law.respond, QUALITY, LARGE_UM, tick_ms, detunes_hz=detunes) for detunes in (NEAR_HZ, FAR_HZ)
        )
        figures = {
            "small_ms": small.settling_ms,
            "large_ms": large.settling_ms,
            "worst_ms": worst.settling_ms,
            "worst_overshoot_frac": worst.overshoot_frac,
            "far_ms": far.settling_ms,
            "far_cross_frac": far.cross_axis_frac,
            "landing_ms": large.recovery_ms,
            "landing_dip_frac": large.dip_frac,
            "node_um": node_leak_um(law),
            **coupling_figures(law),
            **times[name].figures("host_tick"),
        }
        rows.append((name, figures))
    bounds = {
        "small_ms": LoopPlate().bound_ms(SMALL_UM),
        "large_ms": LoopPlate().bound_ms(LARGE_UM),
        "worst_ms": max(plate.bound_ms(LARGE_UM) for plate in _corners(QUALITY, LARGE_UM, NEAR_HZ)),
        "far_ms": max(straight_bound_ms(plate, LARGE_UM) for plate in _corners(QUALITY, LARGE_UM, FAR_HZ)),
    }
    return Table(
        name="step",
        title="firmware: settling of one mode to 2 % after a step from 0 to 0.4 (small) and 2 um (large), Q 500",
        default=DEFAULT,
        rows=finite_rows([*rows, (BOUND, bounds)]),
        compared=("large_ms", "worst_ms"),
        time="host_tick_us",
        error="large_ms",
        notes=(
            "from the instant of asking, a tick before the board receives the step; 2 kHz unless named",
            "worst: of damping x0.5, x1, x1.5 and 20 Hz either way, where the voltage can hold 2 um",
            "far: the same to 50 Hz either way, bound: a straight way; far cross: largest share on the other axis",
            "landing: fingers raise the damping by half at 2 um; time until the plate is back within 2 %",
            "node: largest vibration of a still finger while the other's amplitude steps from 0.5 to 3 um",
            "coupled: peak of the other mode, and its time above 20 nm, while one steps to 1 um at full voltage under "
            "a finger that couples both by 591 1/s and that the board has not felt yet",
            "host tick: one control tick of firmware and plate model on this machine",
        ),
    )


def _corners(quality: float, amplitude_um: float, detunes_hz: Sequence[float]) -> list[LoopPlate]:
    """The corners in which the voltage can hold the amplitude."""
    plates = [LoopPlate(quality, damping, detune_hz) for damping in DAMPINGS for detune_hz in detunes_hz]
    return [plate for plate in plates if plate.reaches(amplitude_um)]


def worst_response(
    respond: Respond,
    quality: float,
    amplitude_um: float,
    tick_ms: float,
    detunes_hz: Sequence[float] = NEAR_HZ,
) -> Response:
    """The worst of each measure over the corners in which the voltage can hold the amplitude."""
    plates = _corners(quality, amplitude_um, detunes_hz)
    found = [measure(respond(plate, amplitude_um), amplitude_um, tick_ms, STEP_MS) for plate in plates]
    return Response(*map(max, zip(*found, strict=True)))


def _tracking() -> Table:
    rows = []
    for name, law in LAWS.items():
        sinusoid, strokes = sinusoid_figures(law, SINUSOID_HZ), stroke_figures(law, STROKE_MM_S)
        figures = {"sinusoid_error_um": sinusoid["error_um"], "sinusoid_delay_ms": sinusoid["delay_ms"], **strokes}
        rows.append((name, figures))
    return Table(
        name="tracking",
        title="firmware: moving references: sinusoids of 3 um at 10 Hz, and two fingers' strokes at 10 cm/s",
        default=DEFAULT,
        rows=finite_rows(rows),
        compared=("sinusoid_error_um", "leak_um"),
        error="leak_um",
        notes=(
            "error, delay, residual: of strokes whose positions are known; residual: error without the delay",
            "leak: vibration that the loop alone causes at the still finger",
        ),
    )


def _ticking(law: Law, ticks: int) -> Callable[[], object]:
    board, trace = law.board(LoopPlate()), BoardTrace(ticks, 2, 2)
    phi, decay_1_s = np.zeros((ticks, 0, 2)), np.zeros((ticks, 0))

    def live() -> None:
        knots = (Knot(0, (1 + 0j, -1 + 0j)),)
        for seq in range(3):
            board.receive(device.encode_reference(seq, SafeDrive(0, knots, LimitReason.NONE), board.t_us))
        board.run(ticks, phi, decay_1_s, trace)

    return live
