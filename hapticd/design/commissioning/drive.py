"""The dead-man, the emergency stop, and the closed loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from .findings import Diagnosis, Flaw, Judgement

FOLLOWED_FRAC: Final = 0.05  # of the amplitude asked for
VOLTS_FRAC: Final = (0.7, 1.4)  # of what the calibration says
FELT_FRAC: Final = 0.05  # of the volts without a finger, as phasors: off resonance a finger's add in quadrature


@dataclass(frozen=True, slots=True)
class HeldMode:
    """A mode that was held alone: amplitude asked for, measured mean and deviation, volts and those expected."""

    asked_um: float
    mean_um: float
    deviation_um: float
    volts_v: complex
    expected_v: float


def judge_deadman(*, is_silent: bool, was_pulled: bool, is_quiet: bool) -> Judgement:
    """Judge the dead-man: `is_silent`, a voltage ended without keep-alives; `is_quiet`, so it did without a cable."""
    wrong = ""
    if not is_silent:
        wrong = "The board went on without keep-alives: do not go on, flash the firmware again."
    elif not was_pulled:
        wrong = "The cable was not pulled: the line stayed up. Pull the board's plug when asked."
    elif not is_quiet:
        wrong = "The board did not stop when the cable was pulled: do not go on, flash the firmware again."
    findings = (Diagnosis(wrong),) if wrong else ()
    return Judgement("Without its host the board went quiet by itself, and logged it.", findings)


def judge_stop(*, stopped: bool, is_logged: bool, drives_again: bool) -> Judgement:
    """Judge the pressed stop: whether the voltage ended, the log has it, and the board drives after its release."""
    findings: tuple[Diagnosis, ...] = ()
    if not (stopped and is_logged):
        bridged = (
            "The stop was pressed and the board drove on: its third pole is not in PB15's circuit. Take the bridge "
            "off, and wire PB15 through the stop's closed contact to ground."
        )
        findings = (Diagnosis(bridged, (Flaw.STOP_LINE,)),)
    elif not drives_again:
        findings = (Diagnosis("The board does not drive after the stop's release: is it released, and PB15 closed?"),)
    return Judgement("The stop ended the drive, and the board drives again after its release.", findings)


def judge_loop(held: Sequence[HeldMode], fault: str) -> Judgement:
    """Judge modes that were held one after the other; `fault` is what ended it, empty if nothing did."""
    findings = [*_faults(fault)]
    for mode, one in enumerate(held):
        off = abs(one.mean_um - one.asked_um) / one.asked_um
        share = abs(one.volts_v) / one.expected_v
        if off > FOLLOWED_FRAC:
            where = f"Mode {mode} is at {one.mean_um:.3f} um where {one.asked_um:g} um were asked for."
            findings.append(Diagnosis(where, (), (mode,)))
        elif not VOLTS_FRAC[0] <= share <= VOLTS_FRAC[1]:
            takes = (
                f"Mode {mode} takes {abs(one.volts_v):.1f} V for {one.asked_um:g} um, where its calibration says "
                f"{one.expected_v:.1f}: its sensor is cut off, or something lies on the plate."
            )
            findings.append(Diagnosis(takes, (Flaw.PREAMPLIFIER_CLIPS,), (mode,)))
    figures = [
        (f"mode {k}", f"{one.mean_um:.4f} um, {1e3 * one.deviation_um:.1f} nm about it, {abs(one.volts_v):.1f} V")
        for k, one in enumerate(held)
    ]
    return Judgement("Every mode follows its reference.", tuple(findings), tuple(figures))


def judge_touch(still_v: complex, touched_v: complex, fault: str) -> Judgement:
    """Judge a finger on the driven plate by the volts that hold its amplitude; `fault` as in `judge_loop`."""
    figures = (("volts", f"{abs(still_v):.1f} V without a finger, {abs(touched_v):.1f} V with one"),)
    unfelt = Diagnosis("The finger does not show in the volts: press more firmly, on a place where the plate moves.")
    findings = () if abs(touched_v - still_v) >= FELT_FRAC * abs(still_v) else (unfelt,)
    passed = "The finger damps the plate, and the loop holds its amplitude."
    return Judgement(passed, (*_faults(fault), *findings), figures)


def _faults(fault: str) -> tuple[Diagnosis, ...]:
    return (Diagnosis(f"The board ended the drive: {fault}."),) if fault else ()
