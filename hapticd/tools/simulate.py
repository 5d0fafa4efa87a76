"""`hapticd simulate`: run a scenario in virtual time, and score it."""

from __future__ import annotations

import argparse
import json
import sys
import time

from ..files import outputs
from ..sim.fingers.scenarios import SCENARIOS
from .arguments import number, whole

LEAST_S = 0.01  # as sim.lockstep, which takes a second to import


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scenario, its conditions, and the outputs."""
    scenarios = "\n".join(f"  {scenario.name:<16} {scenario.summary}" for scenario in SCENARIOS.values())
    parser.epilog = f"{parser.epilog}\n\nscenarios:\n{scenarios}"
    parser.add_argument("scenario", choices=sorted(SCENARIOS), metavar="SCENARIO", help="see below")
    parser.add_argument("--seed", type=whole(0), default=1, help="of fingers, noise and mode map (default 1)")
    parser.add_argument("--seconds", type=number(LEAST_S), help="duration (default: the scenario's own)")
    parser.add_argument(
        "--speed", type=number(0.0, is_above=True), default=100.0, metavar="MM_S", help="of the fingers (default 100)"
    )
    parser.add_argument("--noise", type=number(0.0), default=0.05, metavar="MM", help="of the sensor (default 0.05)")
    parser.add_argument(
        "--alone", action="store_true", help="skip the comparison with the paper's scheme and perfect knowledge"
    )
    outputs.add_json(parser)
    outputs.add_file(parser, "--out", outputs.NPZ, metavar="F.npz", help="write the arrays of the run")
    outputs.add_file(parser, "--plot", outputs.PICTURE, metavar="F.png", help="draw it like the paper's figures")
    outputs.add_file(
        parser, "--record", outputs.RECORDING, metavar="F.mcap", help="record it, with the plate's ground truth"
    )
    parser.set_defaults(command=_simulate)


def _simulate(options: argparse.Namespace) -> None:
    from ..sim import lockstep, report

    settings = lockstep.Settings(speed_mm_s=options.speed, noise_mm=options.noise)
    t_start_s = time.perf_counter()
    if options.record is None:
        result = lockstep.run(options.scenario, settings=settings, seed=options.seed, seconds=options.seconds)
    else:
        from .record import simulated

        options.record.unlink(missing_ok=True)  # with --force: a recording would take the next free name
        result = simulated.run(
            options.scenario, options.record, settings=settings, seed=options.seed, seconds=options.seconds
        )
    took_s = time.perf_counter() - t_start_s
    figures = report.figures(result, compare=not options.alone)
    print(report.table(figures), file=sys.stderr)
    print(f"{result.t_s[-1]:.1f} s of virtual time in {took_s:.2f} s", file=sys.stderr)
    if options.json is not None:
        outputs.write_text(json.dumps(figures, indent=2) + "\n", options.json)
    if options.out is not None:
        report.save(result, options.out)
    if options.plot is not None:
        from ..sim import picture

        picture.draw_run(result, options.plot)
