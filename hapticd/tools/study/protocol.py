"""Design of the study and order of its trials: the paper's evaluation (section IV.C) as plain values.

A trial presents one of the paper's two combinations, and the participant answers whether the glass had high or low
friction. Combination 1: the participant's finger slips and the virtual one sticks; combination 2: the other way round.
(The paper's sentence calls both fingers of combination 1 "low friction"; its W1 = 1 um and W2 = 0 show the intention.)
"""

from __future__ import annotations

import hashlib
import math
import re
from dataclasses import dataclass
from enum import StrEnum

from ...errors import UsageError

MAX_TRIALS = 1000
MAX_AMPLITUDE_UM = 20.0
_Point = tuple[float, float]


class StudyError(UsageError):
    """A session cannot be started or continued, or a study not analysed, as requested."""


class FrictionLevel(StrEnum):
    """Stimulus of the participant's finger in a trial, and the participant's answer."""

    LOW = "low"
    HIGH = "high"

    @property
    def combination(self) -> int:
        """Number of the combination in the paper."""
        return 1 if self is FrictionLevel.LOW else 2


@dataclass(frozen=True, slots=True)
class Design:
    """Parameters of all trials of a session. Raises StudyError for invalid ones.

    The number of trials and `slippery_um` (W1; W2 is 0) are the paper's. It gives neither position nor speed of the
    virtual finger's straight line: `line_mm` crosses the plate off its middle, at the `line_speed_mm_s` of a slow hand.
    """

    trials: int = 20
    slippery_um: float = 1.0
    line_mm: tuple[_Point, _Point] = ((-40.0, 25.0), (40.0, -15.0))
    line_speed_mm_s: float = 40.0

    def __post_init__(self) -> None:
        if not 1 <= self.trials <= MAX_TRIALS:
            raise StudyError(f"trials: {self.trials} is out of bounds, give 1 .. {MAX_TRIALS}.")
        if not 0 < self.slippery_um <= MAX_AMPLITUDE_UM:
            raise StudyError(f"slippery_um: {self.slippery_um:g} is out of bounds, give 0 .. {MAX_AMPLITUDE_UM:g}.")
        if not all(math.isfinite(value) for point in self.line_mm for value in point):
            raise StudyError("line_mm: the ends of the virtual finger's line must be finite numbers.")
        if not 0 < self.line_speed_mm_s < math.inf:
            raise StudyError(f"line_speed_mm_s: {self.line_speed_mm_s:g} must be finite and above 0.")

    def amplitudes_um(self, friction: FrictionLevel) -> tuple[float, float]:
        """Return the targets of the participant's finger and of the virtual one."""
        return (self.slippery_um, 0.0) if friction is FrictionLevel.LOW else (0.0, self.slippery_um)


def presented(seed: int, trials: int) -> tuple[FrictionLevel, ...]:
    """Return the stimuli of a session in order: half of either (an odd one is drawn), shuffled by the seed.

    SHA-256 digests determine the order, so that a session continues unchanged under any version of Python.
    """
    halves = [FrictionLevel.LOW, FrictionLevel.HIGH] * (trials // 2)
    odd = [FrictionLevel.LOW if _digest(seed, 0)[0] % 2 else FrictionLevel.HIGH] * (trials % 2)
    keys = {trial: _digest(seed, trial + 1) for trial in range(trials)}
    pool = halves + odd
    return tuple(pool[trial] for trial in sorted(keys, key=keys.__getitem__))


def participant_name(name: str) -> str:
    """Check a participant's name, which also names the file. Raises StudyError."""
    if re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}", name):
        return name
    raise StudyError(f"participant: {name!r} must be 1 .. 32 letters, digits, - or _, such as P03.")


def _digest(seed: int, number: int) -> bytes:
    return hashlib.sha256(f"{seed}:{number}".encode()).digest()
