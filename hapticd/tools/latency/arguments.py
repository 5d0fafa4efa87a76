"""`hapticd latency`."""

from __future__ import annotations

import argparse
from pathlib import Path

from .. import configured


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which devices, how long, and what is written."""
    configured.add_arguments(parser)
    parser.add_argument("--seconds", type=float, default=10.0, help="how long (default 10); move two fingers meanwhile")
    parser.add_argument("--json", metavar="F", help="write the figures as JSON; - is standard output")
    parser.add_argument(
        "--ledger", type=Path, metavar="F.csv", help="write each frame's line: its report, ages, delays"
    )
    parser.add_argument("--plot", type=Path, metavar="F.png", help="draw the distributions")
    parser.set_defaults(command=_latency)


def _latency(options: argparse.Namespace) -> None:
    from . import program as latency

    loaded = configured.configuration(options)
    configured.log_to_stderr(loaded.log.level)
    latency.run(loaded, options.seconds, json_file=options.json, ledger=options.ledger, plot=options.plot)
