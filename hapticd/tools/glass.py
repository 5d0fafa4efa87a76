"""`--plate`, `--copy`, `--modes` and `--wiring`: the simulated plate, the same for all commands that have one."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..config.keys import toml
from ..config.sections import WIRING_NAMES, SimConfig
from ..errors import UsageError
from .arguments import whole

# What a newcomer is shown: whole fingertips feel what was asked, which two modes cannot give them.
SHOWN = SimConfig(plate="fingertip")


def add_arguments(parser: argparse.ArgumentParser, default: SimConfig | None = None) -> None:
    plate = (default or SimConfig()).plate
    reference, fingertip = (" (default)" if plate == name else "" for name in ("reference", "fingertip"))
    group = parser.add_argument_group("the simulated plate")
    group.add_argument(
        "--plate",
        metavar="PLATE",
        help=f"reference: the paper's plate, two driven modes{reference}. fingertip: a larger one, four driven modes, "
        f"for whole fingertips{fingertip}. wide: the largest, eight driven modes, for friction that is felt as asked. "
        "F.toml: your own, as `hapticd plate --felt --glass F.toml` writes it",
    )
    group.add_argument(
        "--copy",
        type=whole(1, 10000),
        metavar="N",
        help="play copy N of the plate as it may be made, set up from its scan (`hapticd plate --felt --tolerances`)",
    )
    group.add_argument(
        "--modes", type=whole(2), metavar="N", help="number of driven modes, an amplifier each (default: the plate's)"
    )
    group.add_argument(
        "--wiring",
        choices=WIRING_NAMES,
        metavar="WIRING",
        help="of amplifiers and sensors. identity: one for each mode (default). paper: for sums and differences of "
        "two modes",
    )


def settings(sim: SimConfig) -> dict[str, dict[str, Any]]:
    """Return the configuration's section that names the simulated plate; nothing for the default one."""
    named = {name: getattr(sim, name) for name in ("plate", "modes", "wiring")}
    named = {name: value for name, value in named.items() if value != getattr(SimConfig(), name)}
    return {"sim": named} if named else {}


def lines(sim: SimConfig) -> str:
    """Return the lines of a configuration's [sim] table that name the simulated plate and its fingers."""
    names = ("plate", "modes", "wiring", "scenario", "seed")
    return "\n".join(f"{name} = {toml(getattr(sim, name))}" for name in names)


def chosen(options: argparse.Namespace, before: SimConfig | None = None, *, is_simulated: bool = True) -> SimConfig:
    """Return `before`, or the default section, with the plate that the options name; its `modes` are never 0.

    Raises UsageError for modes or a wiring that the plate does not have, and for an option without a simulated plate.
    """
    sim = SimConfig() if before is None else before
    if options.plate is None and options.copy is None and options.modes is None and options.wiring is None:
        return sim
    if not is_simulated:
        raise UsageError("--plate, --copy, --modes and --wiring name a simulated plate: give --sim as well.")
    # Late: `hapticd run` parses its arguments without the simulation.
    from ..sim.plate.glasses import COPY, SUFFIX, driven_modes, find_glass
    from ..sim.plate.wirings import wiring

    plate = sim.plate if options.plate is None else options.plate
    if plate.endswith(SUFFIX):
        plate = str(Path(plate).absolute())  # the service and the rig are processes of their own
    if options.copy is not None:
        plate = f"{plate.partition(COPY)[0]}{COPY}{options.copy}"
    try:
        find_glass(plate)
    except ValueError as error:
        raise UsageError(f"--plate: {error}") from None
    try:
        modes = driven_modes(plate, options.modes or 0)
    except ValueError as error:
        raise UsageError(f"--modes: {error}") from None
    name = sim.wiring if options.wiring is None else options.wiring
    try:
        wiring(name, modes)
    except ValueError as error:
        raise UsageError(f"--wiring: {error}") from None
    return replace(sim, plate=plate, modes=modes, wiring=name)
