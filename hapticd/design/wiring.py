"""Fit of all modes and wires to sweeps of one amplifier at a time, in which all sensors were recorded.

The responses y (sensors) to one amplifier follow s y = K y + n0 + n1 s, where K (sensors, sensors) is the same for
all amplifiers: its eigenvalues are the plate's poles, its eigenvectors what the sensors see of each mode. Each row of K
is a weighted linear fit (Sanathanan and Koerner, 1963). Sensors thus tell modes apart that lie far closer than their
width, such as two of eight modes 1 Hz from each other, of which one denominator for all responses shows one. What the
amplifiers do to each mode, and the feedthrough, electrical and of modes far away, is then linear. Parasitic modes
outside the sweep are subtracted first (`parasitic_fit`), so that feedthrough is only what is constant.

A mode's amplitude is the root of the sum of squares over all sensors, positive in the first that sees half of it.
"""

from __future__ import annotations

import cmath
import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from ..board_values import ModeCalibration, SweepPoint
from ..values import ComplexArray, FloatArray
from .parasitic_fit import NO_PARASITIC, ParasiticPoles, better_parasitic, find_parasitic
from .readings import in_phase
from .resonance import ITERATIONS, MIN_POINTS, Resonance

HALF = 0.5  # of the largest: the first such wire gives a mode its sign
MOVED_FRAC = 0.003  # of what a volt does to the modes: a pole with less is a rest of a driven mode
SEEN_FRAC = 0.05  # of the strongest residue: a pole with less is no mode of this plate
NOT_ALIKE = "The responses do not look like {} resonances: sweep a wider band around them, or with more voltage."
OWN = 0.5  # of the largest product of a mode's sensor and amplifier: they then belong together, if no other does


@dataclass(frozen=True, slots=True)
class AmplifierSweep:
    """Responses y / V (n, M) of all sensors to one amplifier at frequencies (n,)."""

    amplifier: int
    frequency_hz: FloatArray
    response_um_per_v: ComplexArray

    @classmethod
    def of(cls, amplifier: int, points: Sequence[SweepPoint]) -> AmplifierSweep:
        """The responses per volt that a sweep's points hold."""
        response_um_per_v = np.array([point.measured_um for point in points]) / np.array(
            [[point.voltage_v] for point in points]
        )
        return cls(amplifier, np.array([point.frequency_hz for point in points]), response_um_per_v)


