"""Verdict of a calibration step: one value for all steps, as text and as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

import msgspec

from ...design.commissioning.findings import Diagnosis

FoundSettings = Mapping[str, Mapping[str, Any]]  # of the service: section, key, value

PICTURE = {"dpi": 80, "colours": 64}  # of all steps: small enough for a mail


class Outcome(Enum):
    """Usable; usable once a person has looked at it; unusable. Sorted by severity."""

    PASS = "pass"
    WARN = "warn"
    FAIL = "fail"


@dataclass(frozen=True, slots=True)
class Figure:
    """One measured number; `unit` is "" for a pure one."""

    name: str
    value: float
    unit: str


@dataclass(frozen=True, slots=True)
class Verdict:
    """A step's name, outcome, reason, figures, and settings for the service.

    `is_simulated` keeps results of the simulated plate apart from those of a real one; `findings` are likely causes.
    """

    step: str
    outcome: Outcome
    sentence: str
    figures: tuple[Figure, ...]
    settings: FoundSettings
    is_simulated: bool
    findings: tuple[Diagnosis, ...] = ()


Finding = tuple[Outcome, str]


def judge(found: Iterable[Finding], passed: str) -> Finding:
    """Return the worst outcome with the sentences of all findings that have it; `passed` without findings."""
    findings, severity = list(found), list(Outcome)
    worst = max((outcome for outcome, _ in findings), key=severity.index, default=Outcome.PASS)
    sentences = [sentence for outcome, sentence in findings if outcome is worst]
    return worst, " ".join(sentences) or passed


def as_text(verdict: Verdict) -> str:
    """Return one line per figure, then the verdict."""
    width = max((len(figure.name) for figure in verdict.figures), default=0)
    rows = [f"  {figure.name:<{width}}  {value_of(figure)}" for figure in verdict.figures]
    return "\n".join([*rows, f"{verdict.step}: {verdict.outcome.name}: {verdict.sentence}"])


def value_of(figure: Figure) -> str:
    """Return the value with its unit: four digits, and from 1000 on hundredths, as frequencies need."""
    value = figure.value
    number = f"{value:.2f}".rstrip("0").rstrip(".") if 1e3 <= abs(value) < 1e9 else f"{value:.4g}"
    return f"{number} {figure.unit}".rstrip()


def to_json(verdict: Verdict) -> str:
    """Return JSON that `from_json` reads back; a figure that is not finite is null."""
    return msgspec.json.format(msgspec.json.encode(verdict, enc_hook=float), indent=2).decode() + "\n"


def from_json(text: str) -> Verdict:
    """Parse the text of `to_json`. Raises ValueError for any other."""
    try:
        table = json.loads(text)
        for figure in table["figures"]:
            figure["value"] = math.nan if figure["value"] is None else figure["value"]
        verdict: Verdict = msgspec.convert(table, Verdict)
    except (msgspec.ValidationError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise ValueError(f"not a verdict ({error})") from None
    return verdict
