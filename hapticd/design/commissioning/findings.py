"""Vocabulary of the commissioning: causes, findings and the judgement of a step, and what the design expects."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from enum import Enum

from ...board_values import BoardController, BoardHello


class Flaw(Enum):
    """A mistake that a technician can mend."""

    SUPPLY_LOW = "supply low"
    SENSOR_OFFSET = "sensor offset"
    STOP_LINE = "stop line not wired"
    FAULT_LINE = "fault line inverted"
    MAINS_HUM = "mains hum"
    SENSOR_NOISY = "noisy sensor"
    SENSOR_FLOATING = "floating sensor"
    SENSOR_OPEN = "open sensor"
    SENSORS_SHORTED = "sensor shorted to neighbour"
    SENSORS_SWAPPED = "swapped sensors"
    SENSOR_INVERTED = "inverted sensor"
    SENSOR_GAIN = "wrong sensor gain"
    PREAMPLIFIER_CLIPS = "preamplifier clipping"
    DRIVE_OPEN = "drive open"
    DRIVES_SHORTED = "drive shorted to neighbour"
    AMPLIFIERS_SWAPPED = "swapped amplifiers"
    AMPLIFIER_INVERTED = "inverted amplifier"
    AMPLIFIER_GAIN = "wrong amplifier gain"
    GLUE = "wrong glue"
    PATCH_CRACKED = "cracked patch"
    DIMENSIONS = "plate with other dimensions"


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """A fault: the likely causes, which what was measured does not tell apart, and the wires (modes) concerned.

    `sentence` says what was seen and what to do. Without a cause nothing but the sentence is known.
    """

    sentence: str
    causes: tuple[Flaw, ...] = ()
    wires: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Judgement:
    """Verdict of a step: passed without findings. `figures` are names and values with units, to be read."""

    passed: str
    findings: tuple[Diagnosis, ...] = ()
    figures: tuple[tuple[str, str], ...] = ()

    @property
    def is_passed(self) -> bool:
        return not self.findings

    def and_then(self, other: Judgement) -> Judgement:
        """Return both as one."""
        findings, figures = (*self.findings, *other.findings), (*self.figures, *other.figures)
        return Judgement(f"{self.passed} {other.passed}", findings, figures)

    @property
    def sentence(self) -> str:
        return " ".join(finding.sentence for finding in self.findings) or self.passed


@dataclass(frozen=True, slots=True)
class PlateDesign:
    """The plate that the board expects: M modes, each with an amplifier and a sensor of its own."""

    frequency_hz: tuple[float, ...]
    decay_1_s: tuple[float, ...]
    gain_um_per_v_s: tuple[float, ...]
    loop_phase_rad: tuple[float, ...]
    drive_hz: float
    control_hz: float
    v_limit_v: float

    @classmethod
    def of(cls, hello: BoardHello, controller: BoardController) -> PlateDesign:
        """Return the design as the board's firmware has it."""
        models = controller.models
        return cls(
            tuple(hello.drive_hz + model.detuning_rad_s / (2.0 * math.pi) for model in models),
            tuple(model.decay_1_s for model in models),
            tuple(model.gain_um_per_v_s for model in models),
            tuple(cmath.phase(model.loop) for model in models),
            hello.drive_hz,
            hello.control_hz,
            hello.v_limit_v,
        )

    @property
    def modes(self) -> int:
        return len(self.frequency_hz)

    def peak_um_per_v(self, mode: int) -> float:
        """Return what a volt of the mode's amplifier moves at resonance."""
        return self.gain_um_per_v_s[mode] / self.decay_1_s[mode]
