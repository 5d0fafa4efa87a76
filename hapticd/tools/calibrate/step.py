"""A step of the calibration, and its verdict: its module here has a STEP, by which the program finds it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from datetime import date
from enum import Enum
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

from ...config import person
from ...design.commissioning.findings import Diagnosis
from ...errors import CalibrationError

AddArguments = Callable[[argparse.ArgumentParser], None]
FoundSettings = Mapping[str, Mapping[str, Any]]  # of the service: section, key, value

PICTURE = {"dpi": 80, "colours": 64}  # of all steps: small enough for a mail


class MissingInput(CalibrationError):
    """An input of a step is not given: `all` ends before it."""


class Outcome(Enum):
    """Usable; usable once a person has looked at it; unusable. Sorted by severity."""

    PASS = "pass"
    WARN = "warn"
    FAIL = "fail"


Finding = tuple[Outcome, str]


@dataclass(frozen=True, slots=True)
class Figure:
    """One measured number; `unit` is "" for a pure one, `value` None, in a file, for one that is not finite."""

    name: str
    value: float | None
    unit: str

    def __str__(self) -> str:
        """The value with its unit: four digits, and from 1000 on hundredths, as frequencies need."""
        value = float("nan") if self.value is None else self.value
        number = f"{value:.2f}".rstrip("0").rstrip(".") if 1e3 <= abs(value) < 1e9 else f"{value:.4g}"
        return f"{number} {self.unit}".rstrip()


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

    def __str__(self) -> str:
        """One line per figure, then the verdict."""
        width = max((len(figure.name) for figure in self.figures), default=0)
        rows = [f"  {figure.name:<{width}}  {figure}" for figure in self.figures]
        return "\n".join([*rows, f"{self.step}: {self.outcome.name}: {self.sentence}"])


def judge(found: Iterable[Finding], passed: str) -> Finding:
    """Return the worst outcome with the sentences of all findings that have it; `passed` without findings."""
    findings, severity = list(found), list(Outcome)
    worst = max((outcome for outcome, _ in findings), key=severity.index, default=Outcome.PASS)
    sentences = [sentence for outcome, sentence in findings if outcome is worst]
    return worst, " ".join(sentences) or passed


@dataclass(frozen=True, slots=True)
class Step:
    """A step. `order` sorts them; None: at any time, of a plate in use.

    `check` raises for arguments that `run` could not use. `files` are those that it writes, besides result and picture.
    `back_to` is the step from which `all` measures again once something was mended here; `is_of_bare_rig`: no plate in
    use needs it. `is_simulated` says which plate its inputs are of; None: --sim does.
    """

    name: str
    order: int | None
    summary: str
    example: str
    arguments: tuple[AddArguments, ...]
    check: Callable[[argparse.Namespace], None]
    run: Callable[[argparse.Namespace], Verdict]
    files: tuple[str, ...] = ()
    is_simulated: Callable[[argparse.Namespace], bool] | None = None
    back_to: str | None = None
    is_of_bare_rig: bool = False


def add_config(parser: argparse.ArgumentParser) -> None:
    """Add what several steps ask for: `all` adds the arguments of each function once."""
    parser.add_argument(
        "--config", type=Path, help="the service's configuration (default, of the delays: DIR/hapticd.toml)"
    )


def add_participant(parser: argparse.ArgumentParser) -> None:
    """Add whose finger is measured, if it is a participant's."""
    parser.add_argument("--participant", metavar="NAME", help="of whose finger: results go to DIR/participants/NAME")
    parser.add_argument("--finger", default="right index", metavar="FINGER", help="hand and finger (right index)")


def about(options: argparse.Namespace) -> FoundSettings:
    """Return the section that says whose a friction curve is; nothing for a plate's."""
    if getattr(options, "participant", None) is None:
        return {}
    today = date.today().isoformat()
    return {person.SECTION: {"name": options.participant, "date": today, "finger": options.finger}}


@cache
def steps() -> dict[str, Step]:
    """Return all steps by their names, in their order."""
    package = __package__ or ""
    modules = [import_module(f"{package}.{one.name}") for one in iter_modules(sys.modules[package].__path__)]
    found = [module.STEP for module in modules if isinstance(getattr(module, "STEP", None), Step)]
    return {step.name: step for step in sorted(found, key=lambda step: (step.order is None, step.order, step.name))}


def in_order() -> list[str]:
    """Return the names of the steps that a new plate takes."""
    return [name for name, step in steps().items() if step.order is not None]
