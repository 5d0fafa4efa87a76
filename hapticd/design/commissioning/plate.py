"""The plate by its sweeps: wires as matrices, resonances against the design, and how straight the chain is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from ...values import FloatArray
from ..resonance import Resonance
from ..wiring import MeasuredWiring
from .findings import Diagnosis, Flaw, Judgement, PlateDesign

MOVED_FRAC: Final = 0.005  # of the frequencies, together: half a percent of the plate's thickness
LEAST_QUALITY: Final = 0.6  # of the design's
LEAST_GAIN: Final = 0.7  # of the design's: a bond and a sensor are within a tenth or two
STRAIGHT: Final = 0.95  # of the response to a tenth of the volts


def judge_matrices(found: MeasuredWiring) -> Judgement:
    """Judge which drive moves which sensor: a matrix with one dominant entry in each row and column."""
    moved = np.abs(found.drives) / np.abs(found.drives).max()
    seen = np.abs(found.senses) / np.abs(found.senses).max()
    rows = [[" ".join(f"{share:.2f}" for share in of) for of in both] for both in zip(moved, seen.T, strict=True)]
    figures = [(f"mode {p}", f"amplifiers {drives}, sensors {sees}") for p, (drives, sees) in enumerate(rows)]
    findings = tuple(Diagnosis(sentence) for sentence in found.wrong_wires())
    return Judgement("Each mode has an amplifier and a sensor.", findings, tuple(figures))


def judge_resonance(fits: Sequence[Resonance], design: PlateDesign) -> Judgement:
    """Judge frequency, quality and gain of each mode against the design."""
    own_hz = np.array(design.frequency_hz)
    moved = float(np.median([fit.frequency_hz for fit in fits] / own_hz)) - 1.0
    quality = np.array([fit.q_factor for fit in fits]) * design.decay_1_s / (np.pi * own_hz)
    gain = np.array([fit.gain_um_per_v_s for fit in fits]) / design.gain_um_per_v_s
    findings = []
    if abs(moved) > MOVED_FRAC:
        where = f"All resonances are {100.0 * moved:+.1f} % from the design: measure the plate's thickness and edges."
        findings.append(Diagnosis(where, (Flaw.DIMENSIONS,)))
    damped = [k for k in range(len(fits)) if quality[k] < LEAST_QUALITY]
    for k in sorted(damped, key=lambda mode: float(gain[mode]))[:1]:
        soft = (
            f"Modes {', '.join(map(str, damped))} are damped: Q {fits[k].q_factor:.0f} is {100.0 * quality[k]:.0f} % "
            f"of the design's, patch {k} has {100.0 * gain[k]:.0f} % of its force. If nothing lies on it, it is soft "
            f"or thick glue, or a rim of it, at patch {k}: glue it again."
        )
        findings.append(Diagnosis(soft, (Flaw.GLUE,), (k,)))
    for k in range(len(fits)):
        if k not in damped and gain[k] < LEAST_GAIN:
            cracked = (
                f"Mode {k} has {100.0 * gain[k]:.0f} % of its force at its usual quality: patch {k} is cracked. "
                "Measure its capacitance: a cracked one has lost as much, a half bonded one has not."
            )
            findings.append(Diagnosis(cracked, (Flaw.PATCH_CRACKED,), (k,)))
    figures = [
        (f"mode {k}", f"{fit.frequency_hz:.1f} Hz, Q {fit.q_factor:.0f} ({100.0 * q:.0f} %), gain {100.0 * g:.0f} %")
        for k, (fit, q, g) in enumerate(zip(fits, quality, gain, strict=True))
    ]
    return Judgement("Frequencies, qualities and gains are the design's.", tuple(findings), tuple(figures))


def judge_limits(straight: FloatArray, most_um: FloatArray) -> Judgement:
    """Judge the chain at the largest voltage open loop.

    `straight` (sensors, amplifiers) is the response per volt over that at a tenth of the volts, NaN where a sensor sees
    too little of an amplifier; `most_um` (M,) the amplitude of each mode at that voltage.
    """
    findings = []
    for k in range(len(most_um)):
        own, others = straight[k, k], np.delete(straight[:, k], k)
        if not own < STRAIGHT:
            continue
        if (others < STRAIGHT).any():
            weak = f"Amplifier {k} gives less at more volts: check its supply and its current limit."
            findings.append(Diagnosis(weak, (Flaw.SUPPLY_LOW,)))
        else:
            cut = (
                f"Sensor {k} is cut off: at {most_um[k]:.2f} um it shows {100.0 * own:.0f} % of what it should. Its "
                "preamplifier clips: check its supply, its middle and R5."
            )
            findings.append(Diagnosis(cut, (Flaw.PREAMPLIFIER_CLIPS,), (k,)))
    line = "{:.2f} um at a fifth of the voltage, {:.1f} % of a straight line"
    figures = [(f"mode {k}", line.format(um, 100.0 * straight[k, k])) for k, um in enumerate(most_um.tolist())]
    passed = "Amplifiers and sensors are straight up to the largest open-loop voltage."
    return Judgement(passed, tuple(findings), tuple(figures))
