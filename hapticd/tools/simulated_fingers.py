"""`--scenario` and `--fingers`: the fingers of a simulated plate that is touched in real time."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from ..config.sections import SCENARIO_NAMES, SimConfig
from ..errors import UsageError


def add_arguments(parser: argparse.ArgumentParser, default: str) -> None:
    """Add both; `default` says what touches the plate without them."""
    parser.add_argument("--scenario", metavar="NAME", help=f"of its fingers until you touch it (default {default})")
    parser.add_argument(
        "--fingers",
        type=Path,
        metavar="FILE",
        help="fingers of a CSV or a recording (.mcap) in place of a scenario, again and again (hapticd/sim/README.md)",
    )


def chosen(options: argparse.Namespace, before: SimConfig, *, is_simulated: bool = True) -> SimConfig:
    """Return `before` with the fingers that the options name.

    Raises UsageError for a scenario that there is not, a file that cannot be played, and either without a plate.
    """
    if options.scenario is None and options.fingers is None:
        return before
    if not is_simulated:
        raise UsageError("--scenario and --fingers need a simulated plate: give --sim as well.")
    if options.fingers is not None:
        if options.scenario is not None:
            raise UsageError("--fingers plays its own fingers in place of a --scenario: give one of them.")
        # Late: `hapticd run` parses its arguments without the simulation.
        from ..sim.fingers import trajectories
        from ..sim.plate.glasses import find_glass

        trajectories.read_repeated(options.fingers, find_glass(before.plate).size_mm)
        return replace(before, fingers_file=str(options.fingers.absolute()))
    if options.scenario not in SCENARIO_NAMES:
        raise UsageError(f"--scenario: there is no {options.scenario!r}: choose one of {', '.join(SCENARIO_NAMES)}.")
    return replace(before, scenario=options.scenario, fingers_file="")
