"""Fit of all modes and wires to sweeps of one amplifier at a time, in which all sensors were recorded.

The response of sensor s to amplifier a is y = sum_p R_p[s, a] / (sigma_p - 2 pi j (f_p - f)) + b[s, a]. The poles are
the plate's and the same in every response; they are found by one rational fit with a common denominator (Sanathanan and
Koerner, 1963). The residue of a mode is a product, what the sensors see of it times what the amplifiers do to it, so it
has rank one: its first singular vectors are the columns of both matrices. b is the feedthrough: electrical, and the
nearly constant response of other modes.

A mode's amplitude is the root of the sum of squares over all sensors, positive in the first that sees half of it.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
import numpy.typing as npt

from ..board_values import ModeCalibration
from .resonance import ITERATIONS, MIN_POINTS, Resonance

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

HALF = 0.5  # of the largest: the first such wire gives a mode its sign
SEEN_FRAC = 0.05  # of the strongest residue: a pole with less is no mode of this plate
OWN = 0.5  # of the largest product of a mode's sensor and amplifier: they then belong together


@dataclass(frozen=True, slots=True)
class AmplifierSweep:
    """Responses y / V (n, M) of all sensors to one amplifier at frequencies (n,)."""

    amplifier: int
    frequency_hz: FloatArray
    response_um_per_v: ComplexArray


@dataclass(frozen=True, slots=True)
class MeasuredWiring:
    """The modes with their wires, in the board's order, and their fits.

    `drives` (M, M) complex, modes by amplifiers, is what a volt does to a mode, um/(V s); `senses` (M, M) sensors by
    modes. `background_um_per_v` (M, M) sensors by amplifiers, `residual_frac` the RMS of each mode's residual over its
    largest response.
    """

    fits: tuple[Resonance, ...]
    drives: ComplexArray
    senses: ComplexArray
    background_um_per_v: ComplexArray

    def strongest(self, mode: int) -> int:
        """Return the amplifier that drives the mode most, the first of equal ones."""
        return _first_large(self.drives[mode])

    def modal(self, mode: int, sweep: AmplifierSweep) -> ComplexArray:
        """Return the mode's amplitude per volt (n,) in a sweep."""
        return np.asarray(sweep.response_um_per_v @ np.linalg.inv(self.senses)[mode])

    def calibrations(self) -> list[ModeCalibration]:
        """Return the calibration of every mode. Raises ValueError if the amplifiers cannot drive them independently."""
        sense = np.linalg.inv(self.senses)
        loops = [cmath.rect(1.0, fit.loop_phase_rad) for fit in self.fits]
        shares = np.array([(row / (-1j * loop)).real for row, loop in zip(self.drives, loops, strict=True)])
        if not np.linalg.cond(shares) < 50.0:
            raise ValueError("The amplifiers cannot drive the modes independently: check their wires to the patches.")
        drive = np.linalg.inv(shares)  # columns: volts of each amplifier for a unit of the mode
        largest = np.abs(drive).max(axis=0)
        feedthrough = sense @ self.background_um_per_v
        return [
            ModeCalibration(
                mode,
                fit.frequency_hz,
                fit.q_factor,
                float(1.0 / largest[mode]),
                fit.loop_phase_rad,
                drive=tuple((drive[:, mode] / largest[mode]).tolist()),
                sense=tuple(sense[mode].tolist()),
                feedthrough_um_per_v=tuple(feedthrough[mode].tolist()),
            )
            for mode, fit in enumerate(self.fits)
        ]

    def wrong_wires(self) -> list[str]:
        """Return a sentence for each swapped or inverted wire: sensor k lies next to the patches of amplifier k."""
        count = len(self.fits)
        unit = 1j * self.drives / np.linalg.norm(self.drives, axis=1, keepdims=True)
        together = (self.senses @ unit).real
        if np.abs(np.diag(together)).min() < OWN * np.abs(together).max():
            partner = np.abs(together).argmax(axis=0)
            return [
                f"Amplifiers {a} and {partner[a]}, or their sensors, are swapped: "
                f"amplifier {a} moves sensor {partner[a]}."
                for a in range(count)
                if partner[a] > a
            ]
        return [
            f"Amplifier {k} or sensor {k} is inverted: the sensor moves against the amplifier."
            for k in range(count)
            if together[k, k] < 0.0
        ]


