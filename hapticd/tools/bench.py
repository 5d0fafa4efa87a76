"""The command `hapticd bench`."""

from __future__ import annotations

import argparse

from ..files import outputs
from .arguments import number, whole

MOST_STEPS = 1_000_000_000  # half an hour
PARTS = ("modes", "prediction", "solver", "stability", "tick", "recording", "leak", "firmware", "soak", "all")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `hapticd bench`."""
    parser.add_argument("part", nargs="?", choices=PARTS, default="all", metavar="PART", help=", ".join(PARTS))
    parser.add_argument(
        "--seconds", type=number(0.0, 600.0), default=2.0, help="tick: of a paced measurement (default 2)"
    )
    parser.add_argument(
        "--steps",
        type=whole(0, MOST_STEPS),
        default=10_000_000,
        help="stability: of the walk (default 10000000)",
    )
    parser.add_argument("--hours", type=number(0.0, is_above=True), default=1.0, help="soak: virtual time (default 1)")
    parser.add_argument(
        "--real-time",
        type=number(0.0, is_above=True),
        metavar="SECONDS",
        help="soak: run the service in real time: alone, with CPU hogs, under a flood of messages; each so long",
    )
    outputs.add_json(parser)
    outputs.add_file(parser, "--plot", outputs.PICTURE, metavar="F.png", help="plot error against run time")
    parser.set_defaults(command=_bench)


def _bench(options: argparse.Namespace) -> None:
    from ..bench import suite

    suite.run(
        options.part,
        seconds=options.seconds,
        steps=options.steps,
        hours=options.hours,
        real_time_s=options.real_time,
        json_file=options.json,
        plot=options.plot,
    )