@dataclass(frozen=True, slots=True)
class MeasuredWiring:
    """The modes with their wires, in the board's order, and their fits.

    `drives` (M, M) complex, modes by amplifiers, is what a volt does to a mode, um/(V s); `senses` (M, M) sensors by
    modes. `background_um_per_v` (M, M) sensors by amplifiers, `residual_frac` the RMS of each mode's residual over its
    largest response. `parasitic` are modes that no amplifier is for, in s: at rad/s from `centre_hz`, um/(V s).
    """

    fits: tuple[Resonance, ...]
    drives: ComplexArray
    senses: ComplexArray
    background_um_per_v: ComplexArray
    parasitic: ParasiticPoles = NO_PARASITIC
    centre_hz: float = 0.0

    def strongest(self, mode: int) -> int:
        """Return the amplifier that drives the mode most, the first of equal ones."""
        return _first_large(self.drives[mode])

    def driven_poles(self, from_hz: float) -> ComplexArray:
        """Return the modes' poles (M,), -decay + i detuning in rad/s from a frequency."""
        frequency_hz = np.array([fit.frequency_hz for fit in self.fits])
        width_hz = frequency_hz / np.array([fit.q_factor for fit in self.fits])
        return np.asarray(math.pi * (-width_hz + 2j * (frequency_hz - from_hz)), np.complex128)

    def modal(self, mode: int, sweep: AmplifierSweep) -> ComplexArray:
        """Return the mode's amplitude per volt (n,) in a sweep, without the parasitic modes."""
        s = np.asarray(2j * math.pi * (sweep.frequency_hz - self.centre_hz), np.complex128)
        driven_um_per_v = sweep.response_um_per_v - self.parasitic.response(s, sweep.amplifier)
        return np.asarray(driven_um_per_v @ np.linalg.inv(self.senses)[mode])

    def parasitic_hz(self) -> list[float]:
        """Return the frequencies of the parasitic modes, rising."""
        return sorted((self.centre_hz + self.parasitic.poles.imag / (2.0 * math.pi)).tolist())

    def swept(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return frequency and quality (K,) of the driven modes, then of the parasitic ones, and what a volt of each
        amplifier does to them (K, M), um/(V s), with the sign of their sensors."""
        rows, poles = [*self.drives], self.driven_poles(self.centre_hz).tolist()
        for pole, residue in zip(self.parasitic.poles, self.parasitic.residues, strict=True):
            seen, sizes, driven = np.linalg.svd(residue)
            if sizes[0] > MOVED_FRAC * np.abs(self.drives).max():
                rows.append(_of_length_1(seen[:, 0], sizes[0] * driven[0])[1])
                poles.append(pole)
        poles = np.array(poles)
        frequency_hz = self.centre_hz + poles.imag / (2.0 * math.pi)
        return frequency_hz, -math.pi * frequency_hz / poles.real, in_phase(1j * np.array(rows).T).values.T

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
        """Return a sentence for each swapped or inverted wire: sensor k lies next to the patches of amplifier k.

        An amplifier that moves several sensors alike, as the paper's do with sensors of their own, has no own one:
        there signs are the wiring's, and nothing is said.
        """
        count = len(self.fits)
        unit = 1j * self.drives / np.linalg.norm(self.drives, axis=1, keepdims=True)
        together = (self.senses @ unit).real
        sizes = np.abs(together)
        partner, largest = sizes.argmax(axis=0), sizes.max(axis=0)
        has_own = np.sum(sizes > OWN * largest, axis=0) == 1
        if np.diag(sizes).min() < OWN * sizes.max():
            return [
                f"Amplifiers {a} and {partner[a]}, or their sensors, are swapped: "
                f"amplifier {a} moves sensor {partner[a]}."
                for a in range(count)
                if partner[a] > a and has_own[a]
            ]
        return [
            f"Amplifier {k} or sensor {k} is inverted: the sensor moves against the amplifier."
            for k in range(count)
            if together[k, k] < 0.0 and has_own[k]
        ]


@dataclass(frozen=True, slots=True)
class _Scaled:
    """Sweeps in units of order 1: s = i (f - centre_hz) / half_hz and y = response / scale, an entry per amplifier."""

    sweeps: Sequence[AmplifierSweep]
    s: list[ComplexArray]
    y: list[ComplexArray]
    centre_hz: float
    half_hz: float
    scale: float


def fit_wiring(sweeps: Sequence[AmplifierSweep]) -> MeasuredWiring:
    """Fit one mode per amplifier to a sweep of each.

    Raises ValueError for too few points, values that are not finite, or responses without as many resonances.
    """
    scaled = _scaled(sweeps)
    try:
        poles, _ = _poles_and_senses(scaled.s, scaled.y)
        outside = find_parasitic(scaled.s, scaled.y, poles)
    except np.linalg.LinAlgError:
        raise ValueError(NOT_ALIKE.format(len(sweeps))) from None
    return _fitted(scaled, outside)


def as_likely(sweeps: Sequence[AmplifierSweep], found: MeasuredWiring) -> list[MeasuredWiring]:
    """Return fits of the same sweeps, with parasitic modes at assumed frequencies, that predict held-out points better
    than `found` does: none where a constant explains all but noise."""
    scaled = _scaled(sweeps)
    turn_rad_s = 2.0 * math.pi * scaled.half_hz
    driven = found.driven_poles(scaled.centre_hz) / turn_rad_s
    others = []
    for outside in better_parasitic(scaled.s, scaled.y, driven, np.asarray(found.parasitic.poles / turn_rad_s)):
        with contextlib.suppress(ValueError):
            others.append(_fitted(scaled, outside))
    return others


def _scaled(sweeps: Sequence[AmplifierSweep]) -> _Scaled:
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
    return _Scaled(sweeps, s, y, centre_hz, half_hz, scale)


def _fitted(scaled: _Scaled, outside: ParasiticPoles) -> MeasuredWiring:
    """Fit what these parasitic modes leave. Raises ValueError for responses without as many resonances."""
    sweeps, s, y, scale, count = scaled.sweeps, scaled.s, scaled.y, scaled.scale, len(scaled.s)
    centre_hz, half_hz = scaled.centre_hz, scaled.half_hz
    y = [responses - outside.response(at, k) for k, (at, responses) in enumerate(zip(s, y, strict=True))]
    try:
        poles, senses = _poles_and_senses(s, y)
        residues, background = _drives(s, y, poles, senses)
    except np.linalg.LinAlgError:
        raise ValueError(NOT_ALIKE.format(count)) from None
    decay_1_s = -2.0 * math.pi * half_hz * poles.real
    frequency_hz = centre_hz + half_hz * poles.imag
    if not ((decay_1_s > 0.0).all() and (frequency_hz > 0.0).all()):
        raise ValueError(NOT_ALIKE.format(count))
    products = np.einsum("sp,pa->psa", senses, residues)
    peaks = np.abs(products).max(axis=(1, 2)) / decay_1_s
    if peaks.min() < SEEN_FRAC * peaks.max():
        raise ValueError(f"The sweeps show fewer than {count} resonances: sweep a wider band around them.")
    order = _order(products, frequency_hz)
    columns = [_of_length_1(senses[:, p], 2.0 * math.pi * half_hz * scale * residues[p]) for p in order]
    senses = np.column_stack([seen for seen, _ in columns])
    drives = np.vstack([driven for _, driven in columns])
    sense = np.linalg.inv(senses)
    fits = []
    for mode, p in enumerate(order):
        amplifier = _first_large(drives[mode])
        strongest = complex(drives[mode, amplifier])
        fits.append(
            Resonance(
                frequency_hz=float(frequency_hz[p]),
                q_factor=float(math.pi * frequency_hz[p] / decay_1_s[p]),
                gain_um_per_v_s=abs(strongest),
                loop_phase_rad=cmath.phase(1j * strongest),
                background_um_per_v=complex(sense[mode] @ (scale * background[:, amplifier])),
                residual_frac=0.0,
            )
        )
    parasitic = outside.scaled(2.0 * math.pi * half_hz, scale)
    found = MeasuredWiring(tuple(fits), drives, senses, scale * background, parasitic, centre_hz)
    for mode, fit in enumerate(fits):
        sweep = sweeps[found.strongest(mode)]
        measured = found.modal(mode, sweep)
        left = np.sqrt(np.mean(np.abs(fit.response(sweep.frequency_hz) - measured) ** 2))
        fits[mode] = replace(fit, residual_frac=float(left / np.abs(measured).max()))
    return replace(found, fits=tuple(fits))


def _poles_and_senses(s: Sequence[ComplexArray], y: Sequence[ComplexArray]) -> tuple[ComplexArray, ComplexArray]:
    """Return the poles (P,), and what the sensors see of each mode (sensors, P), of responses y (n, sensors), each a
    list with one entry per amplifier.
    """
    count = len(s)
    numerators = [np.column_stack([np.ones(len(at)), at]) for at in s]
    between = np.zeros((count, count), np.complex128)
    for step in range(ITERATIONS):
        rows = []
        for sensor, row in enumerate(between):
            lefts, sides = [], []
            for at, responses, numerator in zip(s, y, numerators, strict=True):
                misses = np.sqrt(np.abs(at - row[sensor]) ** 2 + np.sum(np.abs(np.delete(row, sensor)) ** 2))
                weight = 1.0 / np.maximum(misses, 1e-6) if step else np.ones(len(at))
                own = np.linalg.qr(numerator * weight[:, None])[0]
                block = np.column_stack([responses, at * responses[:, sensor]]) * weight[:, None]
                left = block - own @ (own.conj().T @ block)
                lefts.append(left[:, :-1])
                sides.append(left[:, -1])
            rows.append(np.linalg.lstsq(np.vstack(lefts), np.concatenate(sides))[0])
        between = np.array(rows)
    poles, senses = np.linalg.eig(between)
    return poles, senses


def _drives(
    s: Sequence[ComplexArray], y: Sequence[ComplexArray], poles: ComplexArray, senses: ComplexArray
) -> tuple[ComplexArray, ComplexArray]:
    """Return residues (P, amplifiers) of the modes that the sensors see so, and backgrounds (sensors, amplifiers)."""
    seen = np.linalg.inv(senses).T
    residues, background = [], []
    for at, responses in zip(s, y, strict=True):
        modal = responses @ seen
        found = [
            np.linalg.lstsq(np.column_stack([1.0 / (at - pole), np.ones(len(at))]), modal[:, p])[0]
            for p, pole in enumerate(poles)
        ]
        residue, constant = np.array(found).T
        residues.append(residue)
        background.append(senses @ constant)
    return np.array(residues).T, np.array(background).T


def _order(residues: ComplexArray, frequency_hz: FloatArray) -> tuple[int, ...]:
    """Return the pole of each mode: the one of its own amplifier and sensor, or by frequency where they share."""
    count = len(frequency_hz)
    own = np.abs(np.einsum("pkk->kp", residues)) / np.abs(residues).max(axis=(1, 2))
    best = max(permutations(range(count)), key=lambda order: sum(own[k, p] for k, p in enumerate(order)))
    is_own = own[:, best] > OWN
    return best if (is_own == np.eye(count, dtype=bool)).all() else tuple(np.argsort(frequency_hz).tolist())


def _of_length_1(seen: ComplexArray, driven: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return a mode's sensors, of length 1 and positive in the first that sees half of it, and its amplifiers."""
    turned = np.linalg.norm(seen) * np.exp(1j * np.angle(seen[_first_large(seen)]))
    return seen / turned, driven * turned


def _first_large(values: ComplexArray) -> int:
    return int(np.argmax(np.abs(values) >= HALF * np.abs(values).max()))
