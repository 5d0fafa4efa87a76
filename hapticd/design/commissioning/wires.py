"""Does each amplifier move its own sensor, the right way round? Short sweeps of one amplifier at a time decide.

Rows of the responses are sensors, columns amplifiers. An open lead, a gain or a reversed lead of a sensor changes a
row, one of a drive a column. Crosstalk of a hundredth tells which of the two is dead; which wires are swapped is told
by the resonance that an answer has: swapped sensors leave each amplifier its own mode.
"""

from __future__ import annotations

import cmath
import contextlib
import math
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Final

import numpy as np

from ...values import ComplexArray, FloatArray
from ..resonance import fit_resonance
from ..wiring import AmplifierSweep
from .findings import Diagnosis, Flaw, Judgement, PlateDesign

ALIKE: Final = 0.1  # relative difference of two rows or columns that are one: noise and converters leave a hundredth
CROSSED: Final = 3.0  # times the own response
SILENT, WEAK, STRONG = 0.02, 0.25, 3.0  # of the design's response
CROSSTALK: Final = 0.003  # of the design's response: a mode that another sensor sees, far above noise
ELSEWHERE: Final = 0.5  # of the design's response: below, in all sensors, resonances may be at other frequencies
FITS: Final = 0.2  # residual of a resonance that is one
MOVED_HZ: Final = 60.0  # a mode that is farther from the design's is another plate's
RIGHT_OUTPUT: Final = (0.6, 1.6)  # measured over asked volts
DEAD_OUTPUT: Final = 0.02
HALF_TURN_RAD: Final = math.pi / 2.0


def stacked(sweeps: Sequence[AmplifierSweep]) -> ComplexArray:
    """Return the responses (sensors, amplifiers, n) of sweeps over the same frequencies."""
    return np.array([sweep.response_um_per_v.T for sweep in sweeps]).transpose(1, 0, 2)


def shares_of(responses: ComplexArray, design: PlateDesign) -> FloatArray:
    """Return the largest responses (sensors, amplifiers) over what the design expects of each amplifier's mode."""
    expected = np.array([design.peak_um_per_v(mode) for mode in range(design.modes)])
    return np.asarray(np.abs(responses).max(axis=2) / expected)


def is_elsewhere(sweeps: Sequence[AmplifierSweep], design: PlateDesign) -> bool:
    """Return whether so little answers that the resonances are to be sought in a wider band."""
    return bool(shares_of(stacked(sweeps), design).max() < ELSEWHERE)


def judge_search(sweeps: Sequence[AmplifierSweep], design: PlateDesign) -> Diagnosis | None:
    """Return the finding of resonances far from the design's in wide sweeps, None without any."""
    responses = stacked(sweeps)
    shares, frequency_hz = shares_of(responses, design), sweeps[0].frequency_hz
    if shares.max() < SILENT:
        return None
    sensor, amplifier = np.unravel_index(int(shares.argmax()), shares.shape)
    found_hz = float(frequency_hz[np.abs(responses[sensor, amplifier]).argmax()])
    moved_hz = found_hz - design.frequency_hz[int(amplifier)]
    if abs(moved_hz) <= MOVED_HZ:
        return None
    share = f"{100.0 * moved_hz / design.frequency_hz[int(amplifier)]:+.1f} %"
    return Diagnosis(
        f"The plate answers at {found_hz:.0f} Hz, {share} from the design: frequencies go with the thickness and "
        f"inversely with the square of the length: measure it ({share} of thickness are enough), and take another one, "
        "or set DRIVE_HZ and MODE_HZ for this one.",
        (Flaw.DIMENSIONS,),
    )


