"""A finger's load on the plate, learned from touches: what the compensation of parasitic modes needs.

In a control tick the voltage holds each driven mode k against its own losses and the fingers' loads,

    V_k = j / gain_k (dW_k/dt + (decay_k - j detuning_k) W_k + load sum_i phi_k(P_i) u_i)

with u_i, the motion under finger i, by all modes (`core.plate.parasitic_modes`). Both W and u are large, so least
squares tell what either costs in volts, and their ratio is the load in units of the bare mode's decay, which is known.
The slope dW/dt is small and noisy: as a unit it would make loads too small.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..core.plate.mode_shapes import ModeShapes
from ..core.plate.parasitic_modes import ParasiticModes
from ..values import ComplexArray, FloatArray
from .touch.model import LATENCY, Calibration
from .touch.observations import WINDOW_S, Windows

LEAST_TOUCHED_S = 5.0
APART_FRAC = 0.2  # by which two halves of the touches may differ
WORTH_FRAC = 0.25  # a load known to a quarter leaves a quarter of what parasitic modes give a still finger
_ROUNDS = 6  # the parasitic modes' own motion depends on the load


def learned_1_s(
    windows: Windows,
    modes: ModeShapes,
    parasitic_modes: ParasiticModes,
    decay_1_s: Sequence[float],
    calibration: Calibration,
) -> complex | None:
    """Return decay less j times detuning (1/s, rad/s) that a finger adds to a mode with |phi| = 1 under it.

    None where touches do not tell, or tell what is known already. `decay_1_s` (M,) is that of the bare driven modes;
    `calibration` says where the pad lies.
    """
    if len(windows) * WINDOW_S < LEAST_TOUCHED_S:
        return None
    is_first = np.floor(windows.start_s) % 2 == 0
    halves = [
        _load_1_s(windows.part(half), modes, parasitic_modes, np.asarray(decay_1_s), calibration)
        for half in (is_first, ~is_first)
    ]
    mean_1_s = sum(halves) / 2.0
    known_1_s = complex(parasitic_modes.finger_decay_1_s, -parasitic_modes.finger_detuning_rad_s)
    is_agreed = abs(halves[0] - halves[1]) < APART_FRAC * abs(mean_1_s) and mean_1_s.real > 0.0
    return mean_1_s if is_agreed and abs(mean_1_s - known_1_s) > WORTH_FRAC * abs(known_1_s) else None


def _load_1_s(
    windows: Windows,
    modes: ModeShapes,
    parasitic_modes: ParasiticModes,
    decay_1_s: FloatArray,
    calibration: Calibration,
) -> complex:
    """Return the load that explains all windows, the mean of what each driven mode tells."""
    phi, beside = _shapes(windows, (modes, parasitic_modes.modes), calibration)
    used = windows.is_used
    w_um, voltage_v = windows.measured_um[used], windows.voltage_v[used]
    slope_um_s = windows.slope_um_s[used] + 1j * windows.turning_rad_s[used][:, None] * w_um
    own_1_s = np.array(parasitic_modes.decay_1_s) - 1j * np.array(parasitic_modes.detuning_rad_s)
    load_1_s = complex(parasitic_modes.finger_decay_1_s, -parasitic_modes.finger_detuning_rad_s)
    for _ in range(_ROUNDS):
        coupling = np.einsum("tin,n,tjn->tij", beside, load_1_s / own_1_s, beside) + np.eye(phi.shape[1])
        under_um = np.linalg.solve(coupling, np.einsum("tik,tk->ti", phi, w_um)[..., None])[..., 0]
        force_um = np.einsum("tik,ti->tk", phi, under_um)
        load_1_s = complex(
            np.mean(
                [
                    _ratio(slope_um_s[:, mode], w_um[:, mode], force_um[:, mode], voltage_v[:, mode]) * decay_1_s[mode]
                    for mode in range(modes.M)
                ]
            )
        )
    return load_1_s


def _ratio(slope_um_s: ComplexArray, w_um: ComplexArray, force_um: ComplexArray, voltage_v: ComplexArray) -> complex:
    """Return the load in units of the mode's own decay: the ratio of volts per um that they need."""
    columns = np.stack((slope_um_s, w_um, force_um), axis=-1)
    _, own_v_um, load_v_um = np.linalg.lstsq(columns, voltage_v, rcond=None)[0]
    return complex(-1j * load_v_um / (-1j * own_v_um).real)


def _shapes(windows: Windows, maps: Sequence[ModeShapes], calibration: Calibration) -> list[FloatArray]:
    """Return each map's shapes (T, N, K) under the fingers at the ticks in use, 0 where there is none."""
    matrix, offset_mm = calibration.affine
    reported_mm = windows.fingers_mm(float(calibration.pad[LATENCY]))[0][windows.is_used]
    is_down = np.isfinite(reported_mm).all(axis=-1)
    points_mm = reported_mm[is_down] @ matrix.T + offset_mm
    found = []
    for modes in maps:
        shapes = np.zeros((*is_down.shape, modes.M))
        shapes[is_down] = modes.evaluate(points_mm)
        found.append(shapes)
    return found
