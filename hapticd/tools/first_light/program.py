"""`hapticd first-light`: guided commissioning of a rig, one page for each step; or of simulated rigs with mistakes."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import UsageError
from .. import glass, pads
from ..arguments import whole
from ..outputs import has_mark

if TYPE_CHECKING:
    from collections.abc import Callable

    from .bench import Bench
    from .commission import NewBench
    from .front import Front
    from .state import Commissioning

    LoopFactory = Callable[[], asyncio.AbstractEventLoop]

DEFAULT_OUT = Path("first-light")
MOST_RIGS, MOST_MISTAKES = 10_000, 6


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        f"{parser.description} Each page says what to do; its verdict names the likely cause. A failed step is run "
        "again once it is mended; stopped with q or Ctrl-C, the command goes on there with the same --out."
    )
    parser.epilog = f"{parser.epilog}\n         hapticd first-light --port /dev/ttyACM0 --out bench"
    parser.add_argument("--out", type=Path, default=DEFAULT_OUT, metavar="DIR", help="results (default first-light)")
    parser.add_argument("--again", action="store_true", help="begin with the first step again")
    parser.add_argument("--force", action="store_true", help="overwrite files in DIR that no step wrote")
    board = parser.add_argument_group("the board")
    board.add_argument("--port", help="serial port, such as /dev/ttyACM0")
    board.add_argument("--baud", type=int, help="serial speed (default 921600)")
    board.add_argument("--config", type=Path, help="the service's configuration, which names port and speed")
    scan = parser.add_argument_group("the map of modes")
    scan.add_argument(
        "--scan",
        type=Path,
        metavar="F",
        help="a vibrometer's scan (CSV, NPZ, UFF) for `hapticd calibrate modes`",
    )
    scan.add_argument("--size", metavar="WxD", help="of the plate in mm (default 137.5x137.5)")
    pads.add_choice(parser)
    simulated = parser.add_argument_group("simulated rigs")
    simulated.add_argument(
        "--sim", action="store_true", help="a simulated rig with random mistakes, and its technician"
    )
    simulated.add_argument("--seed", type=whole(0), default=1, help="of the mistakes and of what is sound (default 1)")
    simulated.add_argument(
        "--mistakes", type=whole(0, MOST_MISTAKES), default=3, metavar="N", help="on the rig (default 3)"
    )
    simulated.add_argument(
        "--rigs",
        type=whole(1, MOST_RIGS),
        metavar="N",
        help="commission N rigs, from --seed on, and print what was named",
    )
    glass.add_arguments(parser)
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> int:
    """Commission the rig; 1 if a step has not passed."""
    if (options.rigs or not (options.port or options.config)) and not options.sim:
        raise UsageError("No board is given: add --port or --config, or --sim.")
    if options.sim and (options.port or options.config or options.scan):
        raise UsageError("--sim cannot be combined with --port, --config or --scan: its rig has a board and a scan.")
    if options.wiring not in (None, "identity"):
        raise UsageError("--wiring: first-light knows plates with an amplifier and a sensor for each mode only.")
    return _rigs(options) if options.rigs else _commission(options)


def _rigs(options: argparse.Namespace) -> int:
    from ...sim.plate.glasses import driven_modes
    from ..progress import Progress
    from .rigs import drawn, play, table

    plate = glass.chosen(options)
    modes = driven_modes(plate.plate, plate.modes)
    played = []
    with Progress("commissioning rigs") as progress:
        for place in range(options.rigs):
            seed = options.seed + place
            played.append(play(seed, drawn(seed, modes), plate, has_scope=seed % 2 == 0))
            progress((place + 1) / options.rigs)
    print(table(played))
    misled = [sentence for rig in played for sentence in rig.misled]
    if misled:
        print("\n".join(["", "What was named though it was sound:", *misled]))
    return 1 if any(rig.is_driven_in_danger for rig in played) else 0


def _commission(options: argparse.Namespace) -> int:
    from ..calibrate import folder
    from . import state as states
    from .commission import Kept, at_the_terminal, summary

    known = ("resonance", "modes", "trackpad")
    is_ours = has_mark(options.out / states.STATE_FILE, b"{")
    folder.prepare(options.out, known, [options.scan], is_simulated=options.sim, is_forced=options.force or is_ours)
    state = states.Commissioning(options.sim) if options.again else states.load(options.out, is_simulated=options.sim)
    kept = Kept(state, options.out)
    with contextlib.ExitStack() as stack:
        new_bench, new_loop = _simulated(options, state) if options.sim else _real(options, stack)
        with asyncio.Runner(loop_factory=new_loop) as runner:
            is_done = runner.run(at_the_terminal(kept, new_bench))
    print(f"\n{summary(kept, is_done=is_done)}")
    return 0 if is_done else 1


def _simulated(options: argparse.Namespace, state: Commissioning) -> tuple[NewBench, LoopFactory]:
    from ...sim.commissioning.mistakes import random_mistakes
    from ...sim.commissioning.rig import FaultyRig
    from ...sim.plate.ground_truth import PlateSettings
    from ...sim.virtual_time import VirtualTimeLoop
    from .bench import Bench
    from .shown import ShownTechnician

    plate = glass.chosen(options)
    settings = PlateSettings.of(plate.plate, plate.modes or None)
    if state.mistakes is None:
        state.mistakes = (
            random_mistakes(options.seed, settings.driven_modes, options.mistakes) if options.mistakes else ()
        )
    rig = FaultyRig(settings, state.mistakes, options.seed)

    def new_bench(front: Front) -> Bench:
        technician = ShownTechnician(rig, options.seed, front, lambda left: setattr(state, "mistakes", left))
        return Bench(technician, technician.new_link, "the simulated rig", options.out, True, plate=plate)

    return new_bench, VirtualTimeLoop


def _real(options: argparse.Namespace, stack: contextlib.ExitStack) -> tuple[NewBench, LoopFactory | None]:
    from ...io.devices.serial_link import SerialLink
    from ..firmware.program import named_port
    from .bench import Bench
    from .person import PRESS_S, TOUCH_S, AtTheBench

    port, baud = named_port(options, stack)
    where = f"{port} at {baud} baud"

    def new_bench(front: Front) -> Bench:
        person = AtTheBench(front, pads.chosen(options))
        bench = Bench(person, lambda: SerialLink(port, baud), where, options.out, False)
        bench.device, bench.press_s, bench.touch_s = {"port": port, "baud": baud}, PRESS_S, TOUCH_S
        bench.scan, bench.size = options.scan, options.size
        return bench

    return new_bench, None
