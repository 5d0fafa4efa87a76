"""`python tests/soak endurance|daemon [--calibrating] [--hours H]`: H hours of virtual time, and the table of them."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path[0] = str(Path(__file__).parents[1])

from soak import daemon, endurance  # noqa: E402

from hapticd.bench.tables import render  # noqa: E402
from hapticd.errors import HapticdError  # noqa: E402
from hapticd.tools.campaign import runner  # noqa: E402

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("soak", choices=("endurance", "daemon"))
parser.add_argument("--calibrating", action="store_true", help="a daemon that calibrates itself, in one run")
parser.add_argument("--hours", type=float, default=1.0)
runner.add_arguments(parser, "endurance: ")
options = parser.parse_args()
try:
    if options.soak == "endurance":
        with runner.of(options) as campaign:
            print(render(endurance.run(options.hours, campaign)))
    else:
        print(render(daemon.run(options.hours, is_calibrating=options.calibrating)))
except HapticdError as error:
    sys.exit(str(error))
