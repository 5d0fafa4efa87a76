"""`python tests/soak endurance|daemon [--hours H]`: H hours of virtual time, and the table of them;
`python tests/soak walk [--steps N]`: N steps of the solver."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path[0] = str(Path(__file__).parents[1])

from soak import daemon, endurance, walk  # noqa: E402

from hapticd.bench.tables import render  # noqa: E402
from hapticd.errors import HapticdError  # noqa: E402
from hapticd.tools import campaigns  # noqa: E402

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("soak", choices=("endurance", "daemon", "walk"))
parser.add_argument("--hours", type=float, default=1.0)
parser.add_argument("--steps", type=int, default=1_000_000)
campaigns.add_arguments(parser, "endurance, walk: ")
options = parser.parse_args()
try:
    if options.soak == "daemon":
        print(render(daemon.run(options.hours)))
    else:
        campaign, is_walk = campaigns.of(options), options.soak == "walk"
        print(render(walk.run(options.steps, campaign) if is_walk else endurance.run(options.hours, campaign)))
except HapticdError as error:
    sys.exit(str(error))
