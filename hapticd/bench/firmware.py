"""How well the plate follows its reference under each control law, beside the voltage's bound and an outside LQG.

Everything but the LQG runs the firmware's own C against the plate model (`closed_loop`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from ..sim.board.board import BoardTrace
from ..values import Knot, LimitReason, SafeDrive
from ..wire import device
from . import lqg
from .closed_loop import Law, Phasors, Plate, Response, measure
from .loop_figures import (
    LARGE_UM,
    UNREACHABLE_UM,
    node_leak_um,
    other_mode_frac,
    saturation_figures,
    sinusoid_figures,
    stroke_figures,
)
from .tables import Row, Table, finite_rows
from .timing import REPEATS, compare, optional

DEFAULT = "deadbeat"
PAPER = "pi"
BOUND = "the voltage's bound"
LAWS = {
    "deadbeat": Law("deadbeat"),
    "deadbeat, 5 kHz": Law("deadbeat", 5000.0),
    "pi_ff": Law("pi_ff"),
    "pi_ff, 5 kHz": Law("pi_ff", 5000.0),
    "pi": Law("pi"),
}
OUTSIDE = {"LQG (outside)": 2000.0, "LQG (outside), 5 kHz": 5000.0}
SMALL_UM = 0.4
QUALITIES = (200.0, 500.0, 1000.0)
CORNERS = tuple((damping, detune_hz) for damping in (0.5, 1.0, 1.5) for detune_hz in (-20.0, 0.0, 20.0))
FREQUENCIES_HZ = (2.0, 5.0, 10.0, 15.0)
SPEEDS_MM_S = (100.0, 200.0)

Respond = Callable[[Plate, float], Phasors]


def run(
    *,
    frequencies_hz: Sequence[float] = FREQUENCIES_HZ,
    speeds_mm_s: Sequence[float] = SPEEDS_MM_S,
    qualities: Sequence[float] = QUALITIES,
    repeats: int = REPEATS,
    ticks: int = 2000,
) -> tuple[Table, ...]:
    """All tables; `ticks` control ticks are timed on the host."""
    times = compare({name: (_ticking(law, ticks), ticks) for name, law in LAWS.items()}, repeats)
    steps = [
        (name, {**_step_figures(respond, tick_ms), **_own_figures(name, times[name].figures("host_tick"))})
        for name, respond, tick_ms in _followers()
        if name in times
    ]
    steps += [(name, _step_figures(respond, ms)) for name, respond, ms in _followers() if name not in times]
    steps.append((BOUND, {"small_ms": Plate().bound_ms(SMALL_UM), "large_ms": Plate().bound_ms(LARGE_UM)}))
    return (
        _step_table(finite_rows(steps)),
        _corner_table(qualities),
        _tracking_table(frequencies_hz),
        _stroke_table(speeds_mm_s),
    )


def _followers() -> Iterator[tuple[str, Respond, float]]:
    """Everything that can be asked to follow a step: name, response, tick (ms)."""
    for name, law in LAWS.items():
        yield name, law.respond, law.tick_ms
    linalg = optional("scipy.linalg")
    if linalg is not None:
        for name, control_hz in OUTSIDE.items():
            yield name, _outside(control_hz, linalg), 1e3 / control_hz


def _outside(control_hz: float, linalg: Any) -> Respond:
    return lambda plate, amplitude_um: lqg.respond(plate, amplitude_um, control_hz, linalg)


# --- steps and landings ---


def _step_figures(respond: Respond, tick_ms: float) -> dict[str, float]:
    small = measure(respond(Plate(), SMALL_UM), SMALL_UM, tick_ms)
    large = measure(respond(Plate(), LARGE_UM), LARGE_UM, tick_ms)
    return {
        "small_ms": small.settling_ms,
        "large_ms": large.settling_ms,
        "overshoot_frac": max(small.overshoot_frac, large.overshoot_frac),
        "cross_axis_frac": max(small.cross_axis_frac, large.cross_axis_frac),
        "landing_ms": large.recovery_ms,
        "landing_dip_frac": large.dip_frac,
    }


def _own_figures(name: str, times: dict[str, float]) -> dict[str, float]:
    law = LAWS[name]
    saturation = saturation_figures(law)
    return {
        "other_mode_frac": other_mode_frac(law),
        "node_um": node_leak_um(law),
        "unreachable_phase_deg": saturation["phase_deg"],
        "let_go_ms": saturation["let_go_ms"],
        "largest_voltage_v": saturation["largest_voltage_v"],
        **times,
    }


def _step_table(rows: tuple[Row, ...]) -> Table:
    return Table(
        name="step",
        title="firmware: steps of one mode from 0 to 0.4 (small) and 2 um (large), Q 500, 2 kHz unless told",
        default=DEFAULT,
        rows=rows,
        compared=("host_tick_us", "large_ms"),
        time="host_tick_us",
        error="large_ms",
        skipped={} if optional("scipy.linalg") else dict.fromkeys(OUTSIDE, "SciPy is not installed"),
        notes=(
            "settling to 2 %, from the instant of asking; the board hears of it half a millisecond later",
            "landing: fingers take half as much again of the bare decay, at 2 um; until it is back within 2 %",
            "other mode: on the demo's plate; the 1 % that its sensors themselves mix is left out",
            "node: what a still finger feels at most while the other's amplitude steps from 0.5 to 3 um",
            f"unreachable: {UNREACHABLE_UM} um of a plate damped 1.8 times; then half of it (let go)",
            "host tick: 1 control tick of firmware and plate model on this machine",
        ),
    )


# --- the corners ---


def worst_response(respond: Respond, quality: float, amplitude_um: float, tick_ms: float) -> Response:
    """The worst of each measure over the corners that the voltage reaches: damping x0.5..x1.5, 20 Hz either way."""
    plates = [Plate(quality, damping, detune_hz) for damping, detune_hz in CORNERS]
    found = [measure(respond(p, amplitude_um), amplitude_um, tick_ms) for p in plates if p.reaches(amplitude_um)]
    return Response(
        settling_ms=max(one.settling_ms for one in found),
        overshoot_frac=max(one.overshoot_frac for one in found),
        cross_axis_frac=max(one.cross_axis_frac for one in found),
        recovery_ms=max(one.recovery_ms for one in found),
        dip_frac=max(one.dip_frac for one in found),
    )


def _corner_table(qualities: Sequence[float]) -> Table:
    rows: list[tuple[str, dict[str, float]]] = []
    for name, respond, tick_ms in _followers():
        for quality in qualities:
            worst = {um: worst_response(respond, quality, um, tick_ms) for um in (SMALL_UM, LARGE_UM)}
            figures = {
                "small_ms": worst[SMALL_UM].settling_ms,
                "large_ms": worst[LARGE_UM].settling_ms,
                "small_overshoot_frac": worst[SMALL_UM].overshoot_frac,
                "large_overshoot_frac": worst[LARGE_UM].overshoot_frac,
                "large_cross_axis_frac": worst[LARGE_UM].cross_axis_frac,
            }
            rows.append((f"{name}, Q {quality:g}", figures))
    for quality in qualities:
        plates = [Plate(quality, damping, detune_hz) for damping, detune_hz in CORNERS]
        bounds = {um: max(p.bound_ms(um) for p in plates if p.reaches(um)) for um in (SMALL_UM, LARGE_UM)}
        rows.append((f"{BOUND}, Q {quality:g}", {"small_ms": bounds[SMALL_UM], "large_ms": bounds[LARGE_UM]}))
    return Table(
        name="corners",
        title="firmware: the worst over damping x0.5, x1, x1.5 and 20 Hz either way",
        default=f"{DEFAULT}, Q {500.0 if 500.0 in qualities else qualities[0]:g}",
        rows=finite_rows(rows),
        compared=("large_ms",),
        time="small_ms",
        error="large_ms",
        notes=("corners in which the voltage cannot hold the amplitude are left out",),
    )


# --- moving references ---


def _tracking_table(frequencies_hz: Sequence[float]) -> Table:
    rows = [
        (f"{name}, {f_hz:g} Hz", {"frequency_hz": f_hz, **sinusoid_figures(law, f_hz)})
        for name, law in LAWS.items()
        for f_hz in frequencies_hz
    ]
    return Table(
        name="tracking",
        title="firmware: sinusoids of 3 um, sent as 3 ms knots 90 times a second",
        default=f"{DEFAULT}, {10.0 if 10.0 in frequencies_hz else frequencies_hz[0]:g} Hz",
        rows=finite_rows(rows),
        compared=("error_um",),
        error="error_um",
        across="frequency_hz",
        notes=("residual: what is left of the error once the delay is taken out",),
    )


def _stroke_table(speeds_mm_s: Sequence[float]) -> Table:
    rows = [
        (f"{name}, {speed:g} mm/s", stroke_figures(law, speed)) for name, law in LAWS.items() for speed in speeds_mm_s
    ]
    return Table(
        name="strokes",
        title="firmware: two fingers' strokes, known perfectly: how the plate follows the solver's amplitudes",
        default=f"{DEFAULT}, {speeds_mm_s[0]:g} mm/s",
        rows=finite_rows(rows),
        compared=("error_um",),
        time="error_um",
        error="leak_um",
        notes=("leak: what the loop alone lets the still finger feel",),
    )


def _ticking(law: Law, ticks: int) -> Callable[[], object]:
    board, trace = law.board(Plate()), BoardTrace(ticks, 2, 2)
    phi, decay_1_s = np.zeros((ticks, 0, 2)), np.zeros((ticks, 0))

    def live() -> None:
        knots = (Knot(0, (1 + 0j, -1 + 0j)),)
        for seq in range(3):
            board.receive(device.encode_reference(seq, SafeDrive(0, knots, LimitReason.NONE), board.t_us))
        board.run(ticks, phi, decay_1_s, trace)

    return live
