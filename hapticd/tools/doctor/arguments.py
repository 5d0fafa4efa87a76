"""`hapticd doctor`."""

from __future__ import annotations

import argparse
from pathlib import Path

from .. import doctor


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which configuration, in which form, and whether all is collected."""
    parser.epilog = f"{parser.epilog}\n         hapticd doctor --bundle report.tar.gz"
    parser.add_argument("--config", type=Path, help="the service's configuration (default: the built-in one)")
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")
    parser.add_argument(
        "--bundle",
        type=Path,
        metavar="F.tar.gz",
        help="collect findings, configuration, status, log, versions and 10 s of recording; nothing is sent",
    )
    parser.set_defaults(command=_doctor)


def _doctor(options: argparse.Namespace) -> int:
    return doctor.examine(options.config, as_json=options.json, bundle=options.bundle)
