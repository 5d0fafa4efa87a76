"""Control laws of the firmware: how fast and how well the plate follows its reference.

The laws, which run as the firmware's own C against the plate model (`closed_loop`), are compared with the bound that
the amplifier's voltage sets.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..sim.board.board import BoardTrace
from ..sim.board.closed_loop import Law, LoopPlate, Response, measure
from ..values import Knot, LimitReason, SafeDrive
from ..wire import device
from .tables import Table
from .timing import REPEATS, least_us

LAWS = {
    "deadbeat": Law("deadbeat"),
    "deadbeat, 5 kHz": Law("deadbeat", 5000.0),
    "pi_ff": Law("pi_ff"),
    "pi": Law("pi"),
}
SMALL_UM, LARGE_UM = 0.4, 2.0
DAMPINGS, DETUNES_HZ = (0.5, 1.0, 1.5), (-20.0, 0.0, 20.0)


def run(*, repeats: int = REPEATS, ticks: int = 2000) -> tuple[Table]:
    """Steps and landings; `ticks` control ticks are timed on the host."""
    times_us = least_us({name: (_ticking(law, ticks), ticks) for name, law in LAWS.items()}, repeats)
    rows = {}
    for name, law in LAWS.items():
        small, large = (measure(law.respond(LoopPlate(), um), um, law.tick_ms) for um in (SMALL_UM, LARGE_UM))
        worst = worst_response(law, LARGE_UM)
        rows[name] = {
            "host_tick_us": times_us[name],
            "small_ms": small.settling_ms,
            "large_ms": large.settling_ms,
            "worst_ms": worst.settling_ms,
            "worst_overshoot_frac": worst.overshoot_frac,
            "landing_ms": large.recovery_ms,
            "landing_dip_frac": large.dip_frac,
        }
    rows["the voltage's bound"] = {
        "small_ms": LoopPlate().bound_ms(SMALL_UM),
        "large_ms": LoopPlate().bound_ms(LARGE_UM),
        "worst_ms": max(plate.bound_ms(LARGE_UM) for plate in _corners(LARGE_UM)),
    }
    title = "firmware: settling of one mode to 2 % after a step from 0 to 0.4 (small) and 2 um (large), Q 500"
    notes = (
        "from the instant of asking, a tick before the board receives the step; 2 kHz unless named",
        "worst: of damping x0.5, x1, x1.5 and 20 Hz either way, where the voltage can hold 2 um",
        "landing: fingers raise the damping by half at 2 um; time until the plate is back within 2 %",
        "host tick: one control tick of firmware and plate model on this machine",
    )
    return (Table("firmware", title, rows, notes),)


def _corners(amplitude_um: float) -> list[LoopPlate]:
    """The corners in which the voltage can hold the amplitude."""
    plates = [LoopPlate(damping=damping, detune_hz=detune_hz) for damping in DAMPINGS for detune_hz in DETUNES_HZ]
    return [plate for plate in plates if plate.reaches(amplitude_um)]


def worst_response(law: Law, amplitude_um: float) -> Response:
    """The worst of each measure over the corners in which the voltage can hold the amplitude."""
    found = [measure(law.respond(plate, amplitude_um), amplitude_um, law.tick_ms) for plate in _corners(amplitude_um)]
    return Response(*map(max, zip(*found, strict=True)))


def _ticking(law: Law, ticks: int) -> Callable[[], object]:
    board, trace = law.board(LoopPlate()), BoardTrace(ticks, 2, 2)
    phi, decay_1_s = np.zeros((ticks, 0, 2)), np.zeros((ticks, 0))

    def live() -> None:
        knots = (Knot(0, (1 + 0j, -1 + 0j)),)
        for seq in range(3):
            board.receive(device.encode_reference(seq, SafeDrive(0, knots, LimitReason.NONE), board.t_us))
        board.run(ticks, phi, decay_1_s, trace)

    return live
