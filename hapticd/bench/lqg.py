"""Reference for the firmware's control laws: a textbook discrete LQG with a disturbance state.

Designed by SciPy's Riccati solver, run in float64, on the exact solution of one mode of the reference plate with the
board's timing: the voltage takes effect one chunk after the tick, the measurement is the mean over a tick. Like the
firmware it has the nominal plate and the voltage limit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..sim.board.board import CHUNK_S, reference_decay_1_s, reference_gain_um_per_v_s
from .closed_loop import LANDED_DAMPING, LIMIT_V, NOISE_UM, PHASE_S, Phasors, Plate

ERROR_UM = 0.02  # Bryson's rule: this error weighs as much as the largest voltage
DISTURBANCE_V = 3.0  # change of the disturbance within a millisecond


@dataclass(frozen=True, slots=True)
class Hold:
    """One mode under a constant voltage for a time: final and mean amplitude, per initial um and per V."""

    keep: complex
    push: complex
    mean_keep: complex
    mean_push: complex


def hold(rate_1_s: complex, gain: float, span_s: float) -> Hold:
    """dW/dt = rate W + gain u, solved over `span_s`."""
    keep = np.exp(rate_1_s * span_s)
    mean_keep = (keep - 1) / (rate_1_s * span_s)
    return Hold(keep, gain * span_s * mean_keep, mean_keep, gain * (mean_keep - 1) / rate_1_s)


class Lqg:
    """The controller of one mode. `scipy_linalg` is SciPy's module."""

    def __init__(self, quality: float, control_hz: float, scipy_linalg: Any) -> None:
        tick_s = 1 / control_hz
        rate_1_s = complex(-reference_decay_1_s(quality)[0], -20 * math.pi)
        gain = reference_gain_um_per_v_s(quality)
        early, late = hold(rate_1_s, gain, CHUNK_S), hold(rate_1_s, gain, tick_s - CHUNK_S)
        early_share = CHUNK_S / tick_s
        # State: W at the tick, the voltage that is still in effect, the disturbance in volts.
        self._f = np.array(
            [[late.keep * early.keep, late.keep * early.push, late.keep * early.push + late.push], [0, 0, 0], [0, 0, 1]]
        )
        self._g = np.array([late.push, 1, 0])
        mean_of_w = early_share * early.mean_keep + (1 - early_share) * late.mean_keep * early.keep
        mean_of_old = early_share * early.mean_push + (1 - early_share) * late.mean_keep * early.push
        self._new_mean = (1 - early_share) * late.mean_push
        self._h = np.array([mean_of_w, mean_of_old, mean_of_old + self._new_mean])
        self._holding_v = -rate_1_s / gain
        self._k = self._regulator(scipy_linalg)
        self._l = self._filter(scipy_linalg, tick_s)
        self._x: Phasors = np.zeros(3, complex)

    def _regulator(self, linalg: Any) -> Phasors:
        f, g = self._f[:2, :2], self._g[:2, np.newaxis]
        weight = np.diag([1 / ERROR_UM**2, 0.0])
        cost = np.array([[1 / LIMIT_V**2]])
        p = linalg.solve_discrete_are(f, g, weight, cost)
        gains: Phasors = np.linalg.solve(cost + g.conj().T @ p @ g, g.conj().T @ p @ f)[0]
        return gains

    def _filter(self, linalg: Any, tick_s: float) -> Phasors:
        noise = np.diag([(NOISE_UM / 10) ** 2, 1e-12, (DISTURBANCE_V * tick_s * 1e3) ** 2])
        h = self._h[np.newaxis, :]
        p = linalg.solve_discrete_are(self._f.conj().T, h.conj().T, noise, np.array([[2 * NOISE_UM**2]]))
        gains: Phasors = (p @ h.conj().T / (h @ p @ h.conj().T + 2 * NOISE_UM**2))[:, 0]
        return gains

    def tick(self, target_um: complex, measured_um: complex, last_v: complex) -> complex:
        """Return the next voltage, given the mean over the tick that ended now; `last_v` was decided a tick before."""
        innovation_um = measured_um - self._h @ self._x - self._new_mean * last_v
        self._x = self._f @ (self._x + self._l * innovation_um) + self._g * last_v
        w_um, out_v, disturbance_v = self._x
        steady_v = self._holding_v * target_um - disturbance_v
        u_v = steady_v - self._k @ np.array([w_um - target_um, out_v - steady_v])
        return complex(u_v * min(1.0, LIMIT_V / max(abs(u_v), 1e-9)))


def respond(plate: Plate, amplitude_um: float, control_hz: float, scipy_linalg: Any) -> Phasors:
    """Like `closed_loop.Law.respond`, from rest."""
    controller = Lqg(plate.quality, control_hz, scipy_linalg)
    gain = reference_gain_um_per_v_s(plate.quality)
    ticks = round(PHASE_S * control_hz)
    share = CHUNK_S * control_hz
    noise = np.random.default_rng(0).normal(0.0, NOISE_UM, (3 * ticks, 2)) @ [1, 1j]
    w_um = old_v = new_v = 0j
    rows = np.zeros(3 * ticks, complex)
    for i in range(3 * ticks):
        damping = LANDED_DAMPING if ticks <= i < 2 * ticks else 1.0
        rate_1_s = complex(-damping * plate.decay_1_s, 2 * math.pi * (plate.detune_hz - 10.0))
        early, late = hold(rate_1_s, gain, CHUNK_S), hold(rate_1_s, gain, 1 / control_hz - CHUNK_S)
        mean_um = share * (early.mean_keep * w_um + early.mean_push * old_v)
        w_um = early.keep * w_um + early.push * old_v
        mean_um += (1 - share) * (late.mean_keep * w_um + late.mean_push * new_v)
        w_um = late.keep * w_um + late.push * new_v
        old_v, rows[i] = new_v, w_um
        new_v = controller.tick(amplitude_um, mean_um + noise[i], new_v)
    return rows
