"""`hapticd doctor`."""

from __future__ import annotations

import argparse
from pathlib import Path

from .. import doctor


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which configuration."""
    parser.add_argument("--config", type=Path, help="the service's configuration (default: the built-in one)")
    parser.set_defaults(command=_doctor)


def _doctor(options: argparse.Namespace) -> int:
    return doctor.examine(options.config)
