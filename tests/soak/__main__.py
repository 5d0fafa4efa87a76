"""`python tests/soak endurance [--hours H]`: H hours of virtual time, and the table of them."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path[0] = str(Path(__file__).parents[1])

from soak import endurance  # noqa: E402

from hapticd.bench.tables import render  # noqa: E402
from hapticd.errors import HapticdError  # noqa: E402
from hapticd.tools import campaigns  # noqa: E402

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("soak", choices=("endurance",))
parser.add_argument("--hours", type=float, default=1.0)
campaigns.add_arguments(parser, "endurance: ")
options = parser.parse_args()
try:
    print(render(endurance.run(options.hours, campaigns.of(options))))
except HapticdError as error:
    sys.exit(str(error))
