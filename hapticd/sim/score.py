"""Score of a run: amplitude at each finger's true position, from the plate's true motion.

    leak        RMS |W_i| of the fingers with target 0
    slip error  RMS (|W_i| - a_i) of the others
    slip        mean |W_i| / a_i of the others

A finger counts from 0.1 s after it landed or its target changed: the system cannot respond earlier.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

SETTLE_S = 0.1


@dataclass(frozen=True, slots=True)
class Score:
    """Figures of one run; NaN where no finger contributes."""

    leak_um: float
    slip_error_um: float
    slip_frac: float
    limited_frac: float
    largest_reference_um: float


def score(
    t_s: npt.NDArray[np.float64],
    target_um: npt.NDArray[np.float64],
    truth_um: npt.NDArray[np.complex128],
    reference_um: npt.NDArray[np.complex128],
    limited: npt.NDArray[np.bool_],
) -> Score:
    """Score a run: t_s (T,), target_um and truth_um (T,N), NaN where a finger is absent, reference_um (T,M)."""
    counts = settled(t_s, target_um)
    finger_um = np.abs(truth_um)
    still = counts & (target_um == 0)
    slipping = counts & (target_um > 0)
    return Score(
        leak_um=_rms(finger_um[still]),
        slip_error_um=_rms(finger_um[slipping] - target_um[slipping]),
        slip_frac=float(np.mean(finger_um[slipping] / target_um[slipping])) if slipping.any() else float("nan"),
        limited_frac=float(np.mean(limited)) if limited.size else float("nan"),
        largest_reference_um=float(np.abs(reference_um).max(initial=0.0)),
    )


def settled(t_s: npt.NDArray[np.float64], target_um: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Return where a finger counts (T,N): its target was constant for the last SETTLE_S."""
    if len(t_s) < 2:
        return np.zeros(target_um.shape, dtype=bool)
    steps = round(SETTLE_S / (t_s[1] - t_s[0]))
    changed = np.ones(target_um.shape, dtype=bool)
    changed[1:] = target_um[1:] != target_um[:-1]  # NaN differs from itself, so an absent finger never settles
    since = np.arange(len(t_s))[:, None] - np.maximum.accumulate(
        np.where(changed, np.arange(len(t_s))[:, None], 0), axis=0
    )
    return np.asarray((since >= steps) & np.isfinite(target_um))


def _rms(values: npt.NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