def judge_answers(
    sweeps: Sequence[AmplifierSweep], design: PlateDesign, outputs_v: Sequence[float | None], asked_v: float
) -> Judgement:
    """Judge whether each amplifier moves its own sensor, and no other alone.

    `outputs_v` are the amplifiers' outputs as read from an oscilloscope while `asked_v` was asked for: negative against
    the DAC's pin, None where none was read.
    """
    responses = stacked(sweeps)
    shares = shares_of(responses, design)
    figures = [
        (f"amplifier {a}", ", ".join(f"sensor {s} {100.0 * shares[s, a]:.3g} %" for s in range(len(shares))))
        for a in range(len(shares))
    ]
    findings = (
        list(_shorted(responses, shares))
        or list(_outputs(outputs_v, asked_v))
        or list(_swapped(sweeps, shares, design))
        or [finding for k in range(len(shares)) for finding in _own(sweeps[k], shares, k, design, outputs_v)]
    )
    return Judgement("Each amplifier moves its own sensor.", tuple(findings), tuple(figures))


def _shorted(responses: ComplexArray, shares: FloatArray) -> Iterator[Diagnosis]:
    for i, j in combinations(range(len(shares)), 2):
        rows = _difference(responses[i], responses[j])
        columns = _difference(responses[:, i], responses[:, j])
        if rows <= columns:
            cause, what, heard = Flaw.SENSORS_SHORTED, "Sensors {} and {} show the same", shares[[i, j]]
        else:
            cause, heard = Flaw.DRIVES_SHORTED, shares[:, [i, j]]
            what = "The patches of amplifiers {} and {} move the plate alike"
        if min(rows, columns) < ALIKE and heard.max() > SILENT:
            touching = f"{what.format(i, j)}: their leads touch; look for solder or a strand."
            yield Diagnosis(touching, (cause,), (i, j))


def _difference(one: ComplexArray, other: ComplexArray) -> float:
    size = max(float(np.linalg.norm(one)), float(np.linalg.norm(other)))
    return float(np.linalg.norm(one - other)) / size if size > 0.0 else math.inf


def _outputs(outputs_v: Sequence[float | None], asked_v: float) -> Iterator[Diagnosis]:
    for amplifier, output_v in enumerate(outputs_v):
        if output_v is None:
            continue
        share = output_v / asked_v
        read = f"Amplifier {amplifier} gives {abs(output_v):.2f} V where {asked_v:g} V were asked for"
        if abs(share) < DEAD_OUTPUT:
            yield Diagnosis(f"{read}: is it muted, or without supply?", (), (amplifier,))
        elif not RIGHT_OUTPUT[0] <= abs(share) <= RIGHT_OUTPUT[1]:
            gain = f"{read}: check R3 and R4 of its feedback, the transformer's turns, and AMPLIFIER_V_PER_V."
            yield Diagnosis(gain, (Flaw.AMPLIFIER_GAIN,), (amplifier,))
        elif share < 0.0:
            falls = f"Amplifier {amplifier} is inverted: its output goes down where the DAC goes up."
            turn = f"{falls} Turn over the transformer's secondary."
            yield Diagnosis(turn, (Flaw.AMPLIFIER_INVERTED,), (amplifier,))


def _swapped(sweeps: Sequence[AmplifierSweep], shares: FloatArray, design: PlateDesign) -> Iterator[Diagnosis]:
    for i, j in combinations(range(len(shares)), 2):
        is_crossed = shares[j, i] > CROSSED * shares[i, i] and shares[i, j] > CROSSED * shares[j, j]
        if not (is_crossed and min(shares[j, i], shares[i, j]) > SILENT):
            continue
        causes: tuple[Flaw, ...] = (Flaw.AMPLIFIERS_SWAPPED, Flaw.SENSORS_SWAPPED)
        with contextlib.suppress(ValueError):
            found_hz = [
                fit_resonance(sweeps[a].frequency_hz, sweeps[a].response_um_per_v[:, s]).frequency_hz
                for a, s in ((i, j), (j, i))
            ]
            own = (found_hz[0] - found_hz[1]) * (design.frequency_hz[i] - design.frequency_hz[j]) > 0.0
            causes = causes[1:] if own else causes[:1]
        what = " or ".join("sensors" if cause is Flaw.SENSORS_SWAPPED else "patches" for cause in causes)
        yield Diagnosis(
            f"Amplifier {i} moves sensor {j}, and amplifier {j} sensor {i}: the leads of the two {what} are swapped.",
            causes,
            (i, j),
        )


