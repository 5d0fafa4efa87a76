"""`--plate` and `--modes`: the simulated plate, the same for all commands that have one."""

from __future__ import annotations

import argparse
from dataclasses import replace

from ..config.sections import PLATE_NAMES, SimConfig
from ..errors import UsageError
from .arguments import whole


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the plate's name and the number of its driven modes."""
    parser.add_argument(
        "--plate", choices=PLATE_NAMES, help="the simulated one: the paper's (default), or one for whole contacts"
    )
    parser.add_argument("--modes", type=whole(2), metavar="N", help="with an amplifier each (default: the plate's)")


def chosen(options: argparse.Namespace, before: SimConfig | None = None, *, is_simulated: bool = True) -> SimConfig:
    """Return `before`, or the default section, with the plate that the options name; its `modes` are never 0.

    Raises UsageError for modes that the plate does not have, and for either option without a simulated plate.
    """
    sim = SimConfig() if before is None else before
    if options.plate is None and options.modes is None:
        return sim
    if not is_simulated:
        raise UsageError("--plate and --modes name a simulated plate: give --sim as well.")
    from ..sim.plate.glasses import driven_modes  # late: `hapticd run` parses its arguments without the simulation

    plate = sim.plate if options.plate is None else options.plate
    try:
        return replace(sim, plate=plate, modes=driven_modes(plate, options.modes or 0))
    except ValueError as error:
        raise UsageError(f"--modes: {error}") from None
