"""Signs for a scan by added mass: how far a grain of wax lowers a mode's frequency goes with the mode's square there.

The free-plate mode that is most like the readings' magnitudes gives the first signs. Modes near its frequency, fitted
to the signed readings, give the next, until no sign changes. Where a sign is wrong nevertheless, the mode is near zero.

Source of the measure: Lord Rayleigh, The Theory of Sound (1877), ch. 4: a small mass lowers a frequency by its share of
the kinetic energy.
"""

from __future__ import annotations

import numpy as np

from hapticd.errors import ModesError
from hapticd.values import FloatArray

from .free_fit import BAND_FRAC, FreePlateModes

_WAVE_RAD, _WAVE_BAND_FRAC = 36.0, 0.9  # k times the longer edge, and of the frequency about it: 11 to 50 rad
_LEAST_ALIKE = 0.75  # cosine of magnitudes; those of two modes by chance have 0.64
_MOST_ROUNDS = 30


def signed(points_mm: FloatArray, lowered_hz: FloatArray, size_mm: tuple[float, float]) -> FloatArray:
    """Return the modes at the points (N, M), in roots of Hz, NaN where missing. Raises ModesError."""
    theory = FreePlateModes(size_mm, _WAVE_RAD / max(size_mm), band_frac=_WAVE_BAND_FRAC)
    shapes = theory.at(points_mm)
    columns = [_signed(shapes, theory.frequencies_hz, lowered_hz[:, mode], mode) for mode in range(lowered_hz.shape[1])]
    return np.stack(columns, axis=1)


def _signed(shapes: FloatArray, frequencies_hz: FloatArray, lowered_hz: FloatArray, mode: int) -> FloatArray:
    known = np.isfinite(lowered_hz)
    root = np.sqrt(np.maximum(lowered_hz[known], 0.0))
    sizes = np.abs(shapes[known])
    lengths = np.linalg.norm(root) * np.linalg.norm(sizes, axis=0)
    alike = root @ sizes / np.maximum(lengths, np.finfo(float).tiny)
    likest = int(alike.argmax())
    if not alike[likest] >= _LEAST_ALIKE:
        raise ModesError(
            f"lowered_hz_{mode + 1} is like no mode of a free plate; check --size, that positions are in mm from its "
            "centre, and that lower frequencies are positive."
        )
    near = shapes[known][:, np.abs(frequencies_hz / frequencies_hz[likest] - 1.0) <= BAND_FRAC]
    signs = np.sign(shapes[known][:, likest])
    for _ in range(_MOST_ROUNDS):
        before, signs = signs, np.sign(near @ np.linalg.lstsq(near, signs * root, rcond=None)[0])
        if np.array_equal(signs, before):
            break
    found = np.full(lowered_hz.shape, np.nan)
    found[known] = signs * root
    return found