def _force(sweep: AmplifierSweep, k: int, share: float, design: PlateDesign) -> float:
    """Return the gain of a loop over the design's, which damping does not change; `share` where no resonance fits."""
    try:
        fit = fit_resonance(sweep.frequency_hz, sweep.response_um_per_v[:, k])
    except ValueError:
        return share
    return fit.gain_um_per_v_s / design.gain_um_per_v_s[k] if fit.residual_frac < FITS else share


def _own(
    sweep: AmplifierSweep, shares: FloatArray, k: int, design: PlateDesign, outputs_v: Sequence[float | None]
) -> Iterator[Diagnosis]:
    own = float(shares[k, k])
    force = _force(sweep, k, own, design)
    others = float(max((shares[j, k] for j in range(len(shares)) if j != k), default=0.0))
    shown = f"Sensor {k} shows {100.0 * own:.3g} % of what it should"
    if own < SILENT and others > CROSSTALK:
        unheard = f"{shown}, though amplifier {k} moves the plate: is its lead on its ADC pin, and on the patch?"
        yield Diagnosis(unheard, (Flaw.SENSOR_OPEN,), (k,))
    elif own < SILENT:
        unmoved = f"Amplifier {k} moves nothing: {shown[0].lower()}{shown[1:]}, and no other sensor shows anything."
        yield Diagnosis(f"{unmoved} Is patch {k} on its amplifier?", (Flaw.DRIVE_OPEN,), (k,))
    elif not WEAK <= force <= STRONG:
        is_output_right = outputs_v[k] is not None
        causes = (Flaw.SENSOR_GAIN,) if is_output_right else (Flaw.SENSOR_GAIN, Flaw.AMPLIFIER_GAIN)
        where = f"preamplifier {k} (R5, R6, C1) and SENSOR_UM_PER_V"
        other = "" if is_output_right else f", or of amplifier {k} and AMPLIFIER_V_PER_V: an oscilloscope tells which"
        shown = f"Sensor {k} shows {100.0 * force:.3g} % of the force that it should"
        yield Diagnosis(f"{shown}: check the gain of {where}{other}.", causes, (k,))


def judge_polarity(
    sweeps: Sequence[AmplifierSweep], design: PlateDesign, outputs_v: Sequence[float | None]
) -> Judgement:
    """Judge the sign of each loop; `outputs_v` as in `judge_answers`: a right output leaves only the sensor."""
    findings, figures = [], []
    for k, sweep in enumerate(sweeps):
        try:
            fit = fit_resonance(sweep.frequency_hz, sweep.response_um_per_v[:, k])
        except ValueError as error:
            findings.append(Diagnosis(f"Amplifier {k} and sensor {k}: {error}", (), (k,)))
            continue
        turned_rad = cmath.phase(cmath.rect(1.0, fit.loop_phase_rad - design.loop_phase_rad[k]))
        figures.append((f"loop {k}", f"{math.degrees(turned_rad):+.0f} degrees from the design's"))
        if abs(turned_rad) > HALF_TURN_RAD:
            is_output_right = outputs_v[k] is not None
            causes = (Flaw.SENSOR_INVERTED,) if is_output_right else (Flaw.SENSOR_INVERTED, Flaw.AMPLIFIER_INVERTED)
            who = f"Sensor {k}" if is_output_right else f"Sensor {k} or amplifier {k}"
            findings.append(
                Diagnosis(f"{who} is inverted: turn over its two leads, or look at its poling dot.", causes, (k,))
            )
    return Judgement("Each sensor moves with its amplifier.", tuple(findings), tuple(figures))
