"""What a step of the calibration came to: one value for all steps, as text and as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

Settings = Mapping[str, Mapping[str, Any]]  # of the service: section, key, value


class Outcome(Enum):
    """Good to use; to be used once a person has looked; not to be used. In this order each is worse."""

    PASS = "pass"
    LOOK = "look"
    FAIL = "fail"


@dataclass(frozen=True, slots=True)
class Figure:
    """One number that was found; `unit` is "" for a pure one."""

    name: str
    value: float
    unit: str


@dataclass(frozen=True, slots=True)
class Verdict:
    """The step's name, what became of it, why in a sentence or more, the figures, and what the service is to be told.

    `is_simulated` keeps what a simulated plate showed from being mixed with a real one's.
    """

    step: str
    outcome: Outcome
    sentence: str
    figures: tuple[Figure, ...]
    settings: Settings
    is_simulated: bool


Finding = tuple[Outcome, str]


def judge(findings: Sequence[Finding], passed: str) -> Finding:
    """The worst of the findings, with the sentences of all that are as bad; `passed` where there are none."""
    severity = list(Outcome)
    worst = max((outcome for outcome, _ in findings), key=severity.index, default=Outcome.PASS)
    sentences = [sentence for outcome, sentence in findings if outcome is worst]
    return worst, " ".join(sentences) or passed


def as_text(verdict: Verdict) -> str:
    """For a person to read: a figure a line, then the verdict."""
    width = max((len(figure.name) for figure in verdict.figures), default=0)
    rows = [f"  {figure.name:<{width}}  {_shown(figure.value)} {figure.unit}".rstrip() for figure in verdict.figures]
    return "\n".join([*rows, f"{verdict.step}: {verdict.outcome.name}: {verdict.sentence}"])


def _shown(value: float) -> str:
    """Four digits, and all of a frequency's down to hundredths."""
    return f"{value:.2f}".rstrip("0").rstrip(".") if 1e3 <= abs(value) < 1e9 else f"{value:.4g}"


def to_json(verdict: Verdict) -> str:
    """The file's text; `from_json` gives the same value. A figure that is no finite number is null there."""
    table = {
        "step": verdict.step,
        "outcome": verdict.outcome.value,
        "sentence": verdict.sentence,
        "is_simulated": verdict.is_simulated,
        "figures": [
            {"name": one.name, "value": one.value if math.isfinite(one.value) else None, "unit": one.unit}
            for one in verdict.figures
        ],
        "settings": {section: dict(keys) for section, keys in verdict.settings.items()},
    }
    return json.dumps(table, indent=2, ensure_ascii=False) + "\n"


def from_json(text: str) -> Verdict:
    """Raises ValueError for anything that `to_json` does not write."""
    try:
        table = json.loads(text)
        figures = tuple(Figure(str(one["name"]), _number(one["value"]), str(one["unit"])) for one in table["figures"])
        settings = {str(section): dict(keys) for section, keys in table["settings"].items()}
        is_simulated = table["is_simulated"]
        if not isinstance(is_simulated, bool):
            raise TypeError(is_simulated)
        outcome = Outcome(table["outcome"])
        return Verdict(str(table["step"]), outcome, str(table["sentence"]), figures, settings, is_simulated)
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise ValueError(f"it is no verdict ({error})") from None


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)
