"""Figures of the closed loop beyond plain steps: other modes, nodes, saturation, moving references.

All run the firmware's own C against the plate model.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from ..core.solver.public import solve_batch
from ..sim.board.board import Board, BoardTrace
from ..sim.fingers.scenarios import SCENARIOS, SLIPPERY_UM, STICKY_UM
from ..sim.plate.ground_truth import GroundTruth
from ..sim.score import rms
from ..sim.world import board_config, plate_model
from ..values import ComplexArray, FloatArray
from .closed_loop import SETTLED_FRAC, Law, LoopPlate, follow, step, stepped, tracking_figures

LARGE_UM = 2.0
COUPLING_PHI, COUPLING_1_S = 0.9, 730.0
STROKES_S = 2.0


def node_leak_um(law: Law) -> float:
    """Largest vibration of a still finger while the other's amplitude steps: both modes move along its node."""
    still, along = np.array([0.6, -0.8]), np.array([0.8, 0.6], dtype=np.complex128)
    w_um = step(law.board(LoopPlate(), noise_um=0.0), 0.5 * along, 3.0 * along)
    return float(np.abs(w_um @ still).max())


def coupling_figures(law: Law, *, noise_um: float = 0.0) -> dict[str, float]:
    """Peak of the other mode, and its time above 20 nm, while one steps from rest to 1 um under a new finger.

    The finger couples both modes by 591 1/s; the board has learned nothing of it.
    """
    ticks, one = law.phase_ticks, np.array([1.0 + 0j, 0.0])
    phi, decay_1_s = np.full((2 * ticks, 1, 2), COUPLING_PHI), np.full((2 * ticks, 1), COUPLING_1_S)

    board = law.board(LoopPlate(), noise_um=noise_um)
    trace = follow(board, stepped(0 * one, one), 2 * ticks, ticks // 10, (phi, decay_1_s))
    other_um = np.abs(trace.plate_um[:, 1])
    return {
        "coupled_um": float(other_um.max()),
        "coupled_ms": float(np.count_nonzero(other_um > SETTLED_FRAC)) * law.tick_ms,
    }


def tracking_trace(law: Law, f_hz: float) -> BoardTrace:
    """Sinusoids of 3 um, sent as polylines of 3 ms knots 90 times a second."""

    def amplitudes(t_s: float) -> ComplexArray:
        return 3 * np.array([np.sin(2 * np.pi * f_hz * t_s), np.cos(1.6 * np.pi * f_hz * t_s)]) + 0j

    def knots(t_s: float) -> list[tuple[float, ComplexArray]]:
        return [(ms, amplitudes(t_s + ms * 1e-3)) for ms in range(0, 18, 3)]

    return follow(law.board(LoopPlate()), knots, round(0.8 * law.control_hz), round(0.011 * law.control_hz))


def sinusoid_figures(law: Law, f_hz: float) -> dict[str, float]:
    trace, settled = tracking_trace(law, f_hz), law.phase_ticks
    return tracking_figures(trace.reference_um[settled:], trace.plate_um[settled:], law.tick_ms)


def stroke_figures(law: Law, speed_mm_s: float) -> dict[str, float]:
    """Tracking of the solver's amplitudes for two stroking fingers, one slippery and one still, at known positions.

    Sent as 1 ms knots 90 times a second; the fingers damp and couple the plate's modes.
    """
    t_s, phi, solved_um = _strokes(speed_mm_s)
    truth = GroundTruth()
    board = _truth_board(law, truth)
    ticks, period_s = round(STROKES_S * law.control_hz), 0.011

    def knots(now_s: float) -> list[tuple[float, ComplexArray]]:
        first = round(now_s * 1e3)
        return [(float(i), solved_um[min(first + i, len(solved_um) - 1)] + 0j) for i in range(17)]

    at_ticks = np.minimum((np.arange(ticks) + 1) / law.control_hz, t_s[-1])
    phi_ticks = np.ascontiguousarray(phi[np.round(at_ticks * 1e3).astype(int)])
    decay_1_s = np.full((ticks, 2), truth.finger_decay_1_s)
    trace = follow(board, knots, ticks, round(period_s * law.control_hz), (phi_ticks, decay_1_s))
    settled = slice(law.phase_ticks, None)
    figures = tracking_figures(trace.reference_um[settled], trace.plate_um[settled, :2], law.tick_ms)
    still_um = np.einsum("tp,tp->t", phi_ticks[settled, 1, :2], trace.plate_um[settled, :2])
    return {**figures, "leak_um": rms(still_um)}


@lru_cache(maxsize=4)
def _strokes(speed_mm_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Each millisecond: time (T,), shapes under both fingers (T, 2, P), modal amplitudes (T, 2) of the solver."""
    t_s: FloatArray = np.arange(round(STROKES_S * 1e3) + 1, dtype=np.float64) * 1e-3
    actors = SCENARIOS["strokes"].build(1, speed_mm_s)
    paths = [actor.path for actor in actors if actor.path is not None]
    phi = GroundTruth().shapes(np.stack([path.position_mm(t_s + 1.0) for path in paths], axis=1))
    solved_um = solve_batch(phi[..., :2], (SLIPPERY_UM, STICKY_UM), 4.0)
    return t_s, phi, solved_um


def _truth_board(law: Law, truth: GroundTruth) -> Board:
    config = board_config(truth, truth.w_limit_um)
    return Board(plate_model(truth), config=replace(config, controller=law.controller, control_hz=law.control_hz))