def fit_wiring(sweeps: Sequence[AmplifierSweep]) -> MeasuredWiring:
    """Fit one mode per amplifier to a sweep of each.

    Raises ValueError for too few points, values that are not finite, or responses without as many resonances.
    """
    count = len(sweeps)
    for sweep in sweeps:
        if len(sweep.frequency_hz) < max(MIN_POINTS, 2 * count + 1):
            raise ValueError(f"{count} resonances need {max(MIN_POINTS, 2 * count + 1)} or more points.")
        if not np.isfinite(sweep.response_um_per_v).all():
            raise ValueError("A sweep holds values that are not finite: repeat it.")
    all_hz = np.concatenate([sweep.frequency_hz for sweep in sweeps])
    scale = max(float(np.abs(sweep.response_um_per_v).max()) for sweep in sweeps)
    centre_hz, half_hz = float(all_hz.min() + np.ptp(all_hz) / 2.0), float(np.ptp(all_hz)) / 2.0
    if not (half_hz > 0.0 and scale > 0.0):
        raise ValueError("The sweeps hold one frequency, or no vibration: repeat them with more voltage.")
    s = [np.asarray(1j * (sweep.frequency_hz - centre_hz) / half_hz, np.complex128) for sweep in sweeps]
    y = [np.asarray(sweep.response_um_per_v / scale, np.complex128) for sweep in sweeps]
    poles = _common_poles(s, y, count)
    decay_1_s = -2.0 * math.pi * half_hz * poles.real
    frequency_hz = centre_hz + half_hz * poles.imag
    if not ((decay_1_s > 0.0).all() and (frequency_hz > 0.0).all()):
        raise ValueError(
            f"The responses do not look like {count} resonances: sweep a wider band around them, or with more voltage."
        )
    residues, background = _residues(s, y, poles)
    peaks = np.abs(residues).max(axis=(1, 2)) / decay_1_s
    if peaks.min() < SEEN_FRAC * peaks.max():
        raise ValueError(f"The sweeps show fewer than {count} resonances: sweep a wider band around them.")
    order = _order(residues, frequency_hz)
    columns = [_rank_one(2.0 * math.pi * half_hz * scale * residues[p]) for p in order]
    senses = np.column_stack([seen for seen, _ in columns])
    drives = np.vstack([driven for _, driven in columns])
    sense = np.linalg.inv(senses)
    fits = []
    for mode, p in enumerate(order):
        amplifier = _first_large(drives[mode])
        strongest = complex(drives[mode, amplifier])
        fit = Resonance(
            frequency_hz=float(frequency_hz[p]),
            q_factor=float(math.pi * frequency_hz[p] / decay_1_s[p]),
            gain_um_per_v_s=abs(strongest),
            loop_phase_rad=cmath.phase(1j * strongest),
            background_um_per_v=complex(sense[mode] @ (scale * background[:, amplifier])),
            residual_frac=0.0,
        )
        measured = sweeps[amplifier].response_um_per_v @ sense[mode]
        left = np.sqrt(np.mean(np.abs(fit.response(sweeps[amplifier].frequency_hz) - measured) ** 2))
        fits.append(replace(fit, residual_frac=float(left / np.abs(measured).max())))
    return MeasuredWiring(tuple(fits), drives, senses, scale * background)


def _common_poles(s: Sequence[ComplexArray], y: Sequence[ComplexArray], count: int) -> ComplexArray:
    """Return the poles (count,) of all responses y (n, M), each a list with one entry per amplifier."""
    powers = [at[:, None] ** np.arange(count + 1) for at in s]
    responses = [(a, k) for a in range(len(s)) for k in range(y[a].shape[1])]
    weights = [np.ones(len(at)) for at in s]
    denominator = np.zeros(count + 1, np.complex128)
    for _ in range(ITERATIONS):
        rows, sides = [], []
        for place, (a, k) in enumerate(responses):
            block = np.zeros((len(s[a]), (count + 1) * len(responses) + count), np.complex128)
            block[:, place * (count + 1) : (place + 1) * (count + 1)] = powers[a]
            block[:, -count:] = -y[a][:, k, None] * powers[a][:, :count]
            rows.append(block * weights[a][:, None])
            sides.append(y[a][:, k] * powers[a][:, count] * weights[a])
        solution, *_ = np.linalg.lstsq(np.vstack(rows), np.concatenate(sides))
        denominator = np.append(solution[-count:], 1.0)
        weights = [1.0 / np.maximum(np.abs(power @ denominator), 1e-6) for power in powers]
    return np.asarray(np.roots(denominator[::-1]), np.complex128)


def _residues(
    s: Sequence[ComplexArray], y: Sequence[ComplexArray], poles: ComplexArray
) -> tuple[ComplexArray, ComplexArray]:
    """Return residues (P, sensors, amplifiers) and backgrounds (sensors, amplifiers) for known poles."""
    columns = []
    for at, responses in zip(s, y, strict=True):
        basis = np.column_stack([1.0 / (at[:, None] - poles), np.ones(len(at))])
        columns.append(np.linalg.lstsq(basis, responses)[0])  # (P + 1, sensors)
    found = np.stack(columns, axis=2)
    return found[:-1], found[-1]


def _order(residues: ComplexArray, frequency_hz: FloatArray) -> tuple[int, ...]:
    """Return the pole of each mode: the one of its own amplifier and sensor, or by frequency where they share."""
    count = len(frequency_hz)
    own = np.abs(np.einsum("pkk->kp", residues)) / np.abs(residues).max(axis=(1, 2))
    best = max(permutations(range(count)), key=lambda order: sum(own[k, p] for k, p in enumerate(order)))
    is_own = own[:, best] > OWN
    return best if (is_own == np.eye(count, dtype=bool)).all() else tuple(np.argsort(frequency_hz).tolist())


def _rank_one(residue: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return the sensors' column (M,), of length 1, and the amplifiers' row (M,) of a residue."""
    seen, size, driven = np.linalg.svd(residue)
    first = seen[:, 0]
    turn = np.exp(-1j * np.angle(first[_first_large(first)]))
    return first * turn, size[0] * driven[0] / turn


def _first_large(values: ComplexArray) -> int:
    return int(np.argmax(np.abs(values) >= HALF * np.abs(values).max()))
