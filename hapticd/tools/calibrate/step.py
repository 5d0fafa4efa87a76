"""A step of the calibration: its module here has a STEP, by which the program finds it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from ...errors import CalibrationError
from .verdict import Verdict

AddArguments = Callable[[argparse.ArgumentParser], None]


class MissingInput(CalibrationError):
    """What a step reads is not given: `all` ends before it."""


@dataclass(frozen=True, slots=True)
class Step:
    """A step. `order` sorts them; None: at any time, of a plate in use. `todo` is its line of the overview.

    `check` raises for arguments that `run` could not use. `files` are those that it writes, besides result and picture.
    `back_to` is the step from which `all` measures again once something was mended here; `is_of_bare_rig`: no plate in
    use needs it. `is_simulated` says which plate its inputs are of; None: --sim does.
    """

    name: str
    order: int | None
    summary: str
    todo: str
    example: str
    arguments: tuple[AddArguments, ...]
    check: Callable[[argparse.Namespace], None]
    run: Callable[[argparse.Namespace], Verdict]
    files: tuple[str, ...] = ()
    is_simulated: Callable[[argparse.Namespace], bool] | None = None
    back_to: str | None = None
    is_of_bare_rig: bool = False


def add_config(parser: argparse.ArgumentParser) -> None:
    """Add what several steps ask for: `all` asks for it once, as each function adds its arguments once."""
    parser.add_argument(
        "--config", type=Path, help="the service's configuration (default, of the delays: DIR/hapticd.toml)"
    )


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
