"""`--scenario`: the fingers of a simulated plate that is touched in real time."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from ..config.sections import SCENARIO_NAMES, SimConfig
from ..errors import UsageError


def add_arguments(parser: argparse.ArgumentParser, default: str) -> None:
    """Add the option; `default` says what touches the plate without it."""
    parser.add_argument(
        "--scenario",
        metavar="NAME",
        help=f"of its fingers until you touch it (default {default}), or a CSV or recording (.mcap) of fingers, again "
        "and again (hapticd/sim/README.md)",
    )


def chosen(options: argparse.Namespace, before: SimConfig, *, is_simulated: bool = True) -> SimConfig:
    """Return `before` with the fingers that the option names.

    Raises UsageError for a scenario that there is not, a file that cannot be played, and one without a plate.
    """
    name = options.scenario
    if name is None:
        return before
    if not is_simulated:
        raise UsageError("--scenario needs a simulated plate: give --sim as well.")
    if name in SCENARIO_NAMES:
        return replace(before, scenario=name)
    if not Path(name).suffix:
        raise UsageError(f"--scenario: there is no {name!r}: choose one of {', '.join(SCENARIO_NAMES)}, or a file.")
    # Late: `hapticd run` parses its arguments without the simulation.
    from ..sim.fingers import trajectories
    from ..sim.plate.glasses import find_glass

    trajectories.read_repeated(Path(name), find_glass(before.plate).size_mm)
    return replace(before, scenario=str(Path(name).absolute()))
